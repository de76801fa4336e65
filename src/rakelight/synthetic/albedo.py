"""What the objects are painted with: linear reflectance as a function of the image position.

The paint is projected onto the object from the camera, like a slide.  Its details have a size in
the image, whatever the slant of the surface, so that two samples per pixel do not alias.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from os import PathLike
from pathlib import Path
from threading import Lock
from typing import TypeVar

import numpy as np

from rakelight.errors import InputError
from rakelight.files import read_bytes
from rakelight.geometry.camera import ALL
from rakelight.geometry.grid import row_strips
from rakelight.model import Camera, Floats

T = TypeVar("T")

DARKEST = 0.1
"""The least reflectance of the patterns: even a blue area sends back some red."""


@dataclass(frozen=True)
class Albedo:
    """The paint: paint(camera, rows), linear reflectance (h, W, 3) in 0..1 of a camera's pixels.

    Of these rows of the image; of all, (H, W, 3), where none are named.
    """

    name: str
    paint: Callable[..., Floats]


def make_albedo(name: str, seed: int = 0) -> Albedo:
    """The paint of that name: one of `ALBEDOS`; `seed` chooses among its kind.

    Raises InputError for another name.

    >>> make_albedo("grey").paint(Camera(4, 3, 1.0, 1.0, 0.0, 0.0))[0, 0].tolist()
    [0.5, 0.5, 0.5]
    """
    if name not in ALBEDOS:
        raise InputError(
            "no such albedo", source="albedo", seen=name, needed="one of " + ", ".join(ALBEDOS)
        )
    return Albedo(name, partial(_paint, ALBEDOS[name], seed))


def texture_from_file(path: str | PathLike[str]) -> Albedo:
    """A photograph (PNG, TIFF, JPEG; 8-bit ones are taken as sRGB) that covers the whole view.

    Its brightness is kept above 0.02, for black paint tells nothing.  Raises InputError and
    MachineError when it cannot be read.
    """
    from rakelight.capture.images import as_rgb, decode_image
    from rakelight.prepare.linear import to_linear

    source = str(path)
    pixels = as_rgb(decode_image(read_bytes(Path(path)), source))
    if pixels.dtype.kind == "f":
        texture = np.nan_to_num(pixels).astype(np.float32)
    elif pixels.dtype in (np.uint8, np.uint16):
        texture = to_linear(pixels, "srgb" if pixels.dtype == np.uint8 else "linear")
    else:
        raise InputError(
            "not a texture", source=source, seen=f"{pixels.dtype}", needed="8, 16 bit or float"
        )
    whole = made_once(partial(_cover, np.clip(texture, 0.02, 1.0)))
    return Albedo(Path(path).stem, lambda camera, rows=ALL: whole(camera)[rows])


def made_once(function: Callable[[Camera], T], cameras: int = 1) -> Callable[[Camera], T]:
    """What a function makes of the last few cameras, kept: for what cannot be made in strips.

    >>> rooms = made_once(lambda camera: [camera.width])
    >>> rooms(Camera(4, 3, 1.0, 1.0, 0.0, 0.0)) is rooms(Camera(4, 3, 1.0, 1.0, 0.0, 0.0))
    True
    """
    made, at_work = lru_cache(maxsize=cameras)(function), Lock()

    def once(camera: Camera) -> T:
        with at_work:  # a second strip waits for the first
            return made(camera)

    return once


def _cover(texture: Floats, camera: Camera) -> Floats:
    """The middle of the texture, as large as fits, at the camera's resolution."""
    import cv2

    height, width = texture.shape[:2]
    scale = min(height / camera.height, width / camera.width)
    rows, columns = max(1, round(camera.height * scale)), max(1, round(camera.width * scale))
    top, left = (height - rows) // 2, (width - columns) // 2
    window = np.ascontiguousarray(texture[top : top + rows, left : left + columns])
    method = cv2.INTER_AREA if scale > 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (camera.width, camera.height), interpolation=method))


# ---- patterns: (x, y) in image heights from the middle -> reflectance (..., 3)


Pattern = Callable[[Floats, Floats, np.random.Generator], Floats]

BLOCK = 1 << 15
"""Pixels at a time: their intermediate values stay in the processor's cache."""


