"""Captures drawn at random, wide enough for what cameras do.

`Draw` is the table of what is drawn, and from which distribution.  About a third of the draws are
easy, without any of the difficulties; in the others each is there or not on its own.  Each field
has a random stream of its own: overriding one, or adding another, leaves the others as they were.

The photographs are rendered from a surface with 2 x 2 (solids, which are traced) or 3 x 3 samples
per pixel, each with its exact normal, averaged in linear light; the truth is the samples' average.
"""

from __future__ import annotations

import os
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from functools import lru_cache, partial
from math import lcm
from numbers import Integral
from pathlib import Path
from typing import Any, get_args

import numpy as np

from rakelight.capture.listing import numbered
from rakelight.errors import InputError
from rakelight.geometry.averaging import overlaps
from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import area_mean, bounding_window
from rakelight.geometry.normals import normals_from_gradient
from rakelight.model import (
    Array,
    Camera,
    Capture,
    Encoding,
    Floats,
    Lighting,
    Mask,
    RigidTransform,
    Truth,
    finite_number,
)
from rakelight.prepare.linear import srgb
from rakelight.synthetic.albedo import ALBEDOS, DARKEST, Albedo, make_albedo, texture_from_file
from rakelight.synthetic.appearance import LightSources, Materials, photographed
from rakelight.synthetic.depth_file import shape_from_file
from rakelight.synthetic.draws import OneOf, Range, distributions, drawn, stream
from rakelight.synthetic.implicit import Surface, seen_from, trace
from rakelight.synthetic.noise import (
    DepthNoise,
    add_depth_noise,
    bent,
    flying_pixels,
    smooth_noise,
)
from rakelight.synthetic.reliefs import RELIEFS, make_relief
from rakelight.synthetic.shapes import SHAPES, Shape, make_shape

File = str | os.PathLike[str]

