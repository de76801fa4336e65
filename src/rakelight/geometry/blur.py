"""Gaussian means over a mask."""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.model import Floats, Mask

# Gaussians are cut off at so many standard deviations.
REACH = 4.0


def blurred(image: Floats, sigma_px: float, mask: Mask) -> Floats:
    """Gaussian mean of an image (h, w) or (h, w, C) over the mask (h, w) around each pixel.

    sigma_px : its standard deviation

    >>> inside = np.array([[True, True, True, False]])
    >>> blurred(np.array([[2.0, 2.0, 2.0, np.nan]]), 1.0, inside)[0, :3].round(6).tolist()
    [2.0, 2.0, 2.0]
    """
    side = 2 * round(REACH * sigma_px) + 1

    def blur(values: Floats) -> Floats:
        zero = cv2.BORDER_CONSTANT
        return np.asarray(cv2.GaussianBlur(values, (side, side), sigma_px, borderType=zero))

    inside, weight = mask, np.maximum(blur(1.0 * mask), 1e-6)
    if image.ndim == 3:
        inside, weight = inside[..., None], weight[..., None]
    return np.asarray(blur(np.where(inside, image, 0.0)).reshape(image.shape) / weight)