def _paint(pattern: Pattern, seed: int, camera: Camera, rows: slice = ALL) -> Floats:
    u, v = np.arange(camera.width), np.arange(camera.height)[rows]
    x = (u[None, :] + 0.5 - camera.width / 2) / camera.height
    y = (v[:, None] + 0.5 - camera.height / 2) / camera.height
    x, y = np.broadcast_arrays(x, y)
    paint = np.empty((*x.shape, 3), np.float32)
    for block in row_strips(v.size, max(BLOCK // camera.width, 1)):
        paint[block] = pattern(x[block], y[block], np.random.default_rng(seed))
    return paint


def _white(x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    return np.full((*x.shape, 3), 0.9)


def _grey(x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    return np.full((*x.shape, 3), 0.5)


RED_GREEN_BLUE = np.array([[0.72, 0.20, 0.16], [0.22, 0.60, 0.24], [0.16, 0.28, 0.74]])


def _simple(x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    """Red, green and blue areas about a fifth of the image high, no two alike side by side."""
    turn = rng.uniform(0.3, 0.8)
    across = np.cos(turn) * x + np.sin(turn) * y
    along = np.cos(turn) * y - np.sin(turn) * x
    wavy = 4.5 * across + 0.30 * np.sin(9 * along + rng.uniform(0, 6)) + rng.uniform(0, 3)
    # the rows of areas are shifted against each other by one colour
    row = np.floor(2.6 * along + 0.12 * np.sin(11 * across) + 0.5)
    return np.asarray(RED_GREEN_BLUE[np.mod(np.floor(wavy) + row, 3).astype(int)])


PALETTE = np.array(
    [
        [0.80, 0.16, 0.14],
        [0.88, 0.55, 0.12],
        [0.20, 0.55, 0.26],
        [0.12, 0.34, 0.72],
        [0.55, 0.20, 0.62],
        [0.86, 0.78, 0.30],
        [0.14, 0.60, 0.66],
    ]
)
IVORY = np.array([0.86, 0.80, 0.66])


def _pattern(x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    """A printed fabric: flowers, rings, stripes and dots down to 4 pixels in 360."""
    across, down = 7.0 * x + 40, 7.0 * y + 40
    across = across + 0.5 * (np.floor(down) % 2)
    column, row = np.floor(across).astype(int), np.floor(down).astype(int)
    u, v = across - column - 0.5, down - row - 0.5
    radius, angle = np.hypot(u, v), np.arctan2(v, u)
    kinds = rng.integers(len(PALETTE), size=(97, 4))
    flower, heart, ring, ground = kinds[(column * 31 + row * 17) % 97].transpose(2, 0, 1)
    stripes = 0.5 + 0.5 * np.cos(2 * np.pi * (3 * u + 4 * v))
    striped = 0.45 * _edge(stripes - 0.5, 0.5)[..., None]
    cloth = IVORY * (1 - striped) + PALETTE[ground] * striped
    corner = np.hypot(0.5 - np.abs(u), 0.5 - np.abs(v))
    petals = np.cos(5 * angle + row)
    layers = (
        (PALETTE[ground], 0.135 - corner),
        (IVORY, 0.060 - corner),
        (PALETTE[ring], 0.030 - np.abs(radius - 0.435)),
        (PALETTE[flower], 0.25 + 0.12 * petals - radius),
        (IVORY, 0.13 + 0.05 * petals - radius),
        (PALETTE[heart], 0.085 - radius),
    )
    for color, inside in layers:
        cover = _edge(inside, 0.03)[..., None]
        cloth = cloth * (1 - cover) + color * cover
    return np.asarray(np.clip(cloth, DARKEST, 1))


def _complicated(x: Floats, y: Floats, rng: np.random.Generator) -> Floats:
    """Marbled paper: warped colours, veins along their contours, and speckles, at all scales."""
    warp_x, warp_y = (0.06 * _clouds(x, y, 0.35, 2, rng) for _ in range(2))
    depth = _clouds(x + warp_x, y + warp_y, 0.42, 4, rng)
    place = np.mod(1.9 * depth, len(PALETTE))
    first = np.floor(place).astype(int)
    share = _edge(place - first - 0.5, 0.40)[..., None]
    paper = PALETTE[first % len(PALETTE)] * (1 - share)
    paper = paper + PALETTE[(first + 1) % len(PALETTE)] * share
    veins = _edge(np.cos(2 * np.pi * 3.5 * depth) - 0.60, 0.60)[..., None]
    paper = paper * (1 - 0.75 * veins) + IVORY * 0.75 * veins
    fine = _clouds(x + 0.3 * warp_x, y, 0.030, 2, rng)
    specks = _edge(fine - 1.6, 0.5)[..., None]
    paper = paper * (1 + 0.16 * np.clip(fine, -2, 2)[..., None]) * (1 - 0.7 * specks)
    return np.asarray(np.clip(paper, DARKEST, 1))


def _edge(inside: Floats, width: float) -> Floats:
    """0 to 1 as `inside` goes from -width/2 to width/2, smoothly."""
    t = np.clip(inside / width + 0.5, 0, 1)
    return np.asarray(t * t * (3 - 2 * t))


def _clouds(
    x: Floats, y: Floats, wavelength: float, octaves: int, rng: np.random.Generator
) -> Floats:
    """Sum of random waves of about unit variance, from `wavelength` down by octaves."""
    total = np.zeros(x.shape, np.float32)
    waves = 12
    for octave in range(octaves):
        heading = rng.uniform(0, 2 * np.pi, waves)
        number = 2 * np.pi / wavelength * 2**octave * rng.uniform(0.7, 1.4, waves)
        phase = rng.uniform(0, 2 * np.pi, waves)
        for k, h, p in zip(number, heading, phase, strict=True):
            angle = (k * np.cos(h)) * x + (k * np.sin(h)) * y + p
            total += 0.5**octave * np.cos(angle.astype(np.float32))
    return np.asarray(total / np.sqrt(waves / 2 * sum(0.25**k for k in range(octaves))), float)


ALBEDOS: dict[str, Pattern] = {
    "simple": _simple,
    "pattern": _pattern,
    "complicated": _complicated,
    "white": _white,
    "grey": _grey,
}
