"""A depth map brought to a finer grid that covers the same field of view."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import area_mean
from rakelight.model import Floats, Mask
from rakelight.prepare.inpaint import nearest_fill


def upsample(depth_m: Floats, factor: int) -> Floats:
    """Depth (h, w) in metres, NaN outside the object, on a grid `factor` times finer.

    Log depth is interpolated by cubic splines between pixel centres, which keep slopes and bends
    (OpenCV's bicubic kernel ripples on a slope); the object is first continued outwards, so that
    its border is not mixed with what lies behind.  The values outside are that continuation.

    >>> depth = np.exp(np.arange(24.0))[None, :].repeat(4, axis=0)
    >>> np.log(upsample(depth, 2))[4, 22:26].round(3).tolist()
    [10.75, 11.25, 11.75, 12.25]
    """
    from scipy.ndimage import zoom

    log_depth = np.log(nearest_fill(depth_m, np.isfinite(depth_m)))
    if factor == 1:
        return np.exp(log_depth)
    return np.asarray(np.exp(zoom(log_depth, factor, order=3, mode="nearest", grid_mode=True)))


def coarse_mask(mask: Mask, factor: int) -> Mask:
    """Blocks of `factor` x `factor` pixels of which any lies on the object."""
    return area_mean(mask.astype(np.float64), factor) > 0
