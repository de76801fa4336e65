"""Scenes rendered a strip of rows at a time.

What the rays meet is kept, for the pixels on the object alone; photographs are made of it one after
the other, and handed on in strips.  Their number costs no memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from rakelight.capture.listing import numbered
from rakelight.errors import InputError
from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import area_mean, row_strips
from rakelight.jit import side_by_side, worth_side_by_side
from rakelight.memory import require_memory
from rakelight.model import (
    Array,
    Camera,
    Capture,
    Floats,
    Mask,
    Progress,
    ProgressCallback,
    Truth,
)
from rakelight.photometry.cast_shadows import Occluder
from rakelight.prepare.linear import srgb
from rakelight.synthetic.albedo import Albedo
from rakelight.synthetic.implicit import first_hits, seen_from
from rakelight.synthetic.noise import add_depth_noise
from rakelight.synthetic.options import SceneOptions
from rakelight.synthetic.quantile import count_values, quantile
from rakelight.synthetic.scene_lights import DEPTH_STREAM, IMAGE_STREAM, SceneLights, scene_lights
from rakelight.synthetic.shapes import SHAPES, Shape

T = TypeVar("T")
S = TypeVar("S")

SAMPLES = 1 << 18
"""Rays of a strip: what is needed for them in between is tens of megabytes."""


@dataclass(frozen=True, eq=False)
class Strip:
    """What the rays through some rows of a camera meet.

    rows : of the image
    mask : (h, W) the pixels that the object covers whole
    hit : (M,) int32, which of the rays meet the object, in row order
    depth, normals, albedo : (M,) metres, (M, 3), (M, 3) there
    """

    rows: slice
    mask: Mask
    hit: Array
    depth: Floats
    normals: Floats
    albedo: Floats


@dataclass(frozen=True, eq=False)
class Rendering:
    """A scene whose photographs can be made.

    options, camera : the scene's, and the colour camera
    strips : from the first row to the last
    lights, level : and by how much their light is multiplied
    occluder : what casts shadows, None where nothing does
    depth_m, depth_camera : as of `Capture`
    """

    options: SceneOptions
    camera: Camera
    strips: list[Strip]
    lights: SceneLights
    occluder: Occluder | None
    depth_m: Floats
    depth_camera: Camera | None
    level: float = 1.0

    @property
    def count(self) -> int:
        """How many photographs there are."""
        return len(self.lights.toward)

    @property
    def dtype(self) -> type[np.unsignedinteger]:
        """The type of their values."""
        return np.uint8 if self.options.bits == 8 else np.uint16

    def capture(self, photographs: Array) -> Capture:
        """The capture of these photographs."""
        options = self.options
        return Capture(
            photographs=photographs,
            depth_m=self.depth_m,
            mask=np.concatenate([strip.mask for strip in self.strips]),
            camera=self.camera,
            encoding=options.encoding,
            lighting=options.lighting,
            depth_camera=self.depth_camera,
            depth_to_color=options.depth_to_color,
            names=tuple(map(numbered, range(len(photographs)))),
        )

    def photographs(
        self, finish: Callable[[Array], T], progress: ProgressCallback
    ) -> Iterator[tuple[int, slice, T]]:
        """Number and rows of each strip of each photograph, in order, and `finish` of its values.

        finish : of values (h, W, 3), called on several cores
        """
        options, noise = self.options, np.random.default_rng([self.options.seed, IMAGE_STREAM])

        def drawn() -> Iterator[tuple[int, Strip, Floats]]:
            # One stream for all of them, which has to be drawn in order.
            for i in range(self.count):
                progress(Progress("photographs", i, self.count))
                for strip in self.strips:
                    shape = (*strip.mask.shape, 3)
                    yield i, strip, noise.standard_normal(shape, dtype=np.float32)

        def developed(item: tuple[int, Strip, Floats]) -> tuple[int, slice, T]:
            i, strip, noise = item
            light = self.light(strip, i) * np.float32(self.level) + options.image_noise * noise
            return i, strip.rows, finish(self._developed(light))

        return _on_all_cores(developed, drawn())

    def _developed(self, light: Floats) -> Array:
        """Linear light with noise to pixel values: clipping, encoding, rounding."""
        exposed = np.clip(light, 0, 1, out=light)
        code = srgb(exposed) if self.options.encoding == "srgb" else exposed
        values: Array = np.rint(np.iinfo(self.dtype).max * code).astype(self.dtype)
        return values

    def light(self, strip: Strip, photograph: int) -> Floats:
        """(h, W, 3) float32 linear light of a strip of a photograph."""
        from rakelight.synthetic import _kernels

        options, lights, channels = self.options, self.lights, self.lights.toward.shape[1]
        samples = len(strip.hit)
        lit = np.empty((channels, samples))
        highlight = np.empty((channels if options.specular else 0, samples))
        aimed = lights.distance_m is None and not options.specular and self.occluder is None
        points = np.empty((0, 3)) if aimed else self._points(strip)
        for c in range(channels):
            s = lights.at(points, photograph, c)
            _kernels.facing(strip.normals, s, lit[c])
            if self.occluder is not None:
                lit[c] *= self.occluder.in_sight(points, lights.way(points, photograph, c))
            if options.specular:
                highlight[c] = _highlight(strip.normals, points, s, lit[c] > 0, options)
        height, width, rays = *strip.mask.shape, options.supersampling
        light = np.zeros((height * rays * width * rays, 3), np.float32)
        glow = float(lights.gain[photograph] * lights.ambient)
        _kernels.reflected(strip.albedo, lit, highlight, glow, strip.hit, light)
        light = light.reshape(height * rays, width * rays, 3)
        return light if rays == 1 else area_mean(light, rays).astype(np.float32)

    def _points(self, strip: Strip) -> Floats:
        """(M, 3) where the rays of a strip meet the object, metres."""
        rays, fine = self.options.supersampling, self.camera.scaled(self.options.supersampling)
        row, column = np.divmod(strip.hit, np.int32(fine.width))
        x, y = column - fine.cx, row + np.int32(rays * strip.rows.start) - fine.cy
        depth = strip.depth
        return np.stack([depth * x / fine.fx, depth * y / fine.fy, depth], axis=-1)

    def exposed(self, progress: ProgressCallback) -> Rendering:
        """The rendering at the level of light that the options ask for."""
        options = self.options
        if options.exposure:
            return replace(self, level=options.exposure)

        def counts(upper: int) -> Array:
            """Of the values within the mask, in all photographs."""

            def counted(strip: Strip) -> Array:
                found = np.zeros(1 << 16, np.int64)
                for i in range(self.count):
                    found += count_values(self.light(strip, i), strip.mask, upper)
                return found

            total = np.zeros(1 << 16, np.int64)
            for done, found in enumerate(_on_all_cores(counted, iter(self.strips))):
                total += found
                progress(Progress("exposure", done + 1, len(self.strips)))
            return total

        return replace(self, level=options.peak / quantile(counts, options.peak_quantile))


def rendered(
    shape: Shape,
    albedo: Albedo,
    options: SceneOptions,
    finish: Callable[[Truth], T],
    keep: Callable[[slice, T], None],
    progress: ProgressCallback,
) -> Rendering:
    """A scene, seen and lit.

    finish : of what is true of a strip of rows, called on several cores; keep : takes its results,
        with their rows, in order

    Raises what `render_scene` does.
    """
    camera = options.camera or shape.camera
    require_samples(camera, options)
    _require_object(camera.width * camera.height, camera, shape)
    if options.depth_to_color is not None and shape.solid is None:
        raise InputError(
            "this object can be seen from the colour camera's place only",
            source="depth_to_color",
            seen=shape.name,
            needed="one of " + ", ".join(SHAPES),
        )
    block = _own_pixels(camera, options)

    def look(rows: slice) -> tuple[Strip, Floats, Floats, Floats, T]:
        return _seen(shape, albedo, camera, options, rows, block, finish)

    strips, depth, total = list[Strip](), list[Floats](), np.zeros(3)
    rays = options.supersampling
    opaque = list[Floats]()
    every = _strips(camera, rays, block or 1)
    for strip, fine, points, coarse, true in _on_all_cores(look, iter(every)):
        keep(strip.rows, true)
        strips.append(strip)
        depth.append(coarse)
        if options.cast_shadows:
            opaque.append(fine)
        total = np.concatenate([total[None], points]).sum(axis=0)
        progress(Progress("surface", len(strips), len(every)))
    count = sum(int(np.count_nonzero(strip.mask)) for strip in strips)
    _require_object(count, camera, shape)
    depth_camera, depth_m = None, np.concatenate(depth)
    if not block:
        depth_camera, depth_m = _depth_view(shape, camera, options)
    fine_camera = camera.scaled(rays)
    return Rendering(
        options=options,
        camera=camera,
        strips=strips,
        lights=scene_lights(options, total / count),
        occluder=Occluder.of(np.concatenate(opaque), fine_camera) if opaque else None,
        depth_m=_sense_depth(depth_m, options),
        depth_camera=depth_camera,
    ).exposed(progress)


def _seen(
    shape: Shape,
    albedo: Albedo,
    camera: Camera,
    options: SceneOptions,
    rows: slice,
    block: int,
    finish: Callable[[Truth], T],
) -> tuple[Strip, Floats, Floats, Floats, T]:
    """A strip, its rays' depth, (K, 3) its pixels' points, its means of depth, and what is true."""
    rays = options.supersampling
    fine_camera, fine_rows = camera.scaled(rays), slice(rays * rows.start, rays * rows.stop)
    surface = shape.render(camera, rows)
    fine = shape.render(fine_camera, fine_rows) if rays > 1 else surface
    mask = surface.mask & (area_mean(fine.mask, rays) == 1)
    paint = albedo.paint(fine_camera, fine_rows)
    hit = np.flatnonzero(fine.mask)
    strip = Strip(
        rows,
        mask,
        hit.astype(np.int32),
        fine.depth.ravel()[hit],
        fine.normals.reshape(-1, 3)[hit],
        paint.reshape(-1, 3)[hit],
    )
    inside = mask[..., None]
    truth = Truth(
        depth=np.where(mask, surface.depth, np.nan).astype(np.float32),
        normals=np.where(inside, surface.normals, np.nan).astype(np.float32),
        albedo=np.where(inside, area_mean(paint, rays), 0).astype(np.float32),
    )
    points = back_project(surface.depth, camera, rows)[mask]
    means = area_mean(surface.depth, block) if block else np.empty((0, 0))
    return strip, fine.depth, points, means, finish(truth)


def _on_all_cores(work: Callable[[S], T], items: Iterator[S]) -> Iterator[T]:
    """work(item) of each, in their order, two at a time."""

    def checked(item: S, check: Callable[[], None]) -> T:
        check()
        return work(item)

    return side_by_side(checked, items, worth_side_by_side())


def _strips(camera: Camera, rays: int, multiple: int) -> list[slice]:
    """The rows of a camera in strips of about `SAMPLES` rays, of a multiple of so many rows."""
    most = SAMPLES // (camera.width * rays**2)
    return list(row_strips(camera.height, max(most // multiple, 1) * multiple))


def _require_object(pixels: int, camera: Camera, shape: Shape) -> None:
    if not pixels:
        raise InputError(
            "the camera does not see the object",
            source=shape.name,
            seen=f"{camera.width} x {camera.height} pixels",
            needed="at least one that lies on it whole",
        )


# Bytes that rendering needs at the least: of each ray that meets the object (depth, normal, albedo
# and its number), a tenth of them; of each pixel of a depth map, its noise; of a strip's ray.
_BYTES_PER_RAY, _BYTES_PER_FRAME, _BYTES_PER_STRIP_RAY = 5, 8, 150


def require_samples(camera: Camera, options: SceneOptions, photographs: int = 0) -> None:
    """Raise MachineError where there is less memory than rendering needs at the least.

    photographs : how many are held in memory
    """
    pixels, rays = camera.width * camera.height, options.supersampling**2
    depth = options.depth_frames / options.depth_factor**2
    held = photographs * 3 * options.bits // 8
    require_memory(
        pixels * (_BYTES_PER_RAY * rays + _BYTES_PER_FRAME * depth + held)
        + min(pixels * rays, SAMPLES) * _BYTES_PER_STRIP_RAY,
        source="the scene",
        remedy="fewer --depth-frames, less --supersampling, or a smaller --size",
    )


# ---- light


def _highlight(
    normals: Floats, points_m: Floats, s: Floats, lit: Mask, options: SceneOptions
) -> Floats:
    """(M,) Blinn-Phong: the lamp's strength times a power of the halfway vector's cosine."""
    strength = np.linalg.norm(s, axis=-1)
    halfway = s / strength[:, None] - points_m / np.linalg.norm(points_m, axis=1, keepdims=True)
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    cosine = np.maximum((normals * halfway).sum(axis=1), 0)
    return np.asarray(options.specular * strength * cosine**options.specular_exponent * lit)


# ---- depth


def _own_pixels(camera: Camera, options: SceneOptions) -> int:
    """Colour pixels along each side of a depth pixel, where each is made of whole ones; else 0."""
    factor = options.depth_factor
    whole = camera.width % factor == camera.height % factor == 0 and factor % 1 == 0
    return int(factor) if whole and options.depth_to_color is None else 0


def _depth_view(
    shape: Shape, camera: Camera, options: SceneOptions
) -> tuple[Camera | None, Floats]:
    """The depth camera, None for the colour camera's view, and (h, w) its pixels' true depth.

    Means over a pixel's area; one that the object does not fill gives no measurement.
    """
    width = max(round(camera.width / options.depth_factor), 1)
    # whole pixels, of the same view
    own = camera.resized(width, max(round(camera.height * width / camera.width), 1))
    rays, pose = max(round(options.depth_factor), 2), options.depth_to_color
    fine = own.scaled(rays)
    solid = shape.solid if pose is None or shape.solid is None else seen_from(shape.solid, pose)

    def means(rows: slice) -> Floats:
        lines = slice(rays * rows.start, rays * rows.stop)
        if solid is None:
            return area_mean(shape.render(fine, lines).depth, rays)
        return area_mean(first_hits(solid, fine, lines), rays)

    depth_m = np.concatenate(list(_on_all_cores(means, iter(_strips(own, rays, 1)))))
    return (None if pose is None else own), depth_m


def _sense_depth(depth_m: Floats, options: SceneOptions) -> Floats:
    """(K, h, w) what the depth sensor reports: the truth with its errors.

    Raises InputError where none of its pixels lies on the object whole.
    """
    if not np.isfinite(depth_m).any():
        raise InputError(
            "no depth pixel lies on the object whole",
            source="depth_factor",
            seen=f"{options.depth_factor:g}, {depth_m.shape[1]} x {depth_m.shape[0]} depth pixels",
            needed="depth pixels smaller than the object",
            remedy="a smaller factor or a larger image"
            if options.depth_to_color is None
            else "a smaller factor, a larger image, or a depth camera that sees the object",
        )
    return np.stack(
        [
            add_depth_noise(depth_m, options.depth_noise, [options.seed, DEPTH_STREAM, frame])
            for frame in range(options.depth_frames)
        ]
    )
