"""What a scene is made of: its lights, surface, camera and depth sensor."""

from __future__ import annotations

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias, get_args

from rakelight.errors import InputError
from rakelight.model import Camera, Encoding, Lighting, RigidTransform
from rakelight.synthetic.noise import PERFECT, DepthNoise

Conditions: TypeAlias = list[tuple[str, bool, str]]

# Largest numbers: as many photographs as a capture may have lights for.  Beyond them the numbers
# themselves fill the memory.
_MOST = {"photographs": 10_000, "supersampling": 64, "depth_frames": 10_000}


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

    @property
    def count(self) -> int:
        """How many photographs the scene has: one, but under a moving lamp."""
        return self.photographs if self.lighting == "moving-lamp" else 1

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
            return [(name, _holds(test, getattr(self, name)), needed) for name in names]

        return [
            *all_of(
                "moving-lamp, rgb-leds or ambient", get_args(Lighting).__contains__, "lighting"
            ),
            *all_of("linear or srgb", get_args(Encoding).__contains__, "encoding"),
            *all_of("8 or 16", (8, 16).__contains__, "bits"),
            *all_of(
                "one without lens distortion, which rakelight.synthetic.distorted adds",
                lambda camera: camera is None or camera.distortion is None,
                "camera",
            ),
            *all_of(
                "two angles, 0 <= least <= largest < 90",
                lambda angles: len(angles) == 2 and 0 <= angles[0] <= angles[1] < 90,
                "tilt_deg",
            ),
            *all_of("0 <= angle < 90", lambda angle: 0 <= angle < 90, "led_tilt_deg"),
            *all_of(
                "three angles, -360 to 360",
                lambda angles: len(angles) == 3 and all(abs(angle) <= 360 for angle in angles),
                "led_azimuth_deg",
            ),
            *all_of("a DepthNoise", lambda noise: isinstance(noise, DepthNoise), "depth_noise"),
            *all_of("above 0, at most 1", lambda share: 0 < share <= 1, "peak_quantile"),
            *(
                (
                    name,
                    isinstance(count := getattr(self, name), int) and 1 <= count <= most,
                    f"a whole number from 1 to {most}",
                )
                for name, most in _MOST.items()
            ),
            *all_of("1 to 100", lambda factor: 1 <= factor <= 100, "depth_factor"),
            *all_of("at least 0, a whole number", lambda seed: operator.index(seed) >= 0, "seed"),
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


def _holds(test: Callable[[Any], bool], value: object) -> bool:
    """Whether a value passes a test; one of another kind, as a text for a number, does not."""
    try:
        return test(value)
    except (TypeError, ValueError, AttributeError, IndexError):
        return False