SCANNED = 0.25
"""The fraction of draws that show a scan, where there are scans; of photographs as paint alike."""
PICTURED = 3
"""The view shows the middle third of a photograph that is paint: its sides are often black."""
MOST_RMS_PX = 12.0
"""A sensor that errs by more pixel sizes, rms, is not put before an object."""
SOLID_RAYS, OTHER_RAYS = 2, 3
"""Samples per pixel along each side."""
SIDE_PX = 24
"""Sides of photographs are multiples of it, and of what makes the depth map's whole."""
MOST_RATIO = 100
MARGIN_PX = 4
RENDERED_PX = 6
"""How far beyond the object a background is rendered: blur and too large masks reach there."""
STEEPEST_LAMP_DEG = 80.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """What is drawn for one capture.  Difficulties are those with `absent`, or a `plain` value.

    easy : whether all difficulties are away

    The object
        shape : a name in `SHAPES` or `RELIEFS`, or the path of a scan
        yaw_deg, pitch_deg, roll_deg : of a solid
        turn : 0 to 7, mirrored right to left (1), upside down (2), rows for columns (4)
        hollow : whether its relief is turned inside out, like a mould
        depth_scale : by which its relief is multiplied
        object_px : how many pixels it covers, at size 1
        pixel_mm : of one pixel on the object
        distance_m : from the camera
        paint : a name in `ALBEDOS`, or the path of a photograph
        reflectance : by which the paint is multiplied
        material : matte; rough: Oren-Nayar of `roughness` radians; shiny: a Blinn-Phong highlight
            `gloss` times as bright as white with an exponent `gloss_exponent`; mixed: both, in
            areas that flow into each other
        wall : whether a wall stands behind the object; without one there is nothing
        wall_px : how far behind, pixel sizes
    Light
        lighting : as of captures; only "moving-lamp" is drawn
        photographs : how many, at least the drawn `depth_factor` squared, as the published methods
            need; one where the lighting is another
        lights : ring: all at `tilt_deg`, 4 degrees to and fro; cone: at random up to it;
            one-side: within `side_deg` around the object, at it, 8 degrees to and fro
        near_radii : the lights' distance from the object, in its radii (3 to 10 of them are 0.3 to
            1 m for one 0.2 m wide); 0 for distant ones
        near_spread : standard deviation of the distances, logarithmic
        light_spread : standard deviation of the lights' brightness, logarithmic
        colour_spread : standard deviation of each channel of each lamp, logarithmic
        ambient : light from everywhere, as a fraction of the lights'
        window : share of it that comes from a window on one side instead
        cast_shadows, bounce : whether parts of the object shade, and light, each other
    The colour camera
        peak : the brightness, 1 being white, that 0.5 % of the object's values exceed
        image_noise : standard deviation at white, fraction of white
        photon_share : the fraction of its variance that is proportional to the light
        corner : brightness left by the lens in the image's corners
        blur_px : standard deviation
        gamma : the exponent of light before it is encoded as stated
        bits, encoding : of the files
    The depth sensor
        depth_factor : colour pixels per depth pixel, along each side; not always a whole number
        depth_maps : how many
        depth_rms_mm : of the correlated error, at most 12 pixel sizes
        depth_length_px : distance, in colour pixels, at which its correlation is 1/e
        depth_common : the fraction of its variance that all maps share
        depth_white_mm : rms of the white noise of each map
        depth_step_mm : of quantisation
        depth_bend_mm : rms of a smooth distortion of the field, a polynomial of third degree
        hole_fraction, hole_px : share that is lost, and size of the holes, depth pixels
        flying : share of the pixels beside a jump that lie between both sides
        shift_x, shift_y : of the depth map against the photographs, colour pixels, to the nearest
            sample
        mask_px : by how much the mask is too large
    """

    seed: int
    size: float = 1.0
    easy: bool = drawn(OneOf({True: 1, False: 2}))
    shape: str = drawn(
        OneOf({"head": 0.5, **dict.fromkeys(("vase", "cloth", "coin"), 1.0), "sphere": 0.7}
              | dict.fromkeys(RELIEFS, 1.0))
    )  # fmt: skip
    yaw_deg: float = drawn(Range(-40, 40))
    pitch_deg: float = drawn(Range(-25, 25))
    roll_deg: float = drawn(Range(-180, 180))
    turn: int = drawn(Range(0, 7, whole=True))
    hollow: bool = drawn(OneOf({False: 0.9, True: 0.1}, plain=False))
    depth_scale: float = drawn(Range(0.3, 1.0, log=True, absent=0.6, none=1.0))
    object_px: float = drawn(Range(10_000, 22_000, log=True))
    pixel_mm: float = drawn(Range(0.1, 1.0, log=True))
    distance_m: float = drawn(Range(0.3, 1.5, log=True))
    paint: str = drawn(OneOf(dict.fromkeys(ALBEDOS, 1.0)))
    reflectance: float = drawn(Range(0.3, 1.0))
    material: str = drawn(
        OneOf({"matte": 0.25, "rough": 0.25, "shiny": 0.25, "mixed": 0.25}, plain="matte")
    )
    roughness: float = drawn(Range(0.2, 0.8))
    gloss: float = drawn(Range(0.05, 0.5, log=True))
    gloss_exponent: float = drawn(Range(10, 200, log=True))
    wall: bool = drawn(OneOf({False: 0.5, True: 0.5}, plain=False))
    wall_px: float = drawn(Range(3, 60, log=True))
    lighting: Lighting = drawn(  # noqa: RUF009
        OneOf({"moving-lamp": 1})
    )
    photographs: int = drawn(Range(3, 64, log=True, whole=True))
    lights: str = drawn(OneOf({"ring": 1, "cone": 1, "one-side": 1}, plain="cone"))
    tilt_deg: float = drawn(Range(25, 60))
    side_deg: float = drawn(Range(60, 180))
    near_radii: float = drawn(Range(3, 10, log=True, absent=0.5))
    near_spread: float = drawn(Range(0, 0.2))
    light_spread: float = drawn(Range(0, 0.4, absent=0.3))
    colour_spread: float = drawn(Range(0.05, 0.4, absent=0.75))
    ambient: float = drawn(Range(0, 0.3))
    window: float = drawn(Range(0.2, 1, absent=0.6))
    cast_shadows: bool = drawn(OneOf({True: 0.6, False: 0.4}, plain=False))
    bounce: bool = drawn(OneOf({True: 0.5, False: 0.5}, plain=False))
    peak: float = drawn(Range(0.5, 1.2, absent=0.4, none=0.9))
    image_noise: float = drawn(Range(0.002, 0.03, log=True))
    photon_share: float = drawn(Range(0, 1))
    corner: float = drawn(Range(0.6, 1.0, absent=0.4, none=1.0))
    blur_px: float = drawn(Range(0.2, 1.5, absent=0.4))
    gamma: float = drawn(Range(0.95, 1.05, absent=0.5, none=1.0))
    bits: int = drawn(OneOf({8: 0.6, 16: 0.4}))
    encoding: Encoding = drawn(  # noqa: RUF009
        OneOf({"linear": 0.5, "srgb": 0.5})
    )
    depth_factor: float = drawn(OneOf({1: 0.35, 2: 0.4, 3: 0.1, 4: 0.09, 6: 0.03, 8: 0.03}))
    depth_maps: int = drawn(Range(1, 20, log=True, whole=True))
    depth_rms_mm: float = drawn(Range(0.2, 6, log=True))
    depth_length_px: float = drawn(Range(0, 40))
    depth_common: float = drawn(Range(0.5, 1))
    depth_white_mm: float = drawn(Range(0.02, 1, log=True, absent=0.2))
    depth_step_mm: float = drawn(Range(0.1, 3, log=True, absent=0.4))
    depth_bend_mm: float = drawn(Range(0.1, 3, log=True, absent=0.4))
    hole_fraction: float = drawn(Range(0.005, 0.1, log=True, absent=0.5))
    hole_px: float = drawn(Range(2, 8))
    flying: float = drawn(Range(0.1, 0.9, absent=0.5))
    shift_x: float = drawn(Range(-2, 2, absent=0.5))
    shift_y: float = drawn(Range(-2, 2, absent=0.5))
    mask_px: int = drawn(Range(-2, 2, whole=True, absent=0.5))

    def __str__(self) -> str:
        """All fields on one line; files by their names."""
        words = []
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, float):
                value = f"{value:.3g}"
            elif item.name in ("shape", "paint"):
                value = Path(value).stem
            words.append(f"{item.name} {value}")
        return ", ".join(words)


