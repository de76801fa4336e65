"""Reliefs that the solids lack: folds, jumps, thin parts, rough stone; each drawn by a seed.

They are height fields over the image, with exact slopes, and can be seen from one place only.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import numpy as np

from rakelight.errors import InputError
from rakelight.geometry.camera import ALL, pixel_rays
from rakelight.geometry.normals import normals_from_gradient
from rakelight.model import Camera, Floats, Mask
from rakelight.synthetic.depth_file import shape_from_depth
from rakelight.synthetic.implicit import COMPLEX_STEP, Surface, Values
from rakelight.synthetic.shapes import Shape

VIEW = Camera(width=240, height=240, fx=900.0, fy=900.0, cx=119.5, cy=119.5)
"""The camera that the reliefs are made for."""
DISTANCE_M = 0.8
UNIT_PX = 120.0
"""Half the image's height, the reliefs' unit of length."""

Relief: TypeAlias = Callable[[Values, Values, np.random.Generator], tuple[Values, Mask]]
"""(x, y, rng) -> height towards the camera and where the object is; x to the right, y down.

Analytic but for jumps, which may depend on real parts only: slopes are taken by the complex step.
"""


def make_relief(name: str, seed: int = 0) -> Shape:
    """The relief of that name, one of `RELIEFS`; `seed` draws its form.

    Raises InputError for another name.

    >>> surface = make_relief("ring").render(VIEW.scaled(0.1))
    >>> bool(surface.mask[12, 1]), bool(surface.mask[0, 0])
    (True, False)
    """
    if name == "stone":
        return _stone(seed)
    if name not in _FUNCTIONS:
        raise InputError(
            "no such relief", source="relief", seen=name, needed="one of " + ", ".join(RELIEFS)
        )
    return Shape(name, VIEW, partial(_render, _FUNCTIONS[name], seed))


def _render(relief: Relief, seed: int, camera: Camera, rows: slice = ALL) -> Surface:
    zoom = camera.fx / VIEW.fx
    x, y = (np.asarray(ray) / (zoom * UNIT_PX) for ray in pixel_rays(camera, rows))
    x, y = np.broadcast_arrays(x, y)
    along_x, inside = relief(x + 1j * COMPLEX_STEP, y, np.random.default_rng(seed))
    along_y, _ = relief(x, y + 1j * COMPLEX_STEP, np.random.default_rng(seed))
    unit_m = UNIT_PX * DISTANCE_M / VIEW.fx
    depth = np.where(inside, DISTANCE_M - unit_m * along_x.real, np.nan)
    per_pixel = -unit_m / (COMPLEX_STEP * zoom * UNIT_PX)
    normals, _ = normals_from_gradient(
        per_pixel * along_x.imag / depth, per_pixel * along_y.imag / depth, camera, rows
    )
    return Surface(depth, normals)


def _folds(x: Values, y: Values, rng: np.random.Generator) -> tuple[Values, Mask]:
    """A cloth: three fans of folds across each other, and fine creases."""
    height = 0.0 * (x + y)
    for _ in range(3):
        heading, wide, high = rng.uniform(0, np.pi), rng.uniform(4, 9), rng.uniform(0.06, 0.2)
        across, along = _turned(x, y, heading)
        bent = across + 0.15 * np.sin(3 * along + rng.uniform(0, 6))
        height = height + high * np.exp(1.5 * np.cos(wide * bent + rng.uniform(0, 6)) - 1.5)
    across, along = _turned(x, y, rng.uniform(0, np.pi))
    height = height + 0.006 * np.sin(35 * across + 4 * np.sin(5 * along))
    edge = np.maximum(np.abs(x + 0.05 * np.sin(4 * y)).real, np.abs(y + 0.04 * np.sin(5 * x)).real)
    return height, edge < 0.9


def _steps(x: Values, y: Values, rng: np.random.Generator) -> tuple[Values, Mask]:
    """Stairs of treads that lean each their own way, with vertical risers."""
    across, along = _turned(x, y, rng.uniform(0, np.pi))
    count = rng.integers(3, 7)
    tread = np.clip(np.floor((across.real + 1) * count / 2), 0, count - 1).astype(int)
    rises = rng.uniform(0.05, 0.25, count) * rng.choice([-1, 1], count)
    lean, aside = rng.uniform(-0.3, 0.3, (2, count))
    ripple = 0.008 * np.sin(rng.uniform(8, 20) * along + 3 * across)
    height = np.cumsum(rises)[tread] + lean[tread] * across + aside[tread] * along + ripple
    return height, (x**2 + y**2).real < 0.9


def _plates(x: Values, y: Values, rng: np.random.Generator) -> tuple[Values, Mask]:
    """A plate on a plate on a domed base; their walls are vertical."""
    height = -rng.uniform(0.05, 0.3) * (x**2 + y**2)
    for half in (0.62, 0.34):
        a, b = rng.uniform(-0.2, 0.2, 2)
        top = rng.uniform(0.06, 0.25) + rng.uniform(0.005, 0.02) * np.cos(
            rng.uniform(8, 16) * (x - a)
        ) * np.cos(rng.uniform(8, 16) * (y - b))
        lean = rng.uniform(-0.15, 0.15) * (x - a) + rng.uniform(-0.15, 0.15) * (y - b)
        covered = ((x - a) ** 4 + (y - b) ** 4).real < half**4
        height = height + np.where(covered, top + lean, 0)
    return height, np.maximum(np.abs(x.real), np.abs(y.real)) < 0.9


def _bars(x: Values, y: Values, rng: np.random.Generator) -> tuple[Values, Mask]:
    """A grille of round bars, one row before the other; one sees through between them."""
    across, along = _turned(x, y, rng.uniform(0, np.pi))
    rows = []
    for place, other in ((across, along), (along, across)):
        radius, spacing = rng.uniform(0.07, 0.13), rng.uniform(0.45, 0.7)
        off = place - spacing * np.round(place.real / spacing)
        on = (off**2).real < radius**2
        bow = rng.uniform(-0.15, 0.15) * other**2
        rows.append((np.sqrt(np.where(on, radius**2 - off**2, radius**2)) + bow, on))
    (front, on_front), (behind, on_behind) = rows
    height = np.where(on_front, front + rng.uniform(0.1, 0.5), behind)
    return height, (on_front | on_behind) & ((x**2 + y**2).real < 0.9)


def _ring(x: Values, y: Values, rng: np.random.Generator) -> tuple[Values, Mask]:
    """A leaning ring, and a ball in it."""
    radius, thick, ball = 0.72, rng.uniform(0.09, 0.2), rng.uniform(0.2, 0.4)
    from_middle = x**2 + y**2
    off = (np.sqrt(from_middle + 1e-9) - radius) ** 2
    on_ring, on_ball = off.real < thick**2, from_middle.real < ball**2
    lean = rng.uniform(-0.4, 0.4) * x + rng.uniform(-0.4, 0.4) * y
    ring = np.sqrt(np.where(on_ring, thick**2 - off, 1.0)) + lean
    bead = np.sqrt(np.where(on_ball, ball**2 - from_middle, 1.0)) + rng.uniform(-0.2, 0.2)
    return np.where(on_ring, ring, bead), on_ring | on_ball


def _turned(x: Values, y: Values, heading: float) -> tuple[Values, Values]:
    return np.cos(heading) * x + np.sin(heading) * y, np.cos(heading) * y - np.sin(heading) * x


_FUNCTIONS: dict[str, Relief] = {
    "folds": _folds,
    "steps": _steps,
    "plates": _plates,
    "bars": _bars,
    "ring": _ring,
}
RELIEFS = (*_FUNCTIONS, "stone")
"""The names of the reliefs."""


def _stone(seed: int) -> Shape:
    """A broken stone: a fractal surface (random waves whose height falls as a power) on a dome."""
    rng = np.random.default_rng(seed)
    side = VIEW.width
    number = np.hypot(np.fft.fftfreq(side)[:, None], np.fft.fftfreq(side)[None])
    number[0, 0] = np.inf
    # finer than three pixels there is nothing, so that the splines follow it
    roughness = np.where(number < 1 / 3, number ** -(1 + rng.uniform(0.7, 1.1)), 0)
    waves = np.fft.ifft2(roughness * np.fft.fft2(rng.standard_normal((side, side)))).real
    x, y = (np.asarray(ray) / UNIT_PX for ray in pixel_rays(VIEW))
    height = rng.uniform(0.05, 0.12) * waves / waves.std() - rng.uniform(0.1, 0.4) * (x**2 + y**2)
    angle = np.arctan2(y, x)
    outline = 0.85 + sum(
        0.12 / k * np.cos(k * angle + rng.uniform(0, 6)) * rng.uniform(0, 1) for k in (2, 3, 5)
    )
    depth: Floats = DISTANCE_M - UNIT_PX * DISTANCE_M / VIEW.fx * height
    return shape_from_depth("stone", np.where(np.hypot(x, y) < outline, depth, np.nan), VIEW)
