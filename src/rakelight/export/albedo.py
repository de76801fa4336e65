"""albedo.png, and the sRGB curve."""

from __future__ import annotations

import numpy as np

from rakelight.capture.images import encode_png
from rakelight.model import Array, Floats


def albedo_png(albedo: Floats) -> bytes:
    """16-bit RGB PNG, sRGB encoded, of a linear albedo (H, W, 3).

    Picture viewers and texture slots for base colour expect sRGB; 16 bits lose nothing by it.
    """
    return encode_png(albedo_values(albedo))


def albedo_values(albedo: Floats) -> Array:
    """uint16 sRGB values of a linear albedo: 65535 is albedo 1, brighter is clipped.

    >>> albedo_values(np.array([0.0, 0.2140, 1.0, 1.3])).tolist()
    [0, 32765, 65535, 65535]
    """
    return np.rint(srgb(albedo) * 65535).astype(np.uint16)


def srgb(linear: Floats) -> Floats:
    """Linear light, clipped to 0..1, to sRGB code values 0..1 (IEC 61966-2-1).

    >>> srgb(np.array([-1.0, 0.002, 1.0, 2.0])).round(5).tolist()
    [0.0, 0.02584, 1.0, 1.0]
    """
    light = np.clip(linear, 0, 1)
    code = np.asarray(12.92 * light)
    bright = light > 0.0031308
    code[bright] = 1.055 * np.power(light[bright], 1 / 2.4) - 0.055
    return code