def draw(
    seed: int,
    size: float = 1.0,
    scans: Sequence[File] = (),
    pictures: Sequence[File] = (),
    ratios: Sequence[float] = (),
    **overrides: Any,
) -> Draw:
    """What is drawn for a seed; `overrides` set fields of `Draw` to other values.

    scans : depth maps that can be shapes (`shape_from_file`), which an override may name by their
        stem; pictures : photographs as paint, likewise
    ratios : instead of the table's, what `depth_factor` is drawn from, 1 to 100, all alike likely;
        all else stays as drawn, and photographs are not made as many as its square

    Raises InputError for an override that is no field, a name that is not known, or a ratio out of
    range.

    >>> one, other = draw(7), draw(7, lights="one-side")
    >>> other.lights, other.photographs == one.photographs
    ('one-side', True)
    """
    table = distributions(Draw)
    _check_overrides(overrides, table)
    if not (isinstance(seed, Integral) and seed >= 0 and finite_number(size) and 0.1 <= size <= 10):
        raise InputError(
            "not a possible capture",
            source="random_capture",
            seen=f"seed {seed}, size {size}",
            needed="a whole number from 0, a size of 0.1 to 10",
        )
    if not all(1 <= ratio <= MOST_RATIO for ratio in ratios):
        raise InputError(
            "not possible ratios",
            source="ratios",
            seen=", ".join(f"{ratio:g}" for ratio in ratios),
            needed=f"1 to {MOST_RATIO}",
        )
    easy = overrides.get("easy", table["easy"].draw(stream(seed, "easy"), False))
    values: dict[str, Any] = {
        name: each.draw(stream(seed, name), easy) for name, each in table.items()
    }
    values["easy"] = easy
    if ratios:
        values["depth_factor"] = ratios[int(stream(seed, "ratio").integers(len(ratios)))]
    values["depth_rms_mm"] = min(values["depth_rms_mm"], MOST_RMS_PX * values["pixel_mm"])
    for name, files, made in (
        ("shape", scans, (*SHAPES, *RELIEFS)),
        ("paint", pictures, tuple(ALBEDOS)),
    ):
        places = sorted(str(Path(file)) for file in files)
        rng = stream(seed, f"{name} file")
        if places and rng.random() < SCANNED:
            values[name] = places[rng.integers(len(places))]
        if name in overrides and overrides[name] not in made:
            found = [place for place in places if overrides[name] in (place, Path(place).stem)]
            if not found:
                raise InputError(
                    f"no such {name}",
                    source=name,
                    seen=f"{overrides[name]}",
                    needed="one of " + ", ".join((*made, *(Path(place).stem for place in places))),
                )
            overrides = {**overrides, name: found[0]}
    values |= overrides
    if values["lighting"] != "moving-lamp":
        values["photographs"] = 1
    elif "photographs" not in overrides and not ratios:
        values["photographs"] = max(values["photographs"], values["depth_factor"] ** 2)
    return Draw(seed=seed, size=size, **values)


