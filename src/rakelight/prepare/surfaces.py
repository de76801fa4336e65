"""Connected surfaces of a depth map."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import connected, surface_links
from rakelight.model import Array, Camera, Floats


def surfaces(depth_m: Floats, camera: Camera) -> tuple[Array, int]:
    """(h, w) number from 0 of the connected surface that each measurement is on, and how many.

    -1 where there is none.  Connected are neighbours without a jump between them.
    """
    return connected(surface_links(depth_m, np.isfinite(depth_m), camera))
