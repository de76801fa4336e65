"""normals.tiff and normals.png."""

from __future__ import annotations

from typing import Literal

import numpy as np

from rakelight.capture.images import encode_png, encode_tiff
from rakelight.export.finite import all_finite
from rakelight.export.strips import in_strips
from rakelight.model import Array, Floats

NormalMap = Literal["opengl", "directx"]

# Outside the object the map is flat, so that a texture filter does not bleed a wrong slope in.
FLAT = (128, 128, 255)

# Camera frame (x right, y down, z forward) to the axes of the picture.
_AXES: dict[str, tuple[int, int, int]] = {
    "opengl": (1, -1, -1),  # x right, y up, z to the viewer
    "directx": (1, 1, -1),  # x right, y down, z to the viewer
}


def normals_tiff(normals: Floats) -> bytes:
    """float32 TIFF of normals (H, W, 3) in the camera frame, NaN outside the object."""
    return encode_tiff(normals.astype(np.float32, copy=False))


def normals_png(normals: Floats, convention: NormalMap = "opengl") -> bytes:
    """8-bit RGB normal map of normals (H, W, 3) in the camera frame."""
    return encode_png(in_strips(lambda strip: normal_map(strip, convention), normals))


def normal_map(normals: Floats, convention: NormalMap = "opengl") -> Array:
    """uint8 normal map (n + 1)/2 of unit normals (H, W, 3), camera frame; flat where NaN.

    >>> upward = np.array([[[0.0, -1.0, 0.0]]])  # y points down in the camera frame
    >>> normal_map(upward).tolist(), normal_map(upward, "directx").tolist()
    ([[[128, 255, 128]]], [[[128, 0, 128]]])
    """
    inside = all_finite(normals)
    unit = normals[inside] * np.array(_AXES[convention], dtype=normals.dtype)
    picture = np.full(normals.shape, FLAT, dtype=np.uint8)
    picture[inside] = np.rint(np.clip(unit * 127.5 + 127.5, 0, 255))
    return picture