def _check_overrides(overrides: Mapping[str, Any], table: Mapping[str, Range | OneOf]) -> None:
    """Raise InputError for a field that is not drawn, or a value that no capture has."""
    names = {item.name for item in fields(Draw)} - {"seed", "size"}
    if unknown := sorted(set(overrides) - names):
        raise InputError(
            "not drawn for a capture", source="overrides", seen=unknown[0], needed=", ".join(names)
        )
    for name, value in overrides.items():
        _check_override(name, value, table.get(name))


# Fields of `Draw` by which something is divided, or of which there is one at the least.
_ABOVE_0 = ("object_px", "pixel_mm", "distance_m", "photographs", "depth_maps")


def _check_override(name: str, value: Any, distribution: Range | OneOf | None) -> None:
    """Raise InputError for a value that no capture has; files are looked for by their own names."""
    number = finite_number(value)
    if name == "depth_factor":
        possible, needed = number and 1 <= value <= MOST_RATIO, f"1 to {MOST_RATIO}"
    elif isinstance(distribution, OneOf) and name not in ("shape", "paint"):
        others = get_args(Lighting) if name == "lighting" else ()  # that no draw has by itself
        possible = isinstance(value, Hashable) and (value in others or distribution.holds(value))
        needed = ", ".join(map(str, others or distribution.weights))
    elif isinstance(distribution, Range):
        possible = number and (isinstance(value, Integral) or not distribution.whole)
        needed = "a whole number" if distribution.whole else "a number"
        if distribution.low >= 0:
            least = 1e-9 if name in _ABOVE_0 else 0.0  # smaller ones are as good as 0
            possible = possible and value >= least
            needed += " above 0" if least else " from 0"
    else:
        return
    if not possible:
        raise InputError("not drawn for a capture", source=name, seen=str(value), needed=needed)


def random_capture(
    seed: int,
    size: float = 1.0,
    scans: Sequence[File] = (),
    pictures: Sequence[File] = (),
    ratios: Sequence[float] = (),
    **overrides: Any,
) -> tuple[Capture, Truth]:
    """The capture of `draw(seed, ...)`, and what is true of it; see there.

    size : scale of the image; at 1 the object covers 10,000 to 22,000 pixels

    >>> capture, truth = random_capture(0, size=0.2, shape="sphere", photographs=3)
    >>> capture.photographs.shape[0], bool(truth.mask.any())
    (3, True)
    """
    return render_draw(draw(seed, size, scans, pictures, ratios, **overrides))


