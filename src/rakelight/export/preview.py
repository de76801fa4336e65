"""preview.png: before beside after."""

from __future__ import annotations

import numpy as np

from rakelight.capture.images import encode_png
from rakelight.geometry.normals import surface_normals
from rakelight.model import Array, Result
from rakelight.pictures.clay import shaded
from rakelight.pictures.montage import side_by_side
from rakelight.pictures.shown import object_window, shown_depth, shown_normals


def preview(result: Result) -> Array:
    """The prepared depth (left) and the refined one (right) as clay, cropped to the object."""
    camera, factor, before_m, after_m = shown_depth(result)
    prepared = np.isfinite(before_m)
    before = shaded(surface_normals(before_m, prepared, camera), prepared)
    normals = shown_normals(result.normals[object_window(result.mask)], factor)
    return side_by_side(before, shaded(normals, np.isfinite(after_m)))


def preview_png(result: Result) -> bytes:
    """8-bit grey PNG of `preview`."""
    return encode_png(preview(result))
