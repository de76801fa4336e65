"""What lies behind the object and is measured at its border."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import bounding_window, reached, surface_links
from rakelight.geometry.masks import dilate
from rakelight.model import Camera, Floats, Mask
from rakelight.prepare.jumps import LEAST_PIXELS, without_measured_jumps
from rakelight.prepare.surfaces import surfaces

# By how much depth maps are commonly off their photographs, pixels of these.  With this and a depth
# pixel of blur the prepared depth of 45 random captures before a wall, whose depth is coarser than
# the photographs, is 0.89 times as far off, and no one's by more than 0.2 % worse
# (docs/results/changes.md, "Depth maps off their photographs").
SHIFT_PX = 2
# Fewest depth pixels of a part of the object at its border, a jump behind the rest and before the
# background: what has fewer are flying pixels at the same depth by chance.  Over 26 random captures
# that have such pixels depth is 0.88 times as far off; with 2 it is 0.91, with 8 0.87
# (docs/results/changes.md, "Flying pixels that agree").
LEAST_PART = 4


def beside_the_object(
    depth_m: Floats, touched: Mask, covered: Mask, camera: Camera, factor: float
) -> Mask:
    """Which measurements (h, w) at the object's border are of what lies behind it.

    depth_m : (h, w) metres, NaN = no measurement; that of the surroundings too, where there is some
    touched : (h, w) pixels that see some of the object; covered : those that see nothing else
    camera : of the depth map
    factor : pixels of the photographs along each side of one of its pixels

    They lie a jump behind the object beside them, and on a surface that comes in from well outside
    the mask, of which the object covers no pixel, or that has fewer than `LEAST_PART` pixels and
    lies before the background.  The first is seen where the depth map is shifted against the
    photographs, by up to `SHIFT_PX`; the last are flying pixels.

    >>> camera = Camera(4, 1, fx=500.0, fy=500.0, cx=1.5, cy=0.0)
    >>> depth = np.array([[1.0, 1.0, 1.0, 1.4]])
    >>> covered = np.array([[True, True, False, False]])
    >>> beside_the_object(depth, np.ones((1, 4), bool), covered, camera, 1).tolist()
    [[False, False, False, True]]
    """
    from scipy.ndimage import maximum_filter, minimum_filter

    found = np.zeros_like(touched)
    if not touched.any():
        return found
    border = 1 + int(np.ceil(SHIFT_PX / factor))
    window = bounding_window(touched, margin=2 * border)
    depth, inside, whole = depth_m[window], touched[window], covered[window]
    measured = np.isfinite(depth)
    seen = inside & measured
    rim = dilate(~inside, border)
    # Thin parts of the object need not touch the rest of it: only a jump tells.
    jump, size = 1 + LEAST_PIXELS / min(camera.fx, camera.fy), 2 * border + 1
    nearest = minimum_filter(np.where(seen, depth, np.inf), size)
    behind = seen & (rim | ~whole) & (jump * nearest < depth)
    if not behind.any():
        return found
    links = surface_links(depth, measured, camera)
    links = without_measured_jumps(links, depth, camera)
    # Well outside, since the object's own rim may reach beyond a narrow mask.  Steps are twice the
    # distances: links lead along rows and columns only.
    from_outside = reached(~dilate(inside, border), links, 4 * border)
    from_inside = reached(~rim, links, 2 * border)
    components, count = surfaces(np.where(seen, depth, np.nan), camera)
    own = seen & np.isin(components, np.unique(components[seen & whole]))
    # Flying pixels have been left out: the background may begin a few pixels farther out.
    background = maximum_filter(np.where(measured & ~inside, depth, -np.inf), 4 * border + 1)
    few = np.bincount(components[seen], minlength=count)[components] < LEAST_PART
    own &= from_inside | ~(from_outside | (few & (depth < background)))
    nearest = minimum_filter(np.where(own, depth, np.inf), size)
    found[window] = behind & ~own & (jump * nearest < depth)
    return found
