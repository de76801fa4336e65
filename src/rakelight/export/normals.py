"""normals.tiff and normals.png."""

from __future__ import annotations

import numpy as np

from rakelight.capture.images import encode_png, encode_tiff
from rakelight.export.strips import in_strips
from rakelight.model import Floats
from rakelight.pictures.colors import NormalMap, normal_map


def normals_tiff(normals: Floats) -> bytes:
    """float32 TIFF of normals (H, W, 3) in the camera frame, NaN outside the object."""
    return encode_tiff(normals.astype(np.float32, copy=False))


def normals_png(normals: Floats, convention: NormalMap = "opengl") -> bytes:
    """8-bit RGB normal map of normals (H, W, 3) in the camera frame."""
    return encode_png(in_strips(lambda strip: normal_map(strip, convention), normals))