@np.errstate(under="ignore")  # of a bump far away, whatever the caller has set
def render_draw(drawn: Draw) -> tuple[Capture, Truth]:
    """The capture that a draw describes, and what is true of it.

    The truth's mask holds the pixels that the object covers whole; the capture's is larger or
    smaller by `mask_px`.  The truth's lights are those of linear values, white being 1, where
    nothing but the lights' own light is seen.

    >>> capture, truth = render_draw(draw(0, size=0.2, shape="ring", photographs=4, bits=8))
    >>> capture.photographs.shape[0], str(capture.photographs.dtype)
    (4, 'uint8')
    """
    surface, fine, rays = _object(drawn)
    camera = fine.scaled(1 / rays)
    count = area_mean(surface.mask, rays)
    mask = count == 1
    depth = area_mean(surface.depth, rays)
    normals = area_mean(surface.normals, rays)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    everything = _before_wall(drawn, surface, fine)

    paint = _paint(drawn, fine)
    lights = _lights(drawn, back_project(depth, camera)[mask])
    near = everything.mask & _grown(count > 0, RENDERED_PX).repeat(rays, 0).repeat(rays, 1)
    light = photographed(
        everything,
        fine,
        rays,
        near,
        _materials(drawn, near, paint[near], rays),
        lights,
        cast_shadows=drawn.cast_shadows,
        bounce=drawn.bounce,
    )
    level = drawn.peak / float(np.quantile(light[:, mask], 0.995))
    capture = Capture(
        photographs=_develop(drawn, level * light),
        depth_m=_sensed(drawn, everything.depth, camera, rays),
        mask=_grown(mask, drawn.mask_px),
        camera=camera,
        encoding=drawn.encoding,
        lighting=drawn.lighting,
        names=tuple(map(numbered, range(len(light)))),
        source=f"draw {drawn.seed}",
    )
    truth = Truth(
        depth=np.where(mask, depth, np.nan).astype(np.float32),
        normals=np.where(mask[..., None], normals, np.nan).astype(np.float32),
        albedo=np.where(mask[..., None], area_mean(paint, rays), 0).astype(np.float32),
        lights=lights.as_lights(level),
    )
    return capture, truth


# ---- the object


def _object(drawn: Draw) -> tuple[Surface, Camera, int]:
    """The object before a camera of rays x rays samples per pixel; that camera; rays."""
    shape = _shape(drawn)
    rays = OTHER_RAYS if shape.solid is None else SOLID_RAYS
    # a first look, to frame the object
    look = shape.camera.scaled(64 / max(shape.camera.shape))
    seen = shape.render(look).mask
    zoom = drawn.size * np.sqrt(drawn.object_px / np.count_nonzero(seen)) * look.fx
    zoom /= shape.camera.fx
    rows, columns = bounding_window(seen, margin=1)
    view = shape.camera.scaled(zoom)
    factor = view.fx / look.fx
    multiple = lcm(SIDE_PX, Fraction(drawn.depth_factor).limit_denominator(8).numerator)
    tops, sides = [], []
    for window in (columns, rows):
        side = (window.stop - window.start) * factor + 2 * MARGIN_PX
        sides.append(multiple * int(np.ceil(side / multiple)))
        tops.append(round((window.start + window.stop) / 2 * factor - sides[-1] / 2))
    view = replace(
        view, width=sides[0], height=sides[1], cx=view.cx - tops[0], cy=view.cy - tops[1]
    )
    surface = shape.render(view.scaled(rays))
    return (*_placed(drawn, surface, view.scaled(rays), rays), rays)


