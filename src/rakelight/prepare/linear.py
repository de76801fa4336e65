"""Photographs as read -> linear light, and which of their pixels can be used."""

from __future__ import annotations

from typing import Any

import numpy as np

from rakelight.model import BLACK, SATURATED, Array, Encoding, Floats, Mask


def to_linear(values: Array, encoding: Encoding) -> Floats:
    """Linear light 0..1 (float32) of pixel values (uint8 or uint16) encoded as `encoding` says.

    >>> to_linear(np.array([0, 255], np.uint8), "srgb").tolist()
    [0.0, 1.0]
    >>> round(float(to_linear(np.array([128], np.uint8), "srgb")[0]), 4)
    0.2159
    """
    return linear_table(values.dtype, encoding).take(values)


def linear_table(dtype: np.dtype[Any], encoding: Encoding) -> Floats:
    """Linear light of every value of an unsigned integer type, float32 (IEC 61966-2-1)."""
    code = np.arange(np.iinfo(dtype).max + 1) / np.iinfo(dtype).max
    if encoding == "srgb":
        code = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    return code.astype(np.float32)


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


def usable(values: Array) -> Mask:
    """Which channels of which pixels are usable: neither saturated nor black.

    Channel by channel: where red clips, green and blue still say how bright the light was.

    >>> usable(np.array([[9, 9, 0], [9, 9, 255]], np.uint8)).tolist()
    [[True, True, False], [True, True, False]]
    """
    top = float(np.iinfo(values.dtype).max)
    return np.asarray((values < SATURATED * top) & (values > BLACK * top))
