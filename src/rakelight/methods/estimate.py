"""What every method gives back, and the checks and measures that methods share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rakelight.errors import MethodError
from rakelight.model import Camera, Finding, Floats, Lights, Mask
from rakelight.prepare import Prepared

# Confidence is one half where the photographs leave this doubt in a normal.
HALF_CONFIDENCE_DEG = 3.0


@dataclass(frozen=True)
class Estimate:
    """A method's answer on the prepared window.

    log_depth : (h, w) log metres; albedo : (h, w, 3) linear; confidence : (h, w) 0..1
    energy : one value per iterate, the prepared depth's first
    timings_s : seconds of parts of the work, such as "solve"
    """

    log_depth: Floats
    albedo: Floats
    confidence: Floats
    lights: Lights
    energy: tuple[float, ...] = ()
    converged: bool = False
    findings: tuple[Finding, ...] = ()
    timings_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def iterations(self) -> int:
        """How many times the depth was moved."""
        return max(0, len(self.energy) - 1)


def require_photographs(prepared: Prepared, method: str, least: int) -> None:
    """Raise MethodError when the capture has fewer than `least` photographs.

    Super-resolution by a factor s needs at least s^2: so many unknowns share a depth pixel.
    """
    count, needed = len(prepared.photographs), max(least, prepared.factor**2)
    if count < needed:
        raise MethodError(
            f"too few photographs for {method} at scale {prepared.factor}",
            source=prepared.source,
            seen=str(count),
            needed=f"at least {needed}",
            remedy="take more photographs with the lamp in other places and the camera fixed",
        )


def photometric_confidence(tensor: Floats, noise: float, length: Floats, camera: Camera) -> Floats:
    """Confidence (...) from what the photographs say about each normal.

    tensor : (..., 3) summed squared derivatives (uu, uv, vv) of the pixel values with respect to
        the gradient of log depth; noise : standard deviation of a pixel value
    length : (...) |m| of the normals

    The standard deviation d of the normal in its weakest direction, in degrees, gives
    1 / (1 + (d / 3)^2): 1 where the photographs settle the normal, 0 where they say nothing.

    >>> camera = Camera(1, 1, fx=1.0, fy=1.0, cx=0.0, cy=0.0)
    >>> strong, weak = np.array([[1e6, 0.0, 1e6]]), np.array([[1e6, 0.0, 0.0]])
    >>> [round(float(photometric_confidence(t, 0.01, np.ones(1), camera)[0]), 3)
    ...  for t in (strong, weak)]
    [1.0, 0.0]
    """
    uu, uv, vv = np.moveaxis(tensor, -1, 0)
    weakest = (uu + vv) / 2 - np.hypot((uu - vv) / 2, uv)
    focal = np.sqrt(camera.fx * camera.fy)
    # A change d of the gradient turns the normal by about f d / |m|.
    information = np.maximum(weakest, 0) * (length / (focal * noise)) ** 2
    doubt_squared = np.degrees(1.0) ** 2 / np.maximum(information, 1e-12)
    return np.asarray(1 / (1 + doubt_squared / HALF_CONFIDENCE_DEG**2))


def scatter(values: Floats, mask: Mask) -> Floats:
    """Values (P[, C]) of the mask's pixels as an image (h, w[, C]), 0 elsewhere.

    >>> scatter(np.array([5.0]), np.array([[False, True]])).tolist()
    [[0.0, 5.0]]
    """
    image = np.zeros((*mask.shape, *values.shape[1:]))
    image[mask] = values
    return image