def _shape(drawn: Draw) -> Shape:
    name = drawn.shape
    if name in RELIEFS:
        return make_relief(name, int(stream(drawn.seed, "relief").integers(1 << 31)))
    if name not in SHAPES:
        return _scan(name)
    shape = make_shape(name)
    assert shape.solid is not None
    yaw, pitch, roll = np.radians([drawn.yaw_deg, drawn.pitch_deg, drawn.roll_deg])
    turn = _rotation(2, roll) @ _rotation(0, pitch) @ _rotation(1, yaw)
    centre = np.array([0.0, 0.0, shape.solid.distance_m])
    # the object turns by the inverse of what the camera does
    turned = seen_from(shape.solid, RigidTransform(turn.T, centre - turn.T @ centre))
    return Shape(name, shape.camera, partial(trace, turned), turned)


@lru_cache(maxsize=8)
def _scan(path: str) -> Shape:
    return shape_from_file(path)


def _rotation(axis: int, angle: float) -> Floats:
    turn = np.eye(3)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turn[[a, a, b, b], [a, b, a, b]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    return turn


def _placed(drawn: Draw, surface: Surface, seen_by: Camera, rays: int) -> tuple[Surface, Camera]:
    """The surface at the drawn distance and scale, turned, and the camera that sees it there.

    Its relief, in pixel sizes of its middle, stays as it was, but for `depth_scale` and `hollow`.
    """
    x, y = (np.asarray(ray) for ray in np.broadcast_arrays(*_rays(seen_by)))
    middle = float(np.nanmedian(surface.depth))
    relief = (surface.depth - middle) * seen_by.fx / middle
    # m of geometry/normals.py is a normal whose product with its pixel's ray is -1
    n = surface.normals
    grazing = np.minimum(n[..., 0] * x + n[..., 1] * y + n[..., 2], -1e-6)
    slopes = [
        -n[..., axis] / grazing / focal * surface.depth * seen_by.fx / middle
        for axis, focal in ((0, seen_by.fx), (1, seen_by.fy))
    ]
    if drawn.turn & 1:
        relief, slopes = relief[:, ::-1], [-slopes[0][:, ::-1], slopes[1][:, ::-1]]
    if drawn.turn & 2:
        relief, slopes = relief[::-1], [slopes[0][::-1], -slopes[1][::-1]]
    if drawn.turn & 4:
        relief, slopes = relief.T, [slopes[1].T, slopes[0].T]
    height, width = relief.shape
    pixel_m = drawn.pixel_mm / 1000 / (drawn.size * rays)
    focal = drawn.distance_m / pixel_m
    camera = Camera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)
    scale_m = drawn.depth_scale * (-1 if drawn.hollow else 1) * pixel_m
    depth = drawn.distance_m + scale_m * relief
    normals, _ = normals_from_gradient(
        scale_m * slopes[0] / depth, scale_m * slopes[1] / depth, camera
    )
    return Surface(depth, normals), camera


def _rays(camera: Camera) -> tuple[Floats, Floats]:
    x = (np.arange(camera.width) - camera.cx)[None] / camera.fx
    y = (np.arange(camera.height) - camera.cy)[:, None] / camera.fy
    return x, y


def _before_wall(drawn: Draw, surface: Surface, camera: Camera) -> Surface:
    """The surface, and the wall that faces the camera behind it."""
    if not drawn.wall:
        return surface
    gap_m = drawn.wall_px * drawn.pixel_mm / 1000 / drawn.size
    beside = ~surface.mask
    depth = np.where(beside, np.nanmax(surface.depth) + gap_m, surface.depth)
    normals = np.where(beside[..., None], [0.0, 0.0, -1.0], surface.normals)
    return Surface(depth, normals)


def _grown(mask: Mask, by_px: int) -> Mask:
    """The mask `by_px` pixels larger, or smaller; never empty."""
    from scipy.ndimage import distance_transform_edt

    if by_px > 0:
        return np.asarray(distance_transform_edt(~mask) <= by_px)
    smaller = np.asarray(distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1] > -by_px)
    return smaller if smaller.any() else mask


