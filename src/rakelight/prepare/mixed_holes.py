"""Measurements that were mixed with holes: depth that was resized with its holes as 0.

Interpolation, OpenCV's default, makes a ramp from the object down to 0 of the edge of each hole.
Its near half is nearer than half of the object's distance, where nothing of an object is, and thin.
"""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats, Mask

# The object's distance times this: what is nearer, and thin, is no surface of it.
NEARER = 0.5
# Largest distance to what is farther, depth pixels: of a map that was enlarged sixteen times, at
# the corners of its holes.
THICKEST_PX = 12.0
# Share of the near half's pixels that are at most as deep in it as it is taken to be wide.
NEARLY_ALL = 0.9
# How far from the near half measurements are mixed, in its widths: 1 where interpolation is linear;
# cubic interpolation swings back once more.
REACH = 3.0


def mixed_with_holes(depth_m: Floats, on_object: Mask) -> Mask:
    """Which measurements (h, w) of the object lie on ramps down to holes.

    depth_m : (h, w) metres, NaN = no measurement; on_object : (h, w) the pixels that show it

    >>> import cv2
    >>> depth = np.full((40, 40), 0.8)
    >>> depth[18:22, 18:22] = 0
    >>> ramps = cv2.resize(depth, (160, 160))
    >>> mixed = mixed_with_holes(np.where(ramps > 0, ramps, np.nan), np.ones((160, 160), bool))
    >>> bool(mixed[(ramps > 0) & (ramps < 0.79)].all()), int(mixed.sum())
    (True, 656)
    """
    from scipy.ndimage import distance_transform_edt, label, maximum

    measured = np.isfinite(depth_m)
    seen = measured & on_object
    if not seen.any():
        return seen
    near = measured & (depth_m < NEARER * float(np.median(depth_m[seen])))
    if not near.any():
        return np.asarray(near)
    parts, count = label(near, structure=np.ones((3, 3)))
    depth_in_it = distance_transform_edt(near | ~measured)
    thickness = np.append(np.inf, maximum(depth_in_it, parts, np.arange(1, count + 1)))
    near = thickness[parts] <= THICKEST_PX
    if not near.any():
        return np.asarray(near)
    reach = REACH * float(np.quantile(depth_in_it[near], NEARLY_ALL)) + 1
    return np.asarray(seen & (distance_transform_edt(~near) <= reach))
