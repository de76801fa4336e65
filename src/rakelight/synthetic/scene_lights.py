"""The lights of a scene: where they stand, how bright they are in each photograph."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.model import Floats, Lights
from rakelight.synthetic.options import SceneOptions

# The parts of a scene draw from streams of their own: more lights do not change the depth noise.
LAMP_STREAM, EXPOSURE_STREAM, IMAGE_STREAM, DEPTH_STREAM = range(4)


@dataclass(frozen=True)
class SceneLights:
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
        """Those of photographs whose light was multiplied by `level`."""
        channels = self.toward.shape[1]
        gain = level * self.gain
        ambient = np.repeat((gain * self.ambient)[:, None], channels, axis=1)
        vector = gain[:, None, None] * self.toward
        if self.distance_m is None:
            return Lights(vector, ambient)
        position = self.center_m + self.distance_m * self.toward
        return Lights(vector, ambient, position, self.center_m)


def scene_lights(options: SceneOptions, center_m: Floats) -> SceneLights:
    """The lights of a scene around the object's middle (3,), metres."""
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
    return SceneLights(toward, gain, ambient, center_m, options.lamp_distance_m)


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
