"""Exact depth and normals of surfaces that are given as a signed function of space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from rakelight.geometry.camera import ALL, pixel_rays
from rakelight.geometry.grid import row_strips
from rakelight.model import Camera, Floats, Mask, RigidTransform

Values: TypeAlias = npt.NDArray[np.inexact[Any]]
"""Real numbers, or complex ones that carry a derivative in their imaginary part."""

Field: TypeAlias = Callable[[Values, Values, Values], Values]
"""f(right, up, front), metres from the object's centre as the camera sees it; positive outside.

No steeper than `Solid.steepness` (metres per metre).  It must be analytic in the arithmetic it
uses, with comparisons of real parts only: derivatives are taken by the complex step,
f'(x) = Im f(x + ih) / h, which is exact to rounding for any small h (Squire & Trapp 1998).
"""


@dataclass(frozen=True)
class Surface:
    """What a camera sees of an object, at its pixel centres.

    depth : (H, W) metres along the optical axis, NaN where the ray misses
    normals : (H, W, 3) unit, camera frame, facing the camera, NaN where the ray misses
    """

    depth: Floats
    normals: Floats

    def cut(self, rows: slice) -> Surface:
        """These rows of it."""
        return Surface(self.depth[rows], self.normals[rows])

    @property
    def mask(self) -> Mask:
        """(H, W) True where the ray hits the object."""
        return np.isfinite(self.depth)


@dataclass(frozen=True, slots=True)
class Solid:
    """The inside of a field, in front of the camera.

    distance_m : from the camera to the object's centre, which is on the optical axis
    radius_m : of a sphere about the centre that holds the object
    steepness : bound of the field's gradient
    """

    field: Field
    distance_m: float
    radius_m: float
    steepness: float = 1.0

    def along(self, x: Values, y: Values, z: Values) -> Values:
        """The field at depth z on the rays z * (x, y, 1) of the camera frame."""
        return self.field(z * x, -z * y, self.distance_m - z)


def seen_from(solid: Solid, pose: RigidTransform) -> Solid:
    """A solid as another camera has it before itself.

    pose : from that camera's frame to the one that the solid is given in

    >>> ball = Solid(lambda x, y, z: np.sqrt(x**2 + y**2 + z**2) - 0.1, 0.8, 0.11)
    >>> right = RigidTransform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    >>> camera = Camera(1, 1, fx=7.0, fy=7.0, cx=0.5, cy=0.0)  # its pixel looks to the left
    >>> trace(seen_from(ball, right), camera).depth.round(9).tolist()
    [[0.7]]
    """

    def field(x: Values, y: Values, z: Values) -> Values:
        at = x, -y, solid.distance_m - z
        right, down, ahead = (
            sum(turn * value for turn, value in zip(row, at, strict=True)) + shift
            for row, shift in zip(pose.rotation, pose.translation_m, strict=True)
        )
        return solid.field(right, -down, solid.distance_m - ahead)

    centre = np.array([0.0, 0.0, solid.distance_m])
    moved = float(np.linalg.norm(pose.rotation.T @ (centre - pose.translation_m) - centre))
    return replace(solid, field=field, radius_m=solid.radius_m + moved)


MARCH_STEPS = 300
NEAR_M = 5e-5
"""Marching ends this close to the surface; the secant method takes over."""
GRAZING_STEP_M = 1e-4
SECANT_STEPS = 12
LONGEST_STEP_M = 5e-4
SETTLED_M2 = 1e-18
"""The secant method's error is the last two steps' product times at most about 1e4 / m."""
COMPLEX_STEP = 1e-30
TILES = (2, 4)
"""Rays march together until their cone meets the surface: in squares of 2 x 2, and before that
4 x 4 of these squares."""
BLOCK = 1 << 13
"""Rays at a time: their intermediate values stay in the processor's cache."""


def trace(solid: Solid, camera: Camera, rows: slice = ALL) -> Surface:
    """Depth and normals of a solid at every pixel centre of a camera, to rounding.

    rows : those of the image that are traced, with the same values whichever these are

    >>> ball = Solid(lambda x, y, z: np.sqrt(x**2 + y**2 + z**2) - 0.1, 0.8, 0.11)
    >>> surface = trace(ball, Camera(3, 1, fx=4.0, fy=4.0, cx=1.0, cy=0.0))
    >>> surface.depth.round(9).tolist(), surface.normals[0, 1, 2].item()
    ([[nan, 0.7, nan]], -1.0)
    """
    x, y = _rays(camera, rows)
    depth = first_hits(solid, camera, rows)
    normals = np.full((*x.shape, 3), np.nan)
    hit = np.flatnonzero(np.isfinite(depth))
    for block in row_strips(hit.size, BLOCK):
        at = hit[block]
        normals.reshape(-1, 3)[at] = _normals(solid, x.flat[at], y.flat[at], depth.flat[at])
    return Surface(depth, normals)


def first_hits(solid: Solid, camera: Camera, rows: slice = ALL) -> Floats:
    """(h, W) the depth of `trace` alone."""
    x, y = _rays(camera, rows)
    depth = _free_depths(solid, camera, rows, TILES)
    some = np.flatnonzero(np.isfinite(depth))
    depth.flat[some] = _first_hit(solid, x.flat[some], y.flat[some], depth.flat[some])
    return depth


