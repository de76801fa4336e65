"""albedo.png."""

from __future__ import annotations

import numpy as np

from rakelight.capture.images import encode_png
from rakelight.export.strips import in_strips
from rakelight.model import Array, Floats
from rakelight.prepare.linear import srgb


def albedo_png(albedo: Floats) -> bytes:
    """16-bit RGB PNG, sRGB encoded, of a linear albedo (H, W, 3).

    Picture viewers and texture slots for base colour expect sRGB; 16 bits lose nothing by it.
    """
    return encode_png(in_strips(albedo_values, albedo))


def albedo_values(albedo: Floats) -> Array:
    """uint16 sRGB values of a linear albedo: 65535 is albedo 1, brighter is clipped.

    >>> albedo_values(np.array([0.0, 0.2140, 1.0, 1.3])).tolist()
    [0, 32765, 65535, 65535]
    """
    return np.rint(srgb(albedo) * 65535).astype(np.uint16)
