"""Connected surfaces of a depth map, and those that only show beside the object."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import STEEPEST, connected, surface_links
from rakelight.model import Array, Camera, Floats, Mask

# Distance, pixels, within which a measurement beside the object is compared with its depth.
BESIDE_PX = 2


def surfaces(depth_m: Floats, camera: Camera) -> tuple[Array, int]:
    """(h, w) number from 0 of the connected surface that each measurement is on, and how many.

    -1 where there is none.  Connected are neighbours without a jump between them.
    """
    return connected(surface_links(depth_m, np.isfinite(depth_m), camera))


def beside_the_object(depth_m: Floats, touched: Mask, covered: Mask, camera: Camera) -> Mask:
    """Which measurements (h, w) at the object's border are of what lies behind it.

    touched : (h, w) pixels that see some of the object; covered : those that see nothing else
    camera : of the depth map

    They lie on surfaces of which no pixel is covered by the object, a jump behind one beside them.

    >>> camera = Camera(4, 1, fx=500.0, fy=500.0, cx=1.5, cy=0.0)
    >>> depth = np.array([[1.0, 1.0, 1.0, 1.4]])
    >>> covered = np.array([[True, True, False, False]])
    >>> beside_the_object(depth, np.ones((1, 4), bool), covered, camera).tolist()
    [[False, False, False, True]]
    """
    from scipy.ndimage import minimum_filter

    seen = touched & np.isfinite(depth_m)
    components, _ = surfaces(np.where(seen, depth_m, np.nan), camera)
    own = seen & np.isin(components, np.unique(components[seen & covered]))
    nearest = minimum_filter(np.where(own, depth_m, np.inf), 2 * BESIDE_PX + 1)
    # Thin parts of the object need not touch the rest of it: only a jump tells.
    jump = 1 + STEEPEST / min(camera.fx, camera.fy)
    return np.asarray(seen & ~own & (jump * nearest < np.where(seen, depth_m, 0.0)))
