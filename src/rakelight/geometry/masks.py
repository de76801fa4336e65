"""Masks of pixels."""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.model import Mask


def dilate(mask: Mask, pixels: int) -> Mask:
    """`mask` (h, w) grown by `pixels` in all eight directions.

    >>> dilate(np.array([[0, 0, 0, 0, 1]], bool), 2)[0].tolist()
    [False, False, True, True, True]
    """
    square = np.ones((2 * pixels + 1, 2 * pixels + 1), np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), square) > 0)
