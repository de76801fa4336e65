"""From log depth to normals, and their derivatives.

With p = log z, x = u - cx, y = v - cy, a normal depends on the gradient of p alone:

    m = (fx p_u, fy p_v, -(1 + x p_u + y p_v)),    n = m / |m|
    dn/dp_u = (I - n n^T) (fx, 0, -x)^T / |m|,     dn/dp_v = (I - n n^T) (0, fy, -y)^T / |m|

so every photometric term is a 2x2 tensor per pixel.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.camera import ALL, pixel_rays
from rakelight.geometry.grid import mean_gradient, neighbours, surface_links
from rakelight.model import Camera, Floats, Mask


def normals_from_gradient(
    p_u: Floats, p_v: Floats, camera: Camera, rows: slice = ALL
) -> tuple[Floats, Floats]:
    """Unit normals (H, W, 3) facing the camera, and |m| (H, W), from the gradient of log depth.

    rows : those of the camera's image that the gradient has

    >>> camera = Camera(1, 1, fx=10.0, fy=10.0, cx=0.0, cy=0.0)
    >>> n, length = normals_from_gradient(np.zeros((1, 1)), np.zeros((1, 1)), camera)
    >>> n[0, 0].tolist(), float(length[0, 0])
    ([0.0, 0.0, -1.0], 1.0)
    """
    x, y = pixel_rays(camera, rows)
    m = np.stack([camera.fx * p_u, camera.fy * p_v, -(1 + x * p_u + y * p_v)], axis=-1)
    length = normal_lengths(p_u, p_v, camera, rows)
    return m / length[..., None], length


def normal_lengths(p_u: Floats, p_v: Floats, camera: Camera, rows: slice = ALL) -> Floats:
    """|m| (H, W) before it is normalised, from the gradient of log depth.

    >>> camera = Camera(1, 1, fx=3.0, fy=10.0, cx=0.0, cy=0.0)
    >>> normal_lengths(np.full((1, 1), 0.25), np.zeros((1, 1)), camera).tolist()
    [[1.25]]
    """
    x, y = pixel_rays(camera, rows)
    squares = (camera.fx * p_u) ** 2 + (camera.fy * p_v) ** 2 + (1 + x * p_u + y * p_v) ** 2
    return np.asarray(np.sqrt(squares))


def squared_normal_derivative(length: Floats, camera: Camera) -> Floats:
    """(...) squared norm of dn/dg: angle^2 of a normal over |d|^2 of a gradient's change, radians.

    length : (...) |m|.  About (f / |m|)^2 in every direction; less along the slant of a normal that
    is seen obliquely.

    >>> camera = Camera(1, 1, fx=10.0, fy=10.0, cx=0.0, cy=0.0)
    >>> squared_normal_derivative(np.array([1.0, 2.0]), camera).tolist()
    [100.0, 25.0]
    """
    return camera.fx * camera.fy / length**2


def normal_derivatives(normals: Floats, length: Floats, camera: Camera) -> tuple[Floats, Floats]:
    """dn/dp_u and dn/dp_v, each (H, W, 3), at `normals` with |m| = `length`.

    >>> camera = Camera(1, 1, fx=10.0, fy=10.0, cx=0.0, cy=0.0)
    >>> n, length = normals_from_gradient(np.zeros((1, 1)), np.zeros((1, 1)), camera)
    >>> normal_derivatives(n, length, camera)[0][0, 0].tolist()
    [10.0, 0.0, 0.0]
    """
    derivatives = []
    for direction in gradient_directions(camera):
        along = np.sum(normals * direction, axis=-1, keepdims=True)
        derivatives.append((direction - along * normals) / length[..., None])
    return derivatives[0], derivatives[1]


def gradient_directions(camera: Camera) -> tuple[Floats, Floats]:
    """dm/dp_u = (fx, 0, -x) and dm/dp_v = (0, fy, -y), each (H, W, 3)."""
    x, y = pixel_rays(camera)
    u = np.zeros((*camera.shape, 3))
    v = np.zeros((*camera.shape, 3))
    u[..., 0], u[..., 2] = camera.fx, -x
    v[..., 1], v[..., 2] = camera.fy, -y
    return u, v


def normals_from_depth(depth_m: Floats, mask: Mask, camera: Camera) -> Floats:
    """Unit normals (H, W, 3) of a depth map (H, W) in metres; NaN outside the mask.

    A pixel without a neighbour along one axis gets the normal of a surface that does not slope
    along it (zero gradient of log depth).

    >>> camera = Camera(4, 3, fx=10.0, fy=10.0, cx=1.5, cy=1.0)
    >>> n = normals_from_depth(np.full((3, 4), 2.0), np.ones((3, 4), bool), camera)
    >>> n[1, 1].tolist()
    [0.0, 0.0, -1.0]
    """
    log_depth = np.log(np.where(mask, depth_m, 1.0).astype(np.float64))
    normals, _ = normals_from_gradient(*mean_gradient(log_depth, mask), camera)
    normals[~mask] = np.nan
    return normals


def surface_normals(depth_m: Floats, mask: Mask, camera: Camera) -> Floats:
    """`normals_from_depth` without differences across depth jumps (`grid.surface_links`).

    >>> camera = Camera(4, 2, fx=10.0, fy=10.0, cx=1.5, cy=0.5)
    >>> step = np.array([[1.0, 1.0, 3.0, 3.0]] * 2)
    >>> surface_normals(step, np.ones((2, 4), bool), camera)[..., 2].tolist()
    [[-1.0, -1.0, -1.0, -1.0], [-1.0, -1.0, -1.0, -1.0]]
    """
    log_depth = np.log(np.where(mask, depth_m, 1.0).astype(np.float64))
    links = surface_links(depth_m, mask, camera)
    gradient = []
    for axis, cut, whole in zip(
        (1, 0), mean_gradient(log_depth, links), mean_gradient(log_depth, mask), strict=True
    ):
        # A pixel between two jumps is linked to neither side: better across one than not at all.
        gradient.append(np.where(np.logical_or(*neighbours(links, axis)), cut, whole))
    normals, _ = normals_from_gradient(gradient[0], gradient[1], camera)
    normals[~mask] = np.nan
    return normals


def towards_camera(normals: Floats, camera: Camera) -> Floats:
    """(h, w) -n . r of normals (h, w, 3) and rays r = (x/fx, y/fy, 1); below 0 it looks away.

    That is 1 / |m| of the normal m before it is normalised.
    """
    x, y = pixel_rays(camera)
    n_x, n_y, n_z = np.moveaxis(normals, -1, 0)
    return np.asarray(-(n_x * x / camera.fx + n_y * y / camera.fy + n_z))
