"""Depth of a camera of its own, as the colour camera would have measured it."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.camera import back_project, require_ideal
from rakelight.geometry.distortion import to_rays
from rakelight.geometry.grid import Links, mean_gradient, surface_links
from rakelight.model import Array, Camera, Floats, RigidTransform

# Largest difference, pixel widths, of a border's tangent plane and triangles of the same surface.
SAME_SURFACE_PX = 4.0
# Least distance from the camera, metres, and largest extent, pixels, of a triangle that is drawn.
NEAREST_M, LARGEST_PX = 0.01, 16


def sensor_grid(colour: Camera, depth: Camera) -> Camera:
    """The colour camera's view in pixels as wide as the depth camera's, as nearly as they fit.

    Its pixels cover the colour image exactly, a whole number along each side: each is
    colour.width / grid.width of the colour camera's wide, rarely a whole number.

    >>> colour = Camera(1280, 720, fx=920.0, fy=920.0, cx=639.5, cy=359.5)
    >>> depth = Camera(640, 480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)
    >>> grid = sensor_grid(colour, depth)
    >>> grid.width, grid.height, round(grid.fx, 2)
    (730, 411, 524.69)
    """
    width = max(round(colour.width * depth.fx / colour.fx), 1)
    height = max(round(colour.height * depth.fy / colour.fy), 1)
    return colour.resized(width, height)


def register(
    depth_m: Floats, sigma_m: Floats, camera: Camera, pose: RigidTransform, target: Camera
) -> tuple[Floats, Floats]:
    """Depth and its noise (h', w'), metres, at the pixel centres of another camera.

    depth_m, sigma_m : (h, w) of `camera`, NaN = no measurement; its points are found along the
        undistorted rays, where the camera's lens distorts
    pose : from `camera` to `target`
    target : the camera that is to see it

    What is measured is taken for triangles between neighbours on one surface (see
    `surface_links`) and half a pixel more where a surface ends; the nearest triangle wins.  Where
    no triangle is, nothing is: neither what a near surface hid from the depth camera, nor
    anything across a jump.

    >>> camera = Camera(4, 3, fx=4.0, fy=4.0, cx=1.5, cy=1.0)
    >>> depth = np.full((3, 4), 2.0)
    >>> right = RigidTransform(np.eye(3), np.array([0.5, 0.0, 0.0]))  # one pixel at this depth
    >>> register(depth, 0.01 * depth, camera, right, camera)[0].tolist()[0]
    [nan, 2.0, 2.0, 2.0]
    """
    measured = np.isfinite(depth_m)
    links = surface_links(depth_m, measured, camera)
    points = project(back_project(depth_m, camera), pose, target)
    nearest = _Nearest(target)
    nearest.draw(*_triangles(points, sigma_m, links))
    seen = nearest.depth_m.copy()
    nearest.draw(*_borders(depth_m, sigma_m, camera, links, pose, target), behind_m=seen)
    return nearest.depth_m, nearest.sigma_m


def project(points: Floats, pose: RigidTransform, target: Camera) -> Floats:
    """(..., 3) pixel coordinates u, v and depth z in `target` of points (..., 3), metres.

    pose : from the points' frame to that of `target`; NaN behind it and within a centimetre
    target : without lens distortion, InputError otherwise

    >>> camera = Camera(3, 3, fx=10.0, fy=10.0, cx=1.0, cy=1.0)
    >>> ahead = RigidTransform(np.eye(3), np.array([0.0, 0.0, 1.0]))
    >>> project(np.array([[0.2, 0.0, 1.0], [0.0, 0.0, -2.0]]), ahead, camera).tolist()
    [[2.0, 1.0, 2.0], [nan, nan, nan]]
    """
    require_ideal(target)
    moved = points @ pose.rotation.T + pose.translation_m
    z = np.where(moved[..., 2] > NEAREST_M, moved[..., 2], np.nan)
    u = target.fx * moved[..., 0] / z + target.cx
    v = target.fy * moved[..., 1] / z + target.cy
    return np.stack([u, v, z], axis=-1)


def _triangles(points: Floats, sigma_m: Floats, links: Links) -> tuple[Floats, Floats]:
    """Corners (T, 3, 3) and their noise (T, 3): three neighbours in a square, linked in a row."""
    top, bottom = links.right[:-1, :-1], links.right[1:, :-1]
    left, right = links.down[:-1, :-1], links.down[:-1, 1:]
    height, width = links.mask.shape
    number = np.arange(height * width).reshape(height, width)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    whole = top & bottom & left & right
    # A whole square is split along one diagonal; else the corner is where two links meet.
    corners = np.concatenate(
        [
            np.stack([one[use], two[use], three[use]], axis=-1)
            for one, two, three, use in (
                (b, a, c, top & left),
                (b, d, c, bottom & right),
                (a, b, d, top & right & ~whole),
                (a, c, d, left & bottom & ~whole),
            )
        ]
    )
    return points.reshape(-1, 3)[corners], sigma_m.ravel()[corners]


def _borders(
    depth_m: Floats,
    sigma_m: Floats,
    camera: Camera,
    links: Links,
    pose: RigidTransform,
    target: Camera,
) -> tuple[Floats, Floats]:
    """The pixels that miss a link, each as two triangles in its tangent plane."""
    rows, columns = np.nonzero(links.mask & ~links.inner)
    # Planes are linear in inverse depth.
    inverse = np.where(links.mask, 1 / depth_m, 0.0)
    slope_u, slope_v = (slope[rows, columns] for slope in mean_gradient(inverse, links))
    corners = []
    for dv, du in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
        at = inverse[rows, columns] + du * slope_u + dv * slope_v
        z = 1 / np.maximum(at, 0.5 * inverse[rows, columns])
        x, y = to_rays(columns + du, rows + dv, camera)
        corners.append(project(np.stack([z * x, z * y, z], axis=-1), pose, target))
    a, b, c, d = corners
    triangles = np.concatenate([np.stack([b, a, c], axis=1), np.stack([b, d, c], axis=1)])
    noise = np.tile(sigma_m[rows, columns], 2)
    return triangles, np.repeat(noise[:, None], 3, axis=1)


class _Nearest:
    """The nearest of many triangles at every pixel centre of a camera."""

    def __init__(self, camera: Camera) -> None:
        self.camera = camera
        self.depth_m: Floats = np.full(camera.shape, np.nan)
        self.sigma_m: Floats = np.full(camera.shape, np.nan)

    def draw(self, corners: Floats, noise: Floats, behind_m: Floats | None = None) -> None:
        """Draw triangles, corners (T, 3, 3) as u, v, z and their noise (T, 3).

        behind_m : (h, w) a surface with which these triangles are one where they lie within a few
            pixel widths of it, so that there they are left out
        """
        finite = np.isfinite(corners).all(axis=(1, 2))
        corners, noise = corners[finite], noise[finite]
        low = np.ceil(corners[..., :2].min(axis=1)).astype(int)
        high = np.floor(corners[..., :2].max(axis=1)).astype(int)
        size = np.array([self.camera.width, self.camera.height])
        low, high = np.maximum(low, 0), np.minimum(high, size - 1)
        extent = high - low + 1
        small = ((extent > 0) & (extent <= LARGEST_PX)).all(axis=1)
        corners, noise, low, extent = corners[small], noise[small], low[small], extent[small]
        edges = _edge_functions(corners)
        found: list[tuple[Array, Floats, Floats]] = []
        for dv in range(int(extent[:, 1].max(initial=0))):
            for du in range(int(extent[:, 0].max(initial=0))):
                use = np.flatnonzero((extent[:, 0] > du) & (extent[:, 1] > dv))
                found.append(self._covered(corners, noise, low, edges, use, (du, dv)))
        if found:
            pixel, z, shared = (np.concatenate(part) for part in zip(*found, strict=True))
            self._keep_nearest(pixel, z, shared, behind_m)

    def _covered(
        self,
        corners: Floats,
        noise: Floats,
        low: Array,
        edges: Floats,
        use: Array,
        offset: tuple[int, int],
    ) -> tuple[Array, Floats, Floats]:
        """Pixel numbers, depth and noise where triangles cover the pixel `offset` from `low`."""
        place = low[use] + offset
        at = np.column_stack([place, np.ones(len(use))])
        shares = np.einsum("tij,tj->ti", edges[use], at)
        inside = (shares >= -1e-9).all(axis=1)
        use, place, shares = use[inside], place[inside], shares[inside]
        # Inverse depth is linear on the picture of a triangle.
        z = 1 / (shares / corners[use, :, 2]).sum(axis=1)
        return place[:, 1] * self.camera.width + place[:, 0], z, (shares * noise[use]).sum(axis=1)

    def _keep_nearest(
        self, pixel: Array, z: Floats, noise: Floats, behind_m: Floats | None
    ) -> None:
        if behind_m is not None:
            there = behind_m.ravel()[pixel]
            close = SAME_SURFACE_PX * there / min(self.camera.fx, self.camera.fy)
            fresh = ~(np.abs(there - z) <= close)
            pixel, z, noise = pixel[fresh], z[fresh], noise[fresh]
        order = np.lexsort((z, pixel))
        pixel, z, noise = pixel[order], z[order], noise[order]
        first = np.ones(len(pixel), dtype=bool)
        first[1:] = pixel[1:] != pixel[:-1]
        pixel, z, noise = pixel[first], z[first], noise[first]
        nearer = ~(z >= self.depth_m.ravel()[pixel])
        self.depth_m.flat[pixel[nearer]] = z[nearer]
        self.sigma_m.flat[pixel[nearer]] = noise[nearer]


def _edge_functions(corners: Floats) -> Floats:
    """(T, 3, 3) maps from (u, v, 1) to the shares of a triangle's corners; NaN for slivers."""
    (ax, ay), (bx, by), (cx, cy) = (corners[:, i, :2].T for i in range(3))
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    area = np.where(np.abs(area) > 1e-12, area, np.nan)
    rows = [
        np.stack([py - qy, qx - px, px * qy - qx * py], axis=-1)
        for (px, py), (qx, qy) in (((bx, by), (cx, cy)), ((cx, cy), (ax, ay)), ((ax, ay), (bx, by)))
    ]
    return np.stack(rows, axis=1) / area[:, None, None]
