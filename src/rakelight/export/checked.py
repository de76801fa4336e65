"""Maps of a result that are numbers of the right size, and yet not what their names say."""

from __future__ import annotations

import numpy as np

from rakelight.errors import InputError
from rakelight.geometry.camera import pixel_rays
from rakelight.geometry.finite import SIGMAS
from rakelight.geometry.grid import row_strips
from rakelight.model import Result

# How far the length of a unit vector may be from 1: half precision's rounding is a tenth of it.
ROUNDED = 0.01


def checked_maps(result: Result) -> Result:
    """A finite result as it is; looked at in strips, without copies.

    Raises InputError where an expected error or the prepared depth is negative, or the normals are
    not unit vectors that face the camera.
    """
    for name in ("prepared_depth", *SIGMAS):
        given = getattr(result, name)
        if given is not None and (lowest := np.min(given, initial=0, where=given < 0)) < 0:
            raise InputError(
                f"{name} is negative", source=name, seen=f"{lowest:g}", needed="0 or more, or NaN"
            )
    away = 0
    for rows in row_strips(len(result.depth)):
        inside = result.mask[rows]
        x, y = pixel_rays(result.camera, rows)
        normals = result.normals[rows]
        length = np.linalg.norm(normals, axis=-1)
        off = inside & (np.abs(length - 1) > ROUNDED)
        if off.any():
            raise InputError(
                "the normals are no unit vectors",
                source="normals",
                seen=f"one of length {length[off][0]:g}",
                needed="length 1",
                remedy="divide each by its length",
            )
        toward = (
            normals[..., 0] * x / result.camera.fx
            + normals[..., 1] * y / result.camera.fy
            + normals[..., 2]
        )
        away += int((inside & (toward > 0)).sum())
    # Not a single one: at outlines a finer normal may lie a little beyond what the camera sees.
    if away > result.mask.sum() / 2:
        raise InputError(
            "the normals face away from the camera",
            source="normals",
            seen=f"{away} of {result.mask.sum()} pixels",
            needed="n_z < 0: x right, y down, z forward",
            remedy="give -normals, or turn their axes into rakelight's",
        )
    return result
