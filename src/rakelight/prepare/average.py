"""Several depth maps of the same view into one, and how noisy it is."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats

# Standard deviation of one measurement at depth z metres: KINECT_NOISE * z^2 metres
# (Khoshelham & Elberink 2012, for the structured-light sensor that most captures come from).
KINECT_NOISE = 1.425e-3

MAD_TO_SIGMA = 1.4826


def robust_average(depth_m: Floats) -> Floats:
    """One depth map (h, w) from several (K, h, w), metres, NaN = no measurement.

    Infinite, zero and negative depth is no measurement either.
    Per pixel, measurements further than three noise widths from the median are left out and the
    rest averaged; the noise width is that of the whole stack, and never below that of the sensor
    model.  A pixel measured in less than a quarter of the maps has no measurement: what so few
    maps saw is mostly the edge of something else.

    >>> maps = np.array([[[1.0]], [[1.002]], [[1.001]], [[1.9]]])
    >>> round(float(robust_average(maps)[0, 0]), 6)
    1.001
    """
    stack = np.asarray(depth_m, dtype=np.float64)
    seen = np.isfinite(stack) & (stack > 0)
    stack = np.where(seen, stack, np.nan)
    if len(stack) == 1:
        return np.asarray(stack[0])
    enough = seen.sum(axis=0) >= max(1.0, len(stack) / 4)
    median = np.full(stack.shape[1:], np.nan)
    median[enough] = np.nanmedian(stack[:, enough], axis=0)
    # The difference of two maps has twice the variance; deviations from the median of a few maps
    # would be too small.
    steps = np.abs(np.diff(stack, axis=0))
    steps = steps[np.isfinite(steps)]
    width = MAD_TO_SIGMA * np.median(steps) / np.sqrt(2) if steps.size else 0.0
    inlier = np.abs(stack - median) <= 3 * np.maximum(width, KINECT_NOISE * median**2)
    total = np.where(inlier, stack, 0.0).sum(axis=0)
    count = inlier.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def noise_sigma(depth_m: Floats) -> Floats:
    """Standard deviation (h, w) in metres of `depth_m` (h, w), metres.

    The larger of the sensor model a z^2 (Khoshelham & Elberink 2012) and the map's own
    pixel-to-pixel noise, read from its second differences; NaN where there is no depth.  An
    average of several maps is trusted no more than one: what a fixed sensor gets wrong about a
    fixed object, it gets wrong every time.

    >>> flat = np.full((32, 32), 2.0)
    >>> round(float(noise_sigma(flat)[0, 0]), 7)
    0.0057
    """
    depth = np.asarray(depth_m, dtype=np.float64)
    bends = np.concatenate(
        [np.diff(depth, n=2, axis=axis).ravel() for axis in (0, 1) if depth.shape[axis] > 2]
        or [np.zeros(0)]
    )
    bends = np.abs(bends[np.isfinite(bends)])
    # The second difference of white noise has variance (1 + 4 + 1) sigma^2.
    own = MAD_TO_SIGMA * np.median(bends) / np.sqrt(6) if bends.size else 0.0
    return np.asarray(np.maximum(KINECT_NOISE * depth**2, own))