def _rays(camera: Camera, rows: slice) -> tuple[Floats, Floats]:
    """x/z and y/z of every pixel of these rows, each (h, W)."""
    x, y = pixel_rays(camera, rows)
    x, y = np.broadcast_arrays(x / camera.fx, y / camera.fy)
    return x, y


def _free_depths(solid: Solid, camera: Camera, rows: slice, tiles: tuple[int, ...]) -> Floats:
    """(h, W) depths up to which rays run free; NaN where they miss for certain.

    tiles : pixels along each side of the squares that march together, then squares in these
    """
    top, bottom, _ = rows.indices(camera.height)
    if not tiles:
        return np.full((bottom - top, camera.width), solid.distance_m - solid.radius_m)
    side, first = tiles[0], top // tiles[0]
    width, height = -(-camera.width // side), -(-camera.height // side)
    coarse = replace(camera.scaled(1 / side), width=width, height=height)
    coarse_rows = slice(first, -(-bottom // side))
    z = _free_depths(solid, coarse, coarse_rows, tiles[1:])
    some = np.flatnonzero(np.isfinite(z))
    x, y = (axis.flat[some] for axis in _rays(coarse, coarse_rows))
    slope = float(np.hypot(0.5 / coarse.fx, 0.5 / coarse.fy))
    free, clear = _march(solid, x, y, z.flat[some], NEAR_M, slope=slope)
    z.flat[some] = np.where(clear < NEAR_M, free, np.nan)
    grown = z.repeat(side, axis=0).repeat(side, axis=1)
    return grown[top - first * side : bottom - first * side, : camera.width]


def _first_hit(solid: Solid, x: Floats, y: Floats, z: Floats) -> Floats:
    """Depth at which each ray enters the solid; NaN where it does not."""
    z, clear = _march(solid, x, y, z, NEAR_M)
    found = np.full(z.size, np.nan)
    met = np.flatnonzero(clear < NEAR_M)
    found[met] = _root(solid, x[met], y[met], z[met], clear[met])
    # rays that came near without a clear hit are followed in small steps until they are inside
    grazing = met[np.isnan(found[met])]
    x, y = x[grazing], y[grazing]
    z, clear = _march(solid, x, y, z[grazing], 0.0, least_step_m=GRAZING_STEP_M)
    inside = clear < 0
    found[grazing[inside]] = _root(solid, x[inside], y[inside], z[inside], clear[inside])
    return found


def _march(
    solid: Solid,
    x: Floats,
    y: Floats,
    z: Floats,
    near_m: float,
    *,
    slope: float = 0.0,
    least_step_m: float = 0.0,
) -> tuple[Floats, Floats]:
    """Sphere tracing from depth z on: where it ends, and how far off the surface is at the least.

    It ends where that is below `near_m`, or behind the solid.  With `slope` a whole cone of that
    slope about the ray stays outside.
    """
    z, clear = z.copy(), np.full(z.size, np.inf)
    length = np.sqrt(1 + x**2 + y**2)
    active = np.arange(z.size)
    for _ in range(MARCH_STEPS):
        at = z[active]
        left = _values(solid, x[active], y[active], at) / solid.steepness - slope * at
        clear[active] = left
        z[active] += np.where(left < near_m, 0, np.maximum(left / length[active], least_step_m))
        active = active[(left >= near_m) & (z[active] < solid.distance_m + solid.radius_m)]
        if not active.size:
            break
    return z, clear


def _root(solid: Solid, x: Floats, y: Floats, z: Floats, clear: Floats) -> Floats:
    """Roots of the field along the rays, by secants; NaN where the method does not come to rest.

    z, clear : of `_march`
    """
    found, active = np.full(z.size, np.nan), np.arange(z.size)
    value, step = clear * solid.steepness, clear / np.sqrt(1 + x**2 + y**2)
    for _ in range(SECANT_STEPS):
        z = z + step
        last, value = value, _values(solid, x, y, z)
        before = step
        with np.errstate(divide="ignore", invalid="ignore"):
            step = step * value / (last - value)
        step[(last == value) & (before**2 < SETTLED_M2)] = 0.0  # both are rounding
        step = np.clip(np.nan_to_num(step, nan=0.0), -LONGEST_STEP_M, LONGEST_STEP_M)
        rest = np.abs(step * before) < SETTLED_M2
        found[active[rest]] = z[rest] + step[rest]
        left = ~rest
        active, value, step = active[left], value[left], step[left]
        x, y, z = x[left], y[left], z[left]
        if not active.size:
            break
    return found


def _values(solid: Solid, x: Floats, y: Floats, z: Floats) -> Floats:
    """(M,) the field at these points of these rays."""
    values = np.empty(z.size)
    for block in row_strips(z.size, BLOCK):
        values[block] = solid.along(x[block], y[block], z[block])
    return values


def _normals(solid: Solid, x: Floats, y: Floats, z: Floats) -> Floats:
    """(M, 3) outward normals in the camera frame: the field's unit gradient."""
    point = z * x, -z * y, solid.distance_m - z
    slope = np.empty((z.size, 3))
    for axis, sign in enumerate((1, -1, -1)):  # the camera's y is down, its z away
        moved: list[Values] = list(point)
        moved[axis] = point[axis] + 1j * COMPLEX_STEP
        slope[:, axis] = sign * solid.field(*moved).imag / COMPLEX_STEP
    return np.asarray(slope / np.linalg.norm(slope, axis=1, keepdims=True))
