"""Captures with known truth: an object, its paint, lights and sensors.

Photographs are rendered with several rays per pixel and averaged in linear light, from exact
normals, so that they owe nothing to the differences by which a method takes its normals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias, get_args

import numpy as np

from rakelight.errors import InputError
from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import area_mean
from rakelight.memory import require_memory
from rakelight.model import (
    Array,
    Camera,
    Capture,
    Encoding,
    Floats,
    Lighting,
    Lights,
    Mask,
    RigidTransform,
    Truth,
)
from rakelight.prepare.linear import srgb
from rakelight.synthetic.albedo import Albedo, make_albedo
from rakelight.synthetic.implicit import Surface, seen_from, trace
from rakelight.synthetic.noise import PERFECT, DepthNoise, add_depth_noise
from rakelight.synthetic.shapes import SHAPES, Shape, make_shape

Conditions: TypeAlias = list[tuple[str, bool, str]]


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneOptions:
    """All about a scene but its object and paint.

    Lights
        lighting : "moving-lamp": one white lamp, many photographs; "rgb-leds": one photograph
            under a red, a green and a blue lamp, each seen by its own channel only; "ambient":
            one photograph in broad natural light from above
        photographs : how many, moving lamp only
        tilt_deg : least and largest angle between the moving lamp and the optical axis, seen
            from the object; the lights are spread evenly over that ring
        led_tilt_deg, led_azimuth_deg : of the red, green and blue lamp; azimuth 0 is to the
            right, 90 below
        lamp_distance_m : from the middle of the object; None for distant lights
        ambient : light from everywhere, as a fraction of the lamp's on a surface that faces it;
            None for 0.1 (lights) or 0.5 (natural light)
        exposure_spread : standard deviation of the photographs' exposures, logarithmic
    Surface
        specular : height of the highlight (Blinn-Phong) over white paint that faces the lamp
        specular_exponent : the larger, the smaller the highlight
        cast_shadows : whether parts of the object shade others; attached shadows are always there
    Camera
        camera : None for the shape's own
        supersampling : rays per pixel along each side
        exposure : the value, 1 being white, of white paint that faces a lamp; None to choose it
            so that the brightness which only 1 - `peak_quantile` of the object's values exceed
            becomes `peak`
        image_noise : standard deviation, fraction of white, linear light
        bits : 8 or 16
        encoding : "linear" or "srgb"
    Depth sensor
        depth_factor : colour pixels per depth pixel, along each side; need not be whole
        depth_to_color : the place of a depth camera of its own, None for the colour camera's; of
            analytic shapes only
        depth_frames : how many depth maps, with noise of their own
        depth_noise : the sensor's errors
    seed : of everything random; each part has its own stream
    """

    lighting: Lighting = "moving-lamp"
    photographs: int = 12
    tilt_deg: tuple[float, float] = (12.0, 40.0)
    led_tilt_deg: float = 40.0
    led_azimuth_deg: tuple[float, float, float] = (-90.0, 30.0, 150.0)
    lamp_distance_m: float | None = None
    ambient: float | None = None
    exposure_spread: float = 0.0
    specular: float = 0.0
    specular_exponent: float = 40.0
    cast_shadows: bool = False
    camera: Camera | None = None
    supersampling: int = 2
    exposure: float | None = None
    peak: float = 0.9
    peak_quantile: float = 0.995
    image_noise: float = 0.01
    bits: int = 16
    encoding: Encoding = "linear"
    depth_factor: float = 1
    depth_to_color: RigidTransform | None = None
    depth_frames: int = 1
    depth_noise: DepthNoise = PERFECT
    seed: int = 0

    def __post_init__(self) -> None:
        for name, possible, needed in self._conditions():
            if not possible:
                raise InputError(
                    "not a possible scene",
                    source=name,
                    seen=f"{getattr(self, name)}",
                    needed=needed,
                )

    def _conditions(self) -> Conditions:
        """(option, whether it is possible, what would be)."""

        def all_of(needed: str, test: Callable[[Any], bool], *names: str) -> Conditions:
            return [(name, test(getattr(self, name)), needed) for name in names]

        low, high = self.tilt_deg
        return [
            *all_of(
                "moving-lamp, rgb-leds or ambient", get_args(Lighting).__contains__, "lighting"
            ),
            *all_of("linear or srgb", get_args(Encoding).__contains__, "encoding"),
            *all_of("8 or 16", (8, 16).__contains__, "bits"),
            (
                "camera",
                self.camera is None or self.camera.distortion is None,
                "one without lens distortion, which rakelight.synthetic.distorted adds",
            ),
            ("tilt_deg", 0 <= low <= high < 90, "two angles, 0 <= least <= largest < 90"),
            *all_of("0 <= angle < 90", lambda angle: 0 <= angle < 90, "led_tilt_deg"),
            *all_of("three angles", lambda angles: len(angles) == 3, "led_azimuth_deg"),
            *all_of("above 0, at most 1", lambda share: 0 < share <= 1, "peak_quantile"),
            *all_of(
                "a whole number from 1",
                lambda count: isinstance(count, int) and count >= 1,
                *("photographs", "supersampling", "depth_frames"),
            ),
            ("depth_factor", 1 <= self.depth_factor <= 100, "1 to 100"),
            *all_of("at least 0", lambda value: value >= 0, "seed"),
            *all_of("0 to 10", lambda value: 0 <= value <= 10, "exposure_spread"),
            *all_of(
                "0 to a million",
                lambda value: value is None or 0 <= value <= 1e6,
                *("ambient", "specular", "specular_exponent", "image_noise"),
            ),
            *all_of(
                "above 0, at most a million",
                lambda value: value is None or 0 < value <= 1e6,
                *("lamp_distance_m", "exposure", "peak"),
            ),
        ]


def render_scene(
    shape: Shape, albedo: Albedo, options: SceneOptions | None = None
) -> tuple[Capture, Truth]:
    """The capture that a camera and a depth sensor make of an object, and what is true of it.

    The truth is exact at the pixel centres of the colour camera.  Its mask, and the capture's,
    leaves out the pixels that the object does not cover whole.  Its lights are those of the
    photographs' linear values, white being 1: photograph = albedo * (max(0, s.n) + ambient),
    where nothing is shaded or shines.  The middle of near lights is the visible points' mean.

    Raises InputError when the camera does not see the object, MachineError when there is too little
    memory.

    >>> options = SceneOptions(camera=make_shape("sphere").camera.scaled(0.1), photographs=4)
    >>> capture, truth = render_scene(make_shape("sphere"), make_albedo("white"), options)
    >>> capture.photographs.shape, round(float(np.nanmin(truth.depth)), 3)
    ((4, 36, 48, 3), 0.7)
    """
    options = options or SceneOptions()
    camera = options.camera or shape.camera
    _require_memory(camera, options)
    surface = shape.render(camera)
    fine_camera = camera.scaled(options.supersampling)
    fine = shape.render(fine_camera) if options.supersampling > 1 else surface
    mask = surface.mask & (area_mean(fine.mask, options.supersampling) == 1)
    _require_object(mask, shape)
    paint = albedo.paint(fine_camera)
    lights = _lights(options, _center_m(surface.depth, mask, camera))
    light = _photograph(fine, fine_camera, paint, lights, options)
    level = options.exposure or options.peak / float(
        np.quantile(light[:, mask], options.peak_quantile)
    )
    light *= np.float32(level)
    depth_camera, depth_m = _depth_view(shape, surface, camera, options)
    capture = Capture(
        photographs=_develop(light, options),
        depth_m=_sense_depth(depth_m, options),
        mask=mask,
        camera=camera,
        encoding=options.encoding,
        lighting=options.lighting,
        depth_camera=depth_camera,
        depth_to_color=options.depth_to_color,
        names=tuple(f"{i:03d}.png" for i in range(len(light))),
    )
    seen = area_mean(paint, options.supersampling)
    return capture, _truth(surface, mask, seen, lights.as_lights(level))


def _require_object(mask: Mask, shape: Shape) -> None:
    if mask.any():
        return
    height, width = mask.shape
    raise InputError(
        "the camera does not see the object",
        source=shape.name,
        seen=f"{width} x {height} pixels",
        needed="at least one that lies on it whole",
    )


def _truth(surface: Surface, mask: Mask, albedo: Floats, lights: Lights) -> Truth:
    """What is true within the mask (h, w)."""
    inside = mask[..., None]
    return Truth(
        depth=np.where(mask, surface.depth, np.nan).astype(np.float32),
        normals=np.where(inside, surface.normals, np.nan).astype(np.float32),
        albedo=np.where(inside, albedo, 0).astype(np.float32),
        lights=lights,
    )


DEMO_OPTIONS = SceneOptions(
    photographs=12,
    depth_factor=2,
    depth_noise=DepthNoise(rms_mm=2.5, correlation_length_px=6.0, step_mm=1.0, hole_fraction=0.01),
)


def demo_scene(seed: int = 0) -> tuple[Capture, Truth]:
    """The scene of `rakelight demo`: a painted vase, twelve lights, half-resolution depth.

    >>> capture, truth = demo_scene()
    >>> capture.photographs.shape, capture.depth_m.shape
    ((12, 360, 480, 3), (1, 180, 240))
    """
    options = replace(DEMO_OPTIONS, seed=seed)
    return render_scene(make_shape("vase"), make_albedo("pattern"), options)


# Bytes per pixel that rendering needs at the least: measured, rounded down.
_BYTES_PER_RAY, _BYTES_PER_PHOTOGRAPH, _BYTES_PER_FRAME = 350, 17, 8

# The parts of a scene draw from streams of their own: more lights do not change the depth noise.
LAMP_STREAM, EXPOSURE_STREAM, IMAGE_STREAM, DEPTH_STREAM = range(4)


def _depth_size(camera: Camera, factor: float) -> tuple[int, int]:
    """(w, h) of the depth map under photographs of a camera: whole pixels, of the same view."""
    width = max(round(camera.width / factor), 1)
    return width, max(round(camera.height * width / camera.width), 1)


def _require_memory(camera: Camera, options: SceneOptions) -> None:
    photographs = 1 if options.lighting != "moving-lamp" else options.photographs
    rays, frames = options.supersampling**2, options.depth_frames / options.depth_factor**2
    require_memory(
        camera.width
        * camera.height
        * (_BYTES_PER_RAY * rays + _BYTES_PER_PHOTOGRAPH * photographs + _BYTES_PER_FRAME * frames),
        source="the scene",
        remedy="fewer --lights or --depth-frames, or a smaller --size",
    )


# ---- lights


@dataclass(frozen=True)
class _SceneLights:
    """Lights of unit irradiance at the object's middle, times the photographs' exposures.

    toward : (N, C, 3) unit vectors from the object's middle
    gain : (N,) exposures
    ambient : fraction of a lamp's irradiance
    center_m : (3,) the object's middle
    distance_m : of the lights from there, None for distant ones
    """

    toward: Floats
    gain: Floats
    ambient: float
    center_m: Floats
    distance_m: float | None

    def at(self, points_m: Floats, photograph: int, channel: int) -> Floats:
        """(M, 3) or (1, 3) s(X) at points (M, 3): Phi (P - X) / |P - X|^3 for a near lamp."""
        toward = self.toward[photograph, channel]
        if self.distance_m is None:
            return np.asarray(self.gain[photograph] * toward[None])
        way = self.way(points_m, photograph, channel)
        power = self.gain[photograph] * self.distance_m**2
        return np.asarray(power * way / np.linalg.norm(way, axis=1, keepdims=True) ** 3)

    def way(self, points_m: Floats, photograph: int, channel: int) -> Floats:
        """(M, 3) from the points to the lamp; to 100 m off for a distant one."""
        toward = self.toward[photograph, channel]
        if self.distance_m is None:
            return np.broadcast_to(100.0 * toward, points_m.shape)
        return np.asarray(self.center_m + self.distance_m * toward - points_m)

    def as_lights(self, level: float) -> Lights:
        channels = self.toward.shape[1]
        gain = level * self.gain
        ambient = np.repeat((gain * self.ambient)[:, None], channels, axis=1)
        vector = gain[:, None, None] * self.toward
        if self.distance_m is None:
            return Lights(vector, ambient)
        position = self.center_m + self.distance_m * self.toward
        return Lights(vector, ambient, position, self.center_m)


def _lights(options: SceneOptions, center_m: Floats) -> _SceneLights:
    if options.lighting == "moving-lamp":
        toward = _ring(options)[:, None]
    elif options.lighting == "rgb-leds":
        toward = _toward(np.full(3, options.led_tilt_deg), np.array(options.led_azimuth_deg))[None]
    else:
        toward = _toward(np.array([35.0]), np.array([-110.0]))[None]
    rng = np.random.default_rng([options.seed, EXPOSURE_STREAM])
    gain = np.exp(options.exposure_spread * rng.standard_normal(len(toward)))
    usual = 0.5 if options.lighting == "ambient" else 0.1
    ambient = usual if options.ambient is None else options.ambient
    return _SceneLights(toward, gain, ambient, center_m, options.lamp_distance_m)


def _toward(tilt_deg: Floats, azimuth_deg: Floats) -> Floats:
    """(N, 3) unit vectors towards lights: tilt off the optical axis, azimuth from right to down."""
    tilt, azimuth = np.radians(tilt_deg), np.radians(azimuth_deg)
    return np.stack(
        [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)], axis=-1
    )


def _ring(options: SceneOptions) -> Floats:
    """(N, 3) directions spread evenly over the ring of `tilt_deg`, turned by the seed.

    A golden spiral, even in solid angle; each next lamp is the one farthest from those before,
    so that the first few are spread as well.
    """
    share = (np.arange(options.photographs) + 0.5) / options.photographs
    low, high = np.cos(np.radians(options.tilt_deg))
    turn = np.random.default_rng([options.seed, LAMP_STREAM]).uniform(0, 360)
    azimuth_deg = turn + np.arange(share.size) * 180 * (3 - np.sqrt(5))
    toward = _toward(np.degrees(np.arccos(low + (high - low) * share)), azimuth_deg)
    order = [share.size - 1]
    while len(order) < share.size:
        order.append(int(np.argmin((toward @ toward[order].T).max(axis=1))))
    return np.asarray(toward[order])


# ---- photographs


def _center_m(depth_m: Floats, mask: Mask, camera: Camera) -> Floats:
    """(3,) mean of the visible points."""
    return np.asarray(back_project(depth_m, camera)[mask].mean(axis=0))


def _photograph(
    fine: Surface, camera: Camera, paint: Floats, lights: _SceneLights, options: SceneOptions
) -> Floats:
    """(N, H, W, 3) float32 linear light of all photographs, at the colour camera's resolution."""
    hit = np.flatnonzero(fine.mask)
    points = back_project(fine.depth, camera).reshape(-1, 3)[hit]
    normals = fine.normals.reshape(-1, 3)[hit]
    rho = paint.reshape(-1, 3)[hit]
    size = (side // options.supersampling for side in camera.shape)
    images = np.empty((len(lights.toward), *size, 3), np.float32)
    for i, channels in enumerate(lights.toward):
        shading, specular = np.empty_like(rho), np.zeros_like(rho)
        for c in range(len(channels)):
            s = lights.at(points, i, c)
            lit = np.maximum((normals * s).sum(axis=1), 0)
            if options.cast_shadows:
                from rakelight.photometry.cast_shadows import in_sight

                lit *= in_sight(fine.depth, camera, points, lights.way(points, i, c))
            seen_by = slice(None) if len(channels) == 1 else slice(c, c + 1)
            shading[:, seen_by] = lit[:, None]
            if options.specular:
                specular[:, seen_by] = _highlight(normals, points, s, lit > 0, options)[:, None]
        light = np.zeros((camera.height * camera.width, 3), np.float32)
        light[hit] = rho * (shading + lights.gain[i] * lights.ambient) + specular
        images[i] = area_mean(light.reshape(*camera.shape, 3), options.supersampling)
    return images


def _highlight(
    normals: Floats, points_m: Floats, s: Floats, lit: Mask, options: SceneOptions
) -> Floats:
    """(M,) Blinn-Phong: the lamp's strength times a power of the halfway vector's cosine."""
    strength = np.linalg.norm(s, axis=-1)
    halfway = s / strength[:, None] - points_m / np.linalg.norm(points_m, axis=1, keepdims=True)
    halfway /= np.linalg.norm(halfway, axis=1, keepdims=True)
    cosine = np.maximum((normals * halfway).sum(axis=1), 0)
    return np.asarray(options.specular * strength * cosine**options.specular_exponent * lit)


def _develop(light: Floats, options: SceneOptions) -> Array:
    """Linear light to pixel values: sensor noise, clipping, encoding, rounding."""
    rng = np.random.default_rng([options.seed, IMAGE_STREAM])
    white = 2**options.bits - 1
    values = np.empty(light.shape, np.uint8 if options.bits == 8 else np.uint16)
    for image, value in zip(light, values, strict=True):
        noise = options.image_noise * rng.standard_normal(image.shape, dtype=np.float32)
        exposed = np.clip(image + noise, 0, 1)
        value[:] = np.rint(white * (srgb(exposed) if options.encoding == "srgb" else exposed))
    return values


# ---- depth


def _depth_view(
    shape: Shape, surface: Surface, camera: Camera, options: SceneOptions
) -> tuple[Camera | None, Floats]:
    """The depth camera, None for the colour camera's view, and (h, w) its pixels' true depth.

    Means over a pixel's area; one that the object does not fill gives no measurement.
    """
    factor = options.depth_factor
    own, rays = camera.resized(*_depth_size(camera, factor)), max(round(factor), 2)
    if options.depth_to_color is None:
        if camera.width % factor == camera.height % factor == 0 and factor % 1 == 0:
            return None, area_mean(surface.depth, int(factor))
        return None, area_mean(shape.render(own.scaled(rays)).depth, rays)
    if shape.solid is None:
        raise InputError(
            "this object can be seen from the colour camera's place only",
            source="depth_to_color",
            seen=shape.name,
            needed="one of " + ", ".join(SHAPES),
        )
    seen = trace(seen_from(shape.solid, options.depth_to_color), own.scaled(rays))
    return own, area_mean(seen.depth, rays)


def _sense_depth(depth_m: Floats, options: SceneOptions) -> Floats:
    """(K, h, w) what the depth sensor reports: the truth with its errors."""
    return np.stack(
        [
            add_depth_noise(depth_m, options.depth_noise, [options.seed, DEPTH_STREAM, frame])
            for frame in range(options.depth_frames)
        ]
    )
