"""Bilateral denoising of a depth map (the paper's 3.1, figure 4)."""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.model import Floats, Mask

# Standard deviation of the spatial weights, pixels; of the depth weights, in noise widths.
SPATIAL_SIGMA_PX = 2.5
RANGE_SIGMAS = 3.0


def bilateral(depth_m: Floats, mask: Mask, sigma_m: float, pixel_m: float) -> Floats:
    """Depth (h, w) in metres smoothed inside `mask` with its jumps kept; NaN outside.

    sigma_m : the noise to remove, metres
    pixel_m : a pixel's width on the object, metres (z / f)

    Weights fall off over 2.5 pixels in the image, and in depth over three noise widths and what
    a slope of 45 degrees gains over those 2.5 pixels: steeper steps stay.

    >>> depth = np.full((9, 9), 2.0); depth[4, 4] = 2.001
    >>> smooth = bilateral(depth, np.ones((9, 9), bool), sigma_m=0.001, pixel_m=0.001)
    >>> 2.0 < float(smooth[4, 4]) < 2.0001
    True
    """
    range_m = RANGE_SIGMAS * sigma_m + SPATIAL_SIGMA_PX * pixel_m
    # Pixels outside are set so far away in depth that they have no weight inside.
    lowest, highest = float(depth_m[mask].min()), float(depth_m[mask].max())
    values = np.where(mask, depth_m - lowest, highest - lowest + 20 * range_m)
    smooth = cv2.bilateralFilter(
        values.astype(np.float32),
        d=-1,
        sigmaColor=range_m,
        sigmaSpace=SPATIAL_SIGMA_PX,
        borderType=cv2.BORDER_REPLICATE,
    )
    return np.where(mask, lowest + smooth.astype(np.float64), np.nan)
