"""Exact depth and normals of surfaces that are given as a signed function of space."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from rakelight.geometry.camera import ALL, pixel_rays
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
"""Marching ends this close to the surface; Newton's method takes over."""
GRAZING_STEP_M = 1e-4
NEWTON_STEPS = 6
LONGEST_STEP_M = 5e-4
SETTLED_M = 1e-8
"""After a shorter step Newton's method, which squares the error, is exact to rounding."""
COMPLEX_STEP = 1e-30
TILE = 8
"""Rays that march together, along each side, until their cone meets the surface."""
BLOCK = 1 << 14
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
    start = _march_tiles(solid, camera, rows)
    depth = np.full(x.shape, np.nan)
    normals = np.full((*x.shape, 3), np.nan)
    candidates = np.flatnonzero(np.isfinite(start))
    for first in range(0, candidates.size, BLOCK):
        block = candidates[first : first + BLOCK]
        z = _first_hit(solid, x.flat[block], y.flat[block], start.flat[block])
        hit = block[np.isfinite(z)]
        depth.flat[hit] = z[np.isfinite(z)]
        normals.reshape(-1, 3)[hit] = _normals(solid, x.flat[hit], y.flat[hit], depth.flat[hit])
    return Surface(depth, normals)


def _rays(camera: Camera, rows: slice) -> tuple[Floats, Floats]:
    """x/z and y/z of every pixel of these rows, each (h, W)."""
    x, y = pixel_rays(camera, rows)
    x, y = np.broadcast_arrays(x / camera.fx, y / camera.fy)
    return x, y


def _march_tiles(solid: Solid, camera: Camera, rows: slice) -> Floats:
    """(h, W) depths up to which whole tiles of rays run free; NaN where they miss for certain."""
    tiles = replace(
        camera.scaled(1 / TILE), width=-(-camera.width // TILE), height=-(-camera.height // TILE)
    )
    slope = float(np.hypot(0.5 / tiles.fx, 0.5 / tiles.fy))
    top, bottom, _ = rows.indices(camera.height)
    first = top // TILE
    x, y = _rays(tiles, slice(first, -(-bottom // TILE)))
    shape, x, y = x.shape, x.ravel(), y.ravel()
    z = np.full(x.size, solid.distance_m - solid.radius_m)
    z, met = _march(solid, x, y, z, NEAR_M, slope=slope)
    z[~met] = np.nan
    grown = z.reshape(shape).repeat(TILE, axis=0).repeat(TILE, axis=1)
    return grown[top - first * TILE : bottom - first * TILE, : camera.width]


def _first_hit(solid: Solid, x: Floats, y: Floats, z: Floats) -> Floats:
    """Depth at which each ray enters the solid; NaN where it does not."""
    near, met = _march(solid, x, y, z, NEAR_M)
    found = np.full(z.size, np.nan)
    found[met] = _newton(solid, x[met], y[met], near[met])
    # rays that came near without a clear hit are followed in small steps until they are inside
    grazing = np.flatnonzero(met & np.isnan(found))
    x, y, near = x[grazing], y[grazing], near[grazing]
    inside, met = _march(solid, x, y, near, 0.0, least_step_m=GRAZING_STEP_M)
    found[grazing[met]] = _newton(solid, x[met], y[met], inside[met])
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
) -> tuple[Floats, Mask]:
    """Sphere tracing from depth z until the field is below `near_m`, and whether it came to be.

    With `slope` a whole cone of that slope about the ray stays outside.
    """
    z = z.copy()
    met = np.zeros(z.size, bool)
    length = np.sqrt(1 + x**2 + y**2)
    active = np.arange(z.size)
    for _ in range(MARCH_STEPS):
        at = z[active]
        clear = solid.along(x[active], y[active], at) / solid.steepness - slope * at
        met[active] = arrived = clear < near_m
        z[active] += np.where(arrived, 0, np.maximum(clear / length[active], least_step_m))
        active = active[~arrived & (z[active] < solid.distance_m + solid.radius_m)]
        if not active.size:
            break
    return z, met


def _newton(solid: Solid, x: Floats, y: Floats, z: Floats) -> Floats:
    """Roots of the field along the rays near z; NaN where the method does not come to rest."""
    z = z.copy()
    active = np.arange(z.size)
    for _ in range(NEWTON_STEPS):
        value = solid.along(x[active], y[active], z[active] + 1j * COMPLEX_STEP)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = value.real * COMPLEX_STEP / value.imag
        step = np.clip(np.nan_to_num(step, nan=np.inf), -LONGEST_STEP_M, LONGEST_STEP_M)
        z[active] -= step
        active = active[np.abs(step) >= SETTLED_M]
        if not active.size:
            break
    z[active] = np.nan
    return z


def _normals(solid: Solid, x: Floats, y: Floats, z: Floats) -> Floats:
    """(M, 3) outward normals in the camera frame: the field's unit gradient."""
    point = np.stack([z * x, -z * y, solid.distance_m - z])
    slope = np.empty((z.size, 3))
    for axis, sign in enumerate((1, -1, -1)):  # the camera's y is down, its z away
        moved = point.astype(complex)
        moved[axis] += 1j * COMPLEX_STEP
        slope[:, axis] = sign * solid.field(*moved).imag / COMPLEX_STEP
    return np.asarray(slope / np.linalg.norm(slope, axis=1, keepdims=True))
