"""Degenerate masks, without a pixel that has a normal: the result is the prepared depth."""

from __future__ import annotations

import numpy as np

from rakelight.errors import CaptureError
from rakelight.geometry.grid import has_gradient
from rakelight.methods.base import Estimate
from rakelight.model import Finding, Lights
from rakelight.prepare import Prepared


def without_normals(prepared: Prepared) -> Estimate | None:
    """The prepared depth, where the object is nowhere two pixels wide and so has no normals.

    Raises CaptureError where no photograph has a usable value on the rest.
    """
    inner = has_gradient(prepared.mask)[prepared.mask]
    if inner.any():
        if not any(prepared.pixels(i)[1][inner].any() for i in range(len(prepared))):
            raise CaptureError(
                "the photographs show nothing of the object",
                source=prepared.source,
                seen="only black and saturated pixels",
                remedy="change the exposure, or the mask if it is elsewhere",
            )
        return None
    nothing = Finding(
        "warning",
        "too-thin",
        "the object is nowhere two pixels wide, so the photographs say nothing about its slope",
        "check the mask",
    )
    black, count = np.zeros((*prepared.mask.shape, 3)), len(prepared.photographs)
    return Estimate(
        log_depth=np.log(prepared.depth_m),
        albedo=black,
        confidence=black[..., 0],
        lights=Lights(np.zeros((count, 1, 3)), np.zeros((count, 1))),
        converged=True,
        findings=(nothing,),
    )
