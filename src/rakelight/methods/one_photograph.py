"""What the methods for one photograph work on: its linear light, and the prepared depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.averaging import Averaging
from rakelight.geometry.grid import Links, has_gradient, mean_gradient, surface_links
from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.base import scatter
from rakelight.methods.levels import NEARLY_ONE, depth_precision
from rakelight.model import Camera, Floats, Mask
from rakelight.prepare import Prepared


@dataclass(frozen=True, slots=True)
class OnePhotograph:
    """The first photograph on the prepared window, and the prepared depth with its precision.

    image : (h, w, 3) linear light, white is 1; usable : (h, w, 3) neither saturated nor black
    links : which neighbours are on one surface
    prior : (h, w) log of the prepared depth; prior_weight : (h, w) its precision, 1 / variance
    averaging : K, means over the sensor's pixels; None where those are about as small
    """

    image: Floats
    usable: Mask
    links: Links
    prior: Floats
    prior_weight: Floats
    averaging: Averaging | None
    camera: Camera

    @classmethod
    def of(cls, prepared: Prepared) -> OnePhotograph:
        """What a method for one photograph takes of `prepared`."""
        mask = prepared.mask
        values, usable = prepared.pixels(0)
        return cls(
            scatter(values.astype(np.float64), mask),
            scatter(1.0 * usable, mask) > 0,
            surface_links(prepared.depth_m, mask, prepared.camera),
            np.log(prepared.depth_m),
            depth_precision(prepared),
            prepared.sensor.averaging(mask) if prepared.factor > NEARLY_ONE else None,
            prepared.camera,
        )

    @property
    def mask(self) -> Mask:
        """(h, w) the object."""
        return self.links.mask

    @property
    def shaded(self) -> Mask:
        """(h, w, 3) the usable values of pixels that have a normal."""
        return np.asarray(self.usable & has_gradient(self.links)[..., None])

    def normals(self, log_depth: Floats) -> tuple[Floats, Floats]:
        """Normals (h, w, 3) and |m| (h, w) of a log depth (h, w)."""
        return normals_from_gradient(*mean_gradient(log_depth, self.links), self.camera)
