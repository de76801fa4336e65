"""Light on materials: what reaches a camera from a finely sampled surface.

Lights near or distant, matte, rough (Oren and Nayar 1994) and shiny (Blinn-Phong) materials, cast
shadows, and one bounce of light between surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import area_mean
from rakelight.model import Camera, Floats, Lights, Mask
from rakelight.photometry.cast_shadows import in_sight
from rakelight.synthetic.implicit import Surface

DISTANT_M = 100.0
"""How far shadows of distant lights are followed."""
BOUNCE_PX = 8
"""Side of the cells that light each other, pixels."""


@dataclass(frozen=True)
class LightSources:
    """The lights of N photographs: L each, 1 or, one for each channel, 3.

    toward : (N, L, 3) unit vectors from the object's middle
    gain : (N, 3) brightness in each channel, at the object's middle
    ambient : (N, 3) light from everywhere
    window : (3,) unit vector towards a window times the share of the ambient light that it is; that
        falls on a surface as 2 max(0, cosine), in no cast shadow.  0 for none
    middle_m : (3,) the object's middle
    distance_m : (N, L) of the lights from there; None for distant ones
    """

    toward: Floats
    gain: Floats
    ambient: Floats
    middle_m: Floats
    distance_m: Floats | None = None
    window: Floats = field(default_factory=lambda: np.zeros(3))

    def around(self, normals: Floats) -> Floats:
        """(M, 1) ambient light on unit normals (M, 3), over that from everywhere alone."""
        share = float(np.linalg.norm(self.window))
        return np.asarray(1 - share + 2 * np.maximum(normals @ self.window[:, None], 0))

    def reaching(self, points_m: Floats, photograph: int, lamp: int) -> tuple[Floats, Floats]:
        """Unit vectors (M, 3) or (1, 3) from points to a lamp, and its strength there (M,)."""
        toward = self.toward[photograph, lamp]
        if self.distance_m is None:
            return toward[None].astype(points_m.dtype), np.ones(1, points_m.dtype)
        distance_m = self.distance_m[photograph, lamp]
        way = (self.middle_m + distance_m * toward).astype(points_m.dtype) - points_m
        length = np.sqrt(np.einsum("mi,mi->m", way, way))
        return way / length[:, None], (distance_m / length) ** 2

    def way(self, points_m: Floats, photograph: int, lamp: int) -> Floats:
        """(M, 3) from the points to the lamp; far enough for a distant one."""
        toward = self.toward[photograph, lamp]
        if self.distance_m is None:
            return np.broadcast_to(DISTANT_M * toward, points_m.shape)
        return np.asarray(self.middle_m + self.distance_m[photograph, lamp] * toward - points_m)

    def as_lights(self, level: float) -> Lights:
        """Of photographs whose light was multiplied by `level`; white lights have one channel."""
        toward, gain = self.toward, level * self.gain
        white = toward.shape[1] == 1 and bool((gain == gain[:, :1]).all())
        channels = 1 if white else 3
        shape = (len(gain), channels, 3)
        vector = gain[:, :channels, None] * np.broadcast_to(toward, shape)
        ambient = level * self.ambient[:, :channels]
        if self.distance_m is None:
            return Lights(vector, ambient)
        position = self.middle_m + self.distance_m[..., None] * toward
        return Lights(vector, ambient, np.broadcast_to(position, shape).copy(), self.middle_m)


@dataclass(frozen=True)
class Materials:
    """How samples of the surface send light back.

    albedo : (M, 3) linear
    roughness : (M,) standard deviation of the facets' slant, radians (Oren-Nayar); 0 is matte
    gloss : (M,) height of the highlight as a fraction of white's brightness
    exponent : of the highlight; the larger, the smaller it is
    """

    albedo: Floats
    roughness: Floats
    gloss: Floats
    exponent: float


def photographed(
    surface: Surface,
    camera: Camera,
    rays: int,
    near: Mask,
    materials: Materials,
    lights: LightSources,
    *,
    cast_shadows: bool,
    bounce: bool,
) -> Floats:
    """(N, H, W, 3) float32 linear light, averaged over rays x rays samples per pixel.

    surface, camera : the samples'
    near : (H rays, W rays) the samples that are rendered; `materials` has theirs, in row order

    Cast shadows are those of the surface at one sample per pixel.  Light between surfaces is that
    of cells of `BOUNCE_PX` pixels, none of which hides another.
    """
    hit = np.flatnonzero(near)
    # single precision: angles to a millionth, twice as fast
    points = back_project(surface.depth, camera).reshape(-1, 3)[hit].astype(np.float32)
    normals = surface.normals.reshape(-1, 3)[hit].astype(np.float32)
    to_camera = -points / np.linalg.norm(points, axis=1, keepdims=True)
    exchange = _Exchange(near, points, normals, camera, rays) if bounce else None
    screen = _Screen(surface.depth, near, camera, rays) if cast_shadows else None
    around = lights.around(normals).astype(np.float32)
    count, kinds = lights.toward.shape[:2]
    images = np.empty((count, camera.height // rays, camera.width // rays, 3), np.float32)
    for i in range(count):
        shading, specular = np.empty_like(materials.albedo), np.empty_like(materials.albedo)
        for k in range(kinds):
            toward, strength = lights.reaching(points, i, k)
            lit, highlight = _reflected(normals, to_camera, toward, materials)
            if screen is not None:
                strength = strength * screen.seen(lights, i, k)
            channels = slice(None) if kinds == 1 else slice(k, k + 1)
            shading[:, channels] = (lit * strength)[:, None]
            specular[:, channels] = (highlight * strength)[:, None]
        gain = np.float32(lights.gain[i])
        light = materials.albedo * (gain * shading + around * np.float32(lights.ambient[i]))
        light += gain * specular
        if exchange is not None:
            light += materials.albedo * exchange.received(light)
        full = np.zeros((near.size, 3), np.float32)
        full[hit] = light
        images[i] = area_mean(full.reshape(*near.shape, 3), rays)
    return images


def _reflected(
    normals: Floats, to_camera: Floats, toward: Floats, materials: Materials
) -> tuple[Floats, Floats]:
    """(M,) what a sample of albedo 1 sends to the camera under a lamp of strength 1; its highlight.

    Oren and Nayar in the form of Fujii (2012): cos (A + B s / t), and of Blinn and Phong.
    """
    cosine = np.einsum("mi,mi->m", normals, np.broadcast_to(toward, normals.shape))
    lit = np.maximum(cosine, 0)
    if materials.roughness.any():
        slant = materials.roughness**2
        facing = np.maximum(np.einsum("mi,mi->m", normals, to_camera), 0)
        s = np.einsum("mi,mi->m", np.broadcast_to(toward, normals.shape), to_camera) - lit * facing
        t = np.where(s > 0, np.maximum(np.maximum(lit, facing), 1e-6), 1)
        a, b = 1 - 0.5 * slant / (slant + 0.33), 0.45 * slant / (slant + 0.09)
        shading = lit * np.maximum(a + b * s / t, 0)
    else:
        shading = lit
    if not materials.gloss.any():
        return shading, np.zeros_like(shading)
    halfway = toward + to_camera
    halfway /= np.sqrt(np.einsum("mi,mi->m", halfway, halfway))[:, None]
    peak = np.maximum(np.einsum("mi,mi->m", normals, halfway), 0) ** materials.exponent
    return shading, np.where(lit > 0, materials.gloss * peak, 0)


class _Screen:
    """What the surface hides from lights, at one sample per pixel, spread over the finer ones."""

    def __init__(self, depth: Floats, near: Mask, camera: Camera, rays: int) -> None:
        self.near, self.camera = near, camera.scaled(1 / rays)
        finite = np.isfinite(depth)
        count = area_mean(finite, rays)
        total = area_mean(np.where(finite, depth, 0.0), rays)
        self.depth = np.where(count > 0, total / np.maximum(count, 1e-9), np.nan)
        self.inside = np.isfinite(self.depth)
        self.points = back_project(self.depth, self.camera)[self.inside]

    def seen(self, lights: LightSources, photograph: int, lamp: int) -> Floats:
        """(M,) 0 to 1: the fraction of a lamp that each near sample sees; edges are 1 px wide."""
        import cv2

        free = np.ones(self.inside.shape, np.float32)
        way = lights.way(self.points, photograph, lamp)
        free[self.inside] = in_sight(self.depth, self.camera, self.points, way)
        size = self.near.shape[::-1]
        finer = cv2.resize(free, size, interpolation=cv2.INTER_LINEAR)
        return np.asarray(finer[self.near])


class _Exchange:
    """One bounce of light between cells of the surface."""

    def __init__(
        self, near: Mask, points: Floats, normals: Floats, camera: Camera, rays: int
    ) -> None:
        from scipy.ndimage import distance_transform_edt

        self.near = near
        side = BOUNCE_PX * rays
        self.cells = tuple(-(-edge // side) for edge in near.shape)
        row, column = np.nonzero(near)
        self.cell = row // side * self.cells[1] + column // side
        # a sample's area: its pixel's, over the cosine at which it is seen
        ray = points / points[:, 2:]
        slant = np.maximum(-np.einsum("mi,mi->m", normals, ray), 0.1)
        self.area = points[:, 2] ** 2 / (camera.fx * camera.fy * slant)
        count = np.prod(self.cells)
        self.total = np.bincount(self.cell, self.area, count)
        empty = (self.total == 0).reshape(self.cells)
        self.nearest = tuple(
            distance_transform_edt(empty, return_distances=False, return_indices=True)
        )
        middle, facing = self._means(points), self._means(normals)
        facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-9)
        way = middle[None] - middle[:, None]
        distance2 = np.maximum(np.einsum("ijk,ijk->ij", way, way), self.total[None] / np.pi)
        out = np.maximum(np.einsum("ijk,ik->ij", way, facing), 0)
        into = np.maximum(-np.einsum("ijk,jk->ij", way, facing), 0)
        factors = out * into / (np.pi * np.maximum(distance2, 1e-12) ** 2) * self.total[None]
        np.fill_diagonal(factors, 0)
        self.factors = factors / np.maximum(factors.sum(axis=1, keepdims=True), 1)

    def _means(self, values: Floats) -> Floats:
        """(cells, 3) means of (M, 3) over the area of each cell."""
        sums = [np.bincount(self.cell, self.area * each, self.total.size) for each in values.T]
        return np.stack(sums, axis=-1) / np.maximum(self.total, 1e-30)[:, None]

    def received(self, light: Floats) -> Floats:
        """(M, 3) light that reaches the samples from the others, which send out `light` (M, 3)."""
        import cv2

        grid = (self.factors @ self._means(light)).reshape(*self.cells, 3).astype(np.float32)
        grid = grid[self.nearest]
        size = self.near.shape[::-1]
        return np.asarray(cv2.resize(grid, size, interpolation=cv2.INTER_LINEAR)[self.near])