def _paint(drawn: Draw, camera: Camera) -> Floats:
    """(H, W, 3) linear reflectance."""
    if drawn.paint in ALBEDOS:
        albedo = make_albedo(drawn.paint, int(stream(drawn.seed, "pattern").integers(1 << 31)))
    else:
        # the middle of a photograph, where what it shows is
        larger = camera.scaled(PICTURED)
        rows, columns = (
            slice((wide - side) // 2, (wide + side) // 2 + (wide - side) % 2)
            for wide, side in zip(larger.shape, camera.shape, strict=True)
        )
        window = _picture(drawn.paint).paint(larger)[rows, columns]
        return np.asarray(drawn.reflectance * np.maximum(window, DARKEST))
    return np.asarray(drawn.reflectance * albedo.paint(camera))


@lru_cache(maxsize=4)
def _picture(path: str) -> Albedo:
    return texture_from_file(path)


def _materials(drawn: Draw, near: Mask, albedo: Floats, rays: int) -> Materials:
    rough = np.zeros(len(albedo))
    shiny = np.zeros(len(albedo))
    if drawn.material == "mixed":
        rng = stream(drawn.seed, "areas")
        length_px = 0.15 * max(near.shape)
        rough, shiny = (
            np.clip(0.5 + waves / waves.std(), 0, 1)[near]
            for waves in (smooth_noise(rng, near.shape, length_px) for _ in range(2))
        )
    rough = np.ones_like(rough) if drawn.material == "rough" else rough
    shiny = np.ones_like(shiny) if drawn.material == "shiny" else shiny
    rough, shiny = drawn.roughness * rough, drawn.gloss * shiny
    return Materials(
        albedo=albedo.astype(np.float32),
        roughness=rough.astype(np.float32),
        gloss=shiny.astype(np.float32),
        exponent=drawn.gloss_exponent,
    )


# ---- light


def _lights(drawn: Draw, points_m: Floats) -> LightSources:
    """The lights around an object of visible points (M, 3)."""
    rng = stream(drawn.seed, "lights")
    if drawn.lighting == "moving-lamp":
        tilt, azimuth = (angle[:, None] for angle in _moving(drawn, rng))
    elif drawn.lighting == "rgb-leds":
        tilt = drawn.tilt_deg + rng.uniform(-8, 8, (1, 3))
        azimuth = rng.uniform(0, 360) + np.array([[0, 120, 240]]) + rng.uniform(-15, 15, (1, 3))
    else:
        tilt, azimuth = np.array([[35.0]]), np.array([[rng.uniform(-150, -30)]])
    tilt, azimuth = np.radians(np.clip(tilt, 0, STEEPEST_LAMP_DEG)), np.radians(azimuth)
    toward = np.stack(
        [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)], axis=-1
    )
    count = len(toward)
    rng = stream(drawn.seed, "brightness")
    gain = np.exp(drawn.light_spread * rng.standard_normal((count, 1)))
    gain = gain * np.exp(drawn.colour_spread * rng.standard_normal((count, 3)))
    middle = points_m.mean(axis=0)
    distance_m = None
    if drawn.near_radii and drawn.lighting != "ambient":
        radius_m = float(np.linalg.norm(points_m - middle, axis=1).max())
        factor = np.exp(drawn.near_spread * rng.standard_normal(toward.shape[:2]))
        distance_m = radius_m * np.maximum(drawn.near_radii * factor, 2)
    ambient = np.full((count, 3), 0.5 if drawn.lighting == "ambient" else drawn.ambient)
    rng = stream(drawn.seed, "window's side")
    off, turn = np.radians(rng.uniform(20, 80)), rng.uniform(0, 2 * np.pi)
    side = np.array([np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn), -np.cos(off)])
    return LightSources(toward, gain, ambient, middle, distance_m, drawn.window * side)


