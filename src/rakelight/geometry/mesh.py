"""Depth map to triangles, cut where the depth jumps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rakelight.errors import InputError
from rakelight.geometry.camera import require_ideal
from rakelight.geometry.grid import STEEPEST
from rakelight.model import Array, Camera, Floats, Mask


class DepthMesh(NamedTuple):
    """Triangles of a depth map.

    vertices_m : (V, 3) float64, metres, camera frame
    faces : (F, 3) int32 into the vertices; counter-clockwise as the camera sees them, so that
        the right-hand normal faces the camera
    pixels : (V, 2) int32, (row, column) of each vertex
    """

    vertices_m: Floats
    faces: Array
    pixels: Array


def triangulate(
    depth_m: Floats, mask: Mask, camera: Camera, *, jump: float = STEEPEST
) -> DepthMesh:
    """Two triangles for every square of four neighbouring pixels, none across a depth jump.

    The square is split along the diagonal with the smaller depth difference, and a square with
    three usable corners gives one triangle.  Two neighbours are connected only if their depths
    differ by at most `jump` times their lateral distance on the object, which is z/f for
    pixels side by side.

    Parameters
    ----------
    depth_m : (H, W) metres along the optical axis; pixels that are not finite and positive are
        left out
    mask : (H, W) True = object
    camera : of the depth map
    jump : steepest slope of a surface, as depth change over lateral distance; the default is a
        surface turned 85 degrees away from the camera

    Returns
    -------
    The mesh; pixels that belong to no triangle have no vertex, so it may be empty.

    Raises
    ------
    InputError
        if the sizes differ or `jump` is not positive

    Examples
    --------
    >>> camera = Camera(width=3, height=2, fx=100.0, fy=100.0, cx=1.0, cy=0.5)
    >>> mesh = triangulate(np.ones((2, 3)), np.ones((2, 3), bool), camera)
    >>> mesh.vertices_m.shape, mesh.faces.shape
    ((6, 3), (4, 3))
    >>> step = np.array([[1.0, 1.0, 1.5], [1.0, 1.0, 1.5]])  # half a metre between columns
    >>> triangulate(step, np.ones((2, 3), bool), camera).faces.tolist()
    [[0, 2, 3], [0, 3, 1]]
    """
    corners = pixel_triangles(depth_m, mask, camera, jump=jump)
    used = np.zeros(depth_m.size, bool)
    used[corners] = True
    vertices_m, pixels = pixel_vertices(depth_m, used.reshape(depth_m.shape), camera)
    vertex_of_pixel = np.cumsum(used, dtype=np.int32) - 1
    return DepthMesh(vertices_m, vertex_of_pixel[corners].astype(np.int32, copy=False), pixels)


def pixel_triangles(
    depth_m: Floats, mask: Mask, camera: Camera, *, jump: float = STEEPEST
) -> Array:
    """(F, 3) the pixels, counted row by row, of the triangles of `triangulate`.

    >>> camera = Camera(width=2, height=2, fx=100.0, fy=100.0, cx=0.5, cy=0.5)
    >>> pixel_triangles(np.ones((2, 2)), np.ones((2, 2), bool), camera).tolist()
    [[0, 2, 3], [0, 3, 1]]
    """
    if depth_m.shape != camera.shape or mask.shape != camera.shape:
        raise InputError(
            "depth, mask and camera differ in size",
            seen=f"depth {depth_m.shape}, mask {mask.shape}",
            needed=f"{camera.shape}",
        )
    if not jump > 0:
        raise InputError("the depth jump has to be positive", source="jump", seen=f"{jump}")

    with np.errstate(invalid="ignore"):
        usable = mask & np.isfinite(depth_m) & (depth_m > 0)
    return _triangles(np.where(usable, depth_m, np.nan).astype(np.float64), camera, jump)


def pixel_vertices(depth_m: Floats, used: Mask, camera: Camera) -> tuple[Floats, Array]:
    """Of the used pixels (h, w): points (V, 3) in metres, and (row, column), (V, 2) int32."""
    require_ideal(camera)
    rows, columns = np.nonzero(used)
    z_used = depth_m[rows, columns].astype(np.float64)
    vertices_m = np.stack(
        [
            (columns - camera.cx) / camera.fx * z_used,
            (rows - camera.cy) / camera.fy * z_used,
            z_used,
        ],
        axis=1,
    )
    return vertices_m, np.stack([rows, columns], axis=1).astype(np.int32)


def _triangles(z: Floats, camera: Camera, jump: float) -> Array:
    """(F, 3) flat pixel indices of the triangles; z (H, W) is NaN where there is no vertex.

    The corners of a square are  a b  (a: pixel (v, u); b to its right; c below; d opposite).
                                 c d
    """
    a, b, c, d = z[:-1, :-1], z[:-1, 1:], z[1:, :-1], z[1:, 1:]
    step_u, step_v = 1 / camera.fx, 1 / camera.fy
    step_diagonal = float(np.hypot(step_u, step_v))

    def joined(first: Floats, second: Floats, step: float) -> Mask:
        """Whether two corners, `step` metres apart at one metre, lie on one surface."""
        # A comparison with NaN is False: a missing corner joins nothing.
        return np.asarray(np.abs(first - second) <= jump * step * np.minimum(first, second))

    right = joined(z[:, :-1], z[:, 1:], step_u)
    down = joined(z[:-1], z[1:], step_v)
    top, bottom, left, side = right[:-1], right[1:], down[:, :-1], down[:, 1:]

    ad, bc = np.abs(a - d), np.abs(b - c)
    # A missing corner leaves only the diagonal between the two beside it.
    along_ad = np.isnan(bc) | (ad <= bc)
    ad_joined = along_ad & joined(a, d, step_diagonal)
    bc_joined = ~along_ad & joined(b, c, step_diagonal)

    index = np.arange(z.size, dtype=np.int32).reshape(z.shape)
    ia, ib, ic, id_ = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    kinds = [
        (ad_joined & left & bottom, (ia, ic, id_)),
        (ad_joined & top & side, (ia, id_, ib)),
        (bc_joined & left & top, (ia, ic, ib)),
        (bc_joined & side & bottom, (ib, ic, id_)),
    ]
    return np.concatenate(
        [np.stack([corner[keep] for corner in corners], axis=1) for keep, corners in kinds]
    )
