"""What only the figures draw: close-ups, surfaces from the side, profiles."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import numpy as np

from rakelight.geometry.mesh import triangulate
from rakelight.model import Array, Camera, Floats, Mask
from rakelight.pictures.clay import shaded
from rakelight.pictures.montage import BACKGROUND
from rakelight.pictures.shown import object_window

Window = tuple[slice, slice]
"""Rows and columns."""

MARGIN_PX = 8


FACE = (0.27, 0.45)
"""Where the bust's eyes and nose are: down and across its window."""


def close_up(mask: Mask, where: tuple[float, float] = FACE, share: float = 0.2) -> Window:
    """A square window around `where` (down, across) in the object's window.

    share : its side over the object's height

    >>> close_up(np.ones((100, 80), bool))
    (slice(17, 37, None), slice(26, 46, None))
    """
    rows, columns = object_window(mask, margin=0)
    height, width = rows.stop - rows.start, columns.stop - columns.start
    side = max(4, round(share * height))
    top = rows.start + round(where[0] * height - side / 2)
    left = columns.start + round(where[1] * width - side / 2)
    return slice(max(0, top), top + side), slice(max(0, left), left + side)


def turned(depth_m: Floats, mask: Mask, camera: Camera, yaw_deg: float) -> Array:
    """A depth map as clay, turned about the upright axis through its middle, cropped to it.

    90 degrees shows its profile, the front to the left.  Parallel projection, a pixel is as large
    as a pixel in the middle of the object.  Nothing is drawn across depth jumps.

    >>> camera = Camera(9, 9, fx=9.0, fy=9.0, cx=4.0, cy=4.0)
    >>> turned(np.ones((9, 9)), np.ones((9, 9), bool), camera, 60.0).shape
    (25, 21)
    """
    mesh = triangulate(depth_m, mask & np.isfinite(depth_m), camera)
    middle_m = np.median(mesh.vertices_m, axis=0)
    cos, sin = np.cos(radians(yaw_deg)), np.sin(radians(yaw_deg))
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    pixels = (mesh.vertices_m - middle_m) @ turn.T * camera.fx / middle_m[2]
    corners = pixels[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    grey = shaded(normals[None], np.ones((1, len(normals)), bool))[0]
    return _splatted(corners, grey)


def _splatted(corners: Floats, grey: Array) -> Array:
    """A picture that just holds triangles (F, 3, 3), in pixels, the nearest in front."""
    steps = np.arange(5) / 4
    share = np.array([(1 - a - b, a, b) for a in steps for b in steps if a + b <= 1])
    points = np.einsum("kc,fcd->fkd", share, corners).reshape(-1, 3)
    place = np.rint(points[:, :2] - points[:, :2].min(axis=0)).astype(int) + MARGIN_PX
    width, height = place.max(axis=0) + 1 + MARGIN_PX
    order = np.argsort(-points[:, 2], kind="stable")  # the farthest first, then overdrawn
    picture = np.full((height, width), BACKGROUND, np.uint8)
    picture[place[order, 1], place[order, 0]] = np.repeat(grey, len(share))[order]
    return picture


@dataclass(frozen=True, slots=True)
class Sample:
    """One pixel of a line across several depth maps, millimetres; None where there is no depth."""

    pixel: int
    depth: str
    mm: float | None


def profile(line: tuple[slice | int, slice | int], **depth_m: Floats) -> list[Sample]:
    """The depth maps along a line of pixels, such as (row, slice).

    >>> profile((0, slice(1, 2)), truth=np.array([[1.0, 2.0]]))
    [Sample(pixel=1, depth='truth', mm=2000.0)]
    """
    along = next(each for each in line if isinstance(each, slice))
    return [
        Sample(along.start + k, name, round(1000 * float(z), 4) if np.isfinite(z) else None)
        for name, depth in depth_m.items()
        for k, z in enumerate(depth[line])
    ]
