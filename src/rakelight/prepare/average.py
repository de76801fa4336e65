"""Several depth maps of the same view into one, and how noisy it is."""

from __future__ import annotations

import numpy as np

from rakelight.model import MAD_TO_SIGMA, Floats, Mask, SensorNoise

# Scatter of the maps over the sensor model's, below which they are copies of one measurement.
REPEATED = 0.1
# Side, pixels, of the window in which scatter is averaged: that of two maps alone is noisy.
NEIGHBOURHOOD_PX = 7


def robust_average(depth_m: Floats) -> Floats:
    """One depth map (h, w) from several (K, h, w), metres, NaN = no measurement.

    Infinite, zero and negative depth is no measurement either.
    Per pixel, measurements further than three noise widths from the median are left out and the
    rest averaged; the noise width is that of the whole stack, in metres or as a multiple of the
    sensor model, and never below the model's.  A pixel measured in less than a quarter of the maps
    has no measurement: what so few maps saw is mostly the edge of something else.

    >>> maps = np.array([[[1.0]], [[1.002]], [[1.001]], [[1.9]]])
    >>> round(float(robust_average(maps)[0, 0]), 6)
    1.001
    """
    stack, inlier = _inliers(depth_m)
    total = np.where(inlier, stack, 0.0).sum(axis=0)
    count = inlier.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def noise_sigma(
    depth_m: Floats,
    noise: SensorNoise | None = None,
    maps_m: Floats | None = None,
    on_object: Mask | None = None,
) -> Floats:
    """Standard deviation (h, w) in metres of `depth_m` (h, w), metres; NaN where there is none.

    noise : of the sensor, where it is known: the answer
    maps_m : (K, h, w) the maps that `depth_m` is the average of, where there are several
    on_object : (h, w) pixels whose noise counts, None for all

    Otherwise the larger of two things.  One is what the maps differ by from each other, pixel by
    pixel, and for a single map, or maps that repeat each other, the sensor model a z^2
    (Khoshelham & Elberink 2012).  The other is the pixel-to-pixel noise of `depth_m` itself, read
    from its second differences.  An average of several maps has the precision of one: the
    errors of a fixed sensor on a fixed object repeat.

    >>> flat = np.full((32, 32), 2.0)
    >>> round(float(noise_sigma(flat)[0, 0]), 7)
    0.0057
    >>> float(noise_sigma(flat, SensorNoise(sigma_m=0.002, at_m=1.0, growth=1.0))[0, 0])
    0.004
    """
    depth = np.asarray(depth_m, dtype=np.float64)
    if noise is not None:
        return noise.at(depth)
    single = SensorNoise().at(depth)
    object_m = depth if on_object is None else np.where(on_object, depth, np.nan)
    if maps_m is not None and len(maps_m) > 1:
        share = scatter(maps_m) / single
        finite = np.isfinite(share) & np.isfinite(object_m)
        typical = float(np.median(share[finite])) if finite.any() else 0.0
        if typical >= REPEATED:
            # Where all maps gave the same step of a coarse scale they are not free of noise.
            single = single * np.maximum(np.where(np.isfinite(share), share, 0), typical / 2)
    return np.asarray(np.maximum(single, pixel_noise(object_m)))


def pixel_noise(depth_m: Floats) -> float:
    """Standard deviation, metres, of the noise from pixel to pixel of a map (h, w).

    NaN is no measurement.  From second differences, which a smooth surface does not have; relief
    adds to them.  0 where no three pixels in a row are measured.

    >>> noisy = 1 + 0.003 * np.random.default_rng(0).standard_normal((64, 64))
    >>> round(pixel_noise(noisy), 3)
    0.003
    """
    second_differences = np.concatenate(
        [np.diff(depth_m, n=2, axis=axis).ravel() for axis in (0, 1) if depth_m.shape[axis] > 2]
        or [np.zeros(0)]
    )
    second_differences = np.abs(second_differences[np.isfinite(second_differences)])
    if not second_differences.size:
        return 0.0
    # The second difference of white noise has variance (1 + 4 + 1) sigma^2.
    return float(MAD_TO_SIGMA * np.median(second_differences) / np.sqrt(6))


def scatter(depth_m: Floats) -> Floats:
    """Standard deviation (h, w) in metres of one of several maps (K, h, w), from their differences.

    Of maps in succession, outliers left out, averaged over 7 x 7 pixels; NaN where no pixel
    nearby was measured twice in a row.

    >>> maps = 1 + 0.003 * np.random.default_rng(0).standard_normal((5, 20, 20))
    >>> round(float(np.median(scatter(maps))), 3)
    0.003
    """
    from scipy.ndimage import uniform_filter

    stack, inlier = _inliers(depth_m)
    both = inlier[1:] & inlier[:-1]
    # The difference of two measurements has twice the variance of one.
    squares = np.where(both, np.diff(np.where(inlier, stack, 0.0), axis=0) ** 2 / 2, 0.0)
    total, count = (
        uniform_filter(image.sum(axis=0, dtype=np.float64), NEIGHBOURHOOD_PX, mode="constant")
        for image in (squares, both)
    )
    enough = count > 0.5 / NEIGHBOURHOOD_PX**2
    return np.where(enough, np.sqrt(np.maximum(total, 0) / np.where(enough, count, 1)), np.nan)


def _inliers(depth_m: Floats) -> tuple[Floats, Mask]:
    """The maps (K, h, w) with NaN for no measurement, and which measurements are to be used."""
    stack = np.asarray(depth_m, dtype=np.float64)
    seen = np.isfinite(stack) & (stack > 0)
    stack = np.where(seen, stack, np.nan)
    if len(stack) == 1:
        return stack, seen
    count = seen.sum(axis=0)
    median = nan_median(stack)
    median[count < max(1.0, len(stack) / 4)] = np.nan
    model = SensorNoise().at(median)
    steps = np.abs(np.diff(stack, axis=0))
    width = np.maximum(_width(steps), np.maximum(_width(steps / model), 1.0) * model)
    return stack, np.abs(stack - median) <= 3 * width


def nan_median(values: Floats) -> Floats:
    """The median over the first axis of the values that are not NaN; NaN where all are.

    NumPy's nanmedian takes five times as long.
    """
    ordered = np.sort(values, axis=0)  # NaN comes last
    count = np.count_nonzero(np.isfinite(values), axis=0)[None]
    low, high = (
        np.take_along_axis(ordered, np.maximum(each, 0), axis=0)[0]
        for each in ((count - 1) // 2, count // 2)
    )
    return np.asarray(np.where(count[0] > 0, (low + high) / 2, np.nan))


def _width(steps: Floats) -> float:
    """Standard deviation of measurements from the differences of two; 0 without any.

    Deviations from the median of a few maps would be too small.
    """
    finite = steps[np.isfinite(steps)]
    return float(MAD_TO_SIGMA * np.median(finite) / np.sqrt(2)) if finite.size else 0.0
