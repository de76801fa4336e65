"""Maps in colours: albedo, normals, confidence, depth, errors, linear light."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from rakelight.errors import InputError
from rakelight.geometry.grid import all_finite
from rakelight.model import Array, Floats, Mask
from rakelight.pictures.montage import BACKGROUND
from rakelight.prepare.linear import srgb

NormalMap = Literal["opengl", "directx"]

# Outside the object a normal map is flat, so that a texture filter does not bleed a wrong slope in.
FLAT = (128, 128, 255)

# Camera frame (x right, y down, z forward) to the axes of a normal map.
AXES: dict[str, tuple[int, int, int]] = {
    "opengl": (1, -1, -1),  # x right, y up, z to the viewer
    "directx": (1, 1, -1),  # x right, y down, z to the viewer
}

# Confidence 0 to 1, as even steps of lightness that the colour-blind see too (cividis).
CONFIDENCE_COLORS = (
    (0, 34, 78), (66, 78, 108), (125, 124, 120), (187, 174, 109), (254, 232, 56)
)  # fmt: skip

# Errors from none to the largest: dark blue, blue, yellow, orange, dark red.
ERROR_COLORS = ((18, 26, 92), (52, 128, 178), (245, 240, 170), (226, 120, 54), (128, 0, 28))


def albedo_picture(albedo: Floats, mask: Mask) -> Array:
    """(H, W, 3) uint8 sRGB of a linear albedo (H, W, 3).

    >>> albedo_picture(np.ones((1, 1, 3)), np.array([[True]])).tolist()
    [[[255, 255, 255]]]
    """
    return _on_background(np.rint(255 * srgb(albedo)), mask)


def normals_picture(normals: Floats, mask: Mask) -> Array:
    """(H, W, 3) uint8 of normals (H, W, 3) in OpenGL's colours.

    >>> normals_picture(np.array([[[0.0, 0.0, -1.0]]]), np.array([[True]])).tolist()
    [[[128, 128, 255]]]
    """
    return _on_background(normal_map(normals), mask)


def normal_map(normals: Floats, convention: NormalMap = "opengl") -> Array:
    """uint8 normal map (n + 1)/2 of unit normals (H, W, 3), camera frame; flat where NaN.

    >>> upward = np.array([[[0.0, -1.0, 0.0]]])  # y points down in the camera frame
    >>> normal_map(upward).tolist(), normal_map(upward, "directx").tolist()
    ([[[128, 255, 128]]], [[[128, 0, 128]]])
    """
    inside = all_finite(normals)
    unit = normals[inside] * np.array(AXES[convention], dtype=normals.dtype)
    picture = np.full(normals.shape, FLAT, dtype=np.uint8)
    picture[inside] = np.rint(np.clip(unit * 127.5 + 127.5, 0, 255))
    return picture


def confidence_picture(confidence: Floats, mask: Mask) -> Array:
    """(H, W, 3) uint8 of a confidence (H, W) in the colours of `CONFIDENCE_COLORS`.

    >>> confidence_picture(np.array([[1.0]]), np.array([[True]])).tolist()
    [[[254, 232, 56]]]
    """
    return _on_background(np.rint(_ramp(confidence, CONFIDENCE_COLORS)), mask)


def _ramp(share: Floats, colors: Sequence[tuple[int, int, int]]) -> Floats:
    """(H, W, 3) the colours of shares (H, W), 0 to 1, between the first colour and the last."""
    stops, columns = np.linspace(0, 1, len(colors)), zip(*colors, strict=True)
    return np.stack([np.interp(share, stops, column) for column in columns], axis=-1)


def color_errors(errors: Floats, largest: float) -> Array:
    """(H, W, 3) uint8 picture of an error map: 0 is dark blue, `largest` and above dark red.

    NaN (off the mask) is white.  Raises InputError when `largest` is not positive.

    >>> color_errors(np.array([[0.0, 5.0, 99.0, np.nan]]), largest=10).tolist()
    [[[18, 26, 92], [245, 240, 170], [128, 0, 28], [255, 255, 255]]]
    """
    if not (np.isfinite(largest) and largest > 0):
        raise InputError(
            "the range of an error map is not positive",
            source="largest",
            seen=f"{largest}",
            needed="a value above 0",
        )
    share = np.clip(np.nan_to_num(np.asarray(errors, float)) / largest, 0, 1)
    picture = _ramp(share, ERROR_COLORS)
    picture[np.isnan(errors)] = 255
    return np.asarray(np.rint(picture).astype(np.uint8))


def depth_colors(depth_m: Floats, mask: Mask) -> Array:
    """(H, W, 3) near is blue, far is red, white is no measurement; 2 % of either end are cut."""
    low, high = np.nanquantile(np.where(mask, depth_m, np.nan), [0.02, 0.98])
    shown = np.where(mask, depth_m - low, np.nan)
    picture = color_errors(np.maximum(shown, 0), max(float(high - low), 1e-6))
    return np.where(mask[..., None], picture, BACKGROUND).astype(np.uint8)


def photograph_picture(linear: Floats) -> Array:
    """(H, W, 3) uint8 sRGB of linear light, white being 1."""
    return np.rint(srgb(linear) * 255).astype(np.uint8)


def _on_background(picture: Array, mask: Mask) -> Array:
    return np.where(mask[..., None], np.nan_to_num(picture), BACKGROUND).astype(np.uint8)
