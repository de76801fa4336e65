"""A depth map brought to a finer grid that covers the same field of view."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats
from rakelight.prepare.inpaint import nearest_fill


def upsample(depth_m: Floats, shape: tuple[int, int]) -> Floats:
    """Depth (h, w) in metres on a grid of `shape` with the same view; NaN outside the object.

    Log depth is interpolated by cubic splines between pixel centres, which keep slopes and bends
    (OpenCV's bicubic kernel ripples on a slope); the object is first continued outwards, so that
    its border is not mixed with what lies behind.  The values outside are that continuation.

    >>> depth = np.exp(np.arange(24.0))[None, :].repeat(4, axis=0)
    >>> np.log(upsample(depth, (8, 48)))[4, 22:26].round(3).tolist()
    [10.75, 11.25, 11.75, 12.25]
    """
    from scipy.ndimage import zoom

    log_depth = np.log(nearest_fill(depth_m, np.isfinite(depth_m)))
    if shape == depth_m.shape:
        return np.exp(log_depth)
    finer = tuple(side / small for side, small in zip(shape, depth_m.shape, strict=True))
    return np.asarray(np.exp(zoom(log_depth, finer, order=3, mode="nearest", grid_mode=True)))
