"""depth.tiff and depth.png; the expected errors depth_sigma.tiff and normal_sigma.tiff."""

from __future__ import annotations

from math import floor, log10

import numpy as np

from rakelight.capture.images import encode_png, encode_tiff
from rakelight.export.strips import in_strips
from rakelight.model import Array, Floats

# Many readers, ours too, take 65535 for a sensor's "too far".
LARGEST = 65534


def float32_tiff(image: Floats) -> bytes:
    """float32 TIFF of depth, expected errors (H, W) or normals (H, W, 3), NaN outside."""
    return encode_tiff(image.astype(np.float32, copy=False))


def depth_png(depth_m: Floats, values_per_metre: float) -> bytes:
    """16-bit grey PNG of a depth map (H, W) in metres; 0 = outside the object (NaN)."""
    return encode_png(in_strips(lambda strip: depth_values(strip, values_per_metre), depth_m))


def depth_values(depth_m: Floats, values_per_metre: float) -> Array:
    """uint16 values of a depth map (H, W) in metres: rounded, 0 where it is NaN.

    Nothing wraps, and no depth becomes the 0 that means "outside": values end at 1 and 65534.

    >>> depth_values(np.array([[0.8, np.nan, 1e-9, 99.0]]), 50_000.0).tolist()
    [[40000, 0, 1, 65534]]
    """
    inside = np.isfinite(depth_m)
    values = np.rint(np.where(inside, depth_m, 1.0).astype(np.float64) * values_per_metre)
    return np.where(inside, np.clip(values, 1, LARGEST), 0).astype(np.uint16)


def choose_values_per_metre(deepest_m: float) -> float:
    """The largest of ... 1000, 2000, 5000, 10,000 ... values per metre that holds `deepest_m`.

    >>> choose_values_per_metre(0.8), choose_values_per_metre(9.87)
    (50000.0, 5000.0)
    """
    exact = LARGEST / deepest_m
    power = 10.0 ** floor(log10(exact))
    return max((step * power for step in (5.0, 2.0) if step * power <= exact), default=power)
