"""confidence.png."""

from __future__ import annotations

import numpy as np

from rakelight.capture.images import encode_png
from rakelight.export.strips import in_strips
from rakelight.model import Array, Floats


def confidence_png(confidence: Floats) -> bytes:
    """8-bit grey PNG of a confidence map (H, W) in 0..1."""
    return encode_png(in_strips(confidence_values, confidence))


def confidence_values(confidence: Floats) -> Array:
    """uint8 values of a confidence in 0..1: 255 is 1.

    >>> confidence_values(np.array([0.0, 0.5, 1.0, 1.5])).tolist()
    [0, 128, 255, 255]
    """
    return np.rint(np.clip(confidence, 0, 1) * 255).astype(np.uint8)
