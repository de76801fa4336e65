"""normals.png."""

from __future__ import annotations

from rakelight.capture.images import encode_png
from rakelight.export.strips import in_strips
from rakelight.model import Floats
from rakelight.pictures.colors import NormalMap, normal_map


def normals_png(normals: Floats, convention: NormalMap = "opengl") -> bytes:
    """8-bit RGB normal map of normals (H, W, 3) in the camera frame."""
    return encode_png(in_strips(lambda strip: normal_map(strip, convention), normals))