def _moving(drawn: Draw, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """(N,) tilt from the optical axis and azimuth (0 to the right, 90 down) of lights, degrees."""
    count = drawn.photographs
    start = rng.uniform(0, 360)
    if drawn.lights == "ring":
        turns = np.arange(count) * 360 / count + rng.uniform(-0.2, 0.2, count) * 360 / count
        return drawn.tilt_deg + rng.uniform(-4, 4, count), start + turns
    if drawn.lights == "one-side":
        turns = drawn.side_deg * rng.uniform(-0.5, 0.5, count)
        return drawn.tilt_deg + rng.uniform(-8, 8, count), start + turns
    lowest = np.cos(np.radians(drawn.tilt_deg))
    tilt = np.degrees(np.arccos(rng.uniform(lowest, 1, count)))
    return tilt, rng.uniform(0, 360, count)


# ---- sensors


def _develop(drawn: Draw, light: Floats) -> Array:
    """(N, H, W, 3) pixel values of linear light: lens, noise, clipping, encoding, rounding."""
    import cv2

    rng = stream(drawn.seed, "image noise")
    height, width = light.shape[1:3]
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    lens = (1 - (1 - drawn.corner) * (x**2 + y**2) / 2)[..., None]
    white = 2**drawn.bits - 1
    values = np.empty(light.shape, np.uint8 if drawn.bits == 8 else np.uint16)
    for image, value in zip(light, values, strict=True):
        seen = image * lens
        if drawn.blur_px:
            seen = cv2.GaussianBlur(seen, (0, 0), drawn.blur_px)
        variance = 1 - drawn.photon_share + drawn.photon_share * np.clip(seen, 0, 1)
        seen = seen + drawn.image_noise * np.sqrt(variance) * rng.standard_normal(seen.shape)
        seen = np.clip(seen, 0, 1) ** drawn.gamma
        value[:] = np.rint(white * (srgb(seen) if drawn.encoding == "srgb" else seen))
    return values


def _means(image: Floats, factor: float) -> Floats:
    """(h, w) means of an image over cells of factor x factor pixels; NaN where any pixel is."""
    if factor == round(factor):
        return area_mean(image, round(factor))
    rows, columns = (
        overlaps(np.linspace(0, side, round(side / factor) + 1), side) for side in image.shape
    )
    return np.asarray(rows @ image @ columns.T) / factor**2


def _sensed(drawn: Draw, depth_m: Floats, camera: Camera, rays: int) -> Floats:
    """(K, h, w) what the depth sensor reports of the samples' depth.

    Sensor pixels that the surface does not fill give no measurement.
    """
    factor = drawn.depth_factor
    shifts = [round(rays * drawn.size * shift) for shift in (drawn.shift_y, drawn.shift_x)]
    shifted = np.full(depth_m.shape, np.nan)
    rows, columns = (
        (slice(max(shift, 0), side + min(shift, 0)), slice(max(-shift, 0), side + min(-shift, 0)))
        for shift, side in zip(shifts, depth_m.shape, strict=True)
    )
    shifted[rows[0], columns[0]] = depth_m[rows[1], columns[1]]
    depth = _means(shifted, factor * rays)
    depth = bent(depth, drawn.depth_bend_mm, stream(drawn.seed, "bend"))
    length_px = drawn.depth_length_px * drawn.size / factor
    jump_m = 3 * factor * float(np.nanmedian(depth)) / camera.fx

    def error(base: Floats, seed: str, share: float) -> Floats:
        rms_mm = drawn.depth_rms_mm * np.sqrt(share)
        noise = DepthNoise(rms_mm=rms_mm, correlation_length_px=length_px)
        return add_depth_noise(base, noise, stream(drawn.seed, seed)) - base

    common = error(depth, "depth error", drawn.depth_common)
    maps = []
    for k in range(drawn.depth_maps):
        rng = stream(drawn.seed, f"depth map {k}")
        one = flying_pixels(depth, jump_m, drawn.flying, rng)
        one = one + common + error(depth, f"depth error {k}", 1 - drawn.depth_common)
        noise = DepthNoise(
            rms_mm=drawn.depth_white_mm,
            step_mm=drawn.depth_step_mm,
            hole_fraction=drawn.hole_fraction,
            hole_size_px=drawn.hole_px,
        )
        maps.append(add_depth_noise(one, noise, rng))
    return np.stack(maps)
