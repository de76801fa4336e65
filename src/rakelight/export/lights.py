"""lights.json."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import numpy as np

from rakelight.errors import InputError, parsing
from rakelight.export.plain import json_bytes
from rakelight.model import FARTHEST_M, Floats, Lights

SCHEMA = "rakelight-lights/1"


def lights_json(lights: Lights, names: tuple[str, ...] = ()) -> bytes:
    """JSON with every photograph's light; `names` are the photographs' file names."""
    return json_bytes(lights_table(lights, names))


def lights_table(lights: Lights, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """Direction, intensity and ambient of every photograph and channel, camera frame.

    >>> lights = Lights(vector=np.array([[[0.0, 0.0, -2.0]]]), ambient=np.array([[0.1]]))
    >>> lights_table(lights, ("000.png",))["photographs"][0]["channels"]["white"]
    {'direction': [0.0, 0.0, -1.0], 'intensity': 2.0, 'ambient': 0.1, 'position_m': None,
     'beam': None}
    """
    channels = _CHANNELS[0] if lights.vector.shape[1] == 1 else _CHANNELS[1]
    photographs = [
        {
            "name": names[i] if i < len(names) else None,
            "channels": {channel: _lamp(lights, i, c) for c, channel in enumerate(channels)},
            "position_m": _position(lights, i, slice(None)),
        }
        for i in range(len(lights))
    ]
    return {
        "schema": SCHEMA,
        "frame": "camera: x right, y down, z forward; directions point towards the lamp",
        "model": "value = albedo * (max(0, s . normal) + ambient * (1 + ambient_direction . "
        "normal)), ambient_direction null for 0; s = intensity * direction at middle_m and for "
        "distant lights everywhere; at X from a lamp at P = position_m, s = intensity * (P - X) / "
        "|P - X| * (|P - middle_m| / |P - X|)^2; with beam [b_x, b_y, w] and Y = X - middle_m, s "
        "is multiplied by exp(b_x Y_x + b_y Y_y + w (direction . Y)^2)",
        "ambient_direction": None
        if lights.ambient_direction is None
        else _numbers(lights.ambient_direction),
        "middle_m": None if lights.middle_m is None else _numbers(lights.middle_m),
        "photographs": photographs,
    }


def parse_lights(data: bytes, *, source: str) -> Lights:
    """The lights in the bytes of a lights.json; `source` names the file in messages.

    A distant lamp among near ones stands at `FARTHEST_M`.  Raises InputError when it is not one, is
    of another version, its photographs have different channels, or a direction is too long.

    >>> lights = Lights(vector=np.array([[[0.0, 0.0, -2.0]]]), ambient=np.array([[0.1]]))
    >>> parse_lights(lights_json(lights), source="lights.json").vector.tolist()
    [[[0.0, 0.0, -2.0]]]
    """
    with parsing(source, "not a lights.json"):
        stored = msgspec.json.decode(data, type=_LightsFile)
    if stored.schema != SCHEMA:
        raise InputError(
            "a lights.json of another version", source=source, seen=stored.schema, needed=SCHEMA
        )
    kinds = {tuple(photograph.channels) for photograph in stored.photographs}
    if len(kinds) != 1 or not kinds <= set(_CHANNELS):
        raise InputError(
            "the photographs' channels do not fit",
            source=source,
            seen=" and ".join(sorted("/".join(kind) for kind in kinds)) or "no photograph",
            needed=" or ".join("/".join(kind) for kind in _CHANNELS),
        )
    lights = [list(photograph.channels.values()) for photograph in stored.photographs]
    direction = np.array([[lamp.direction for lamp in row] for row in lights], float)
    longest = float(np.nanmax(np.abs(direction), initial=0.0))
    if longest > _LONGEST:
        raise InputError(
            "a direction is no unit vector", source=source, seen=f"a component of {longest:g}"
        )
    intensity = np.array([[lamp.intensity for lamp in row] for row in lights], float)
    ambient = np.array([[lamp.ambient for lamp in row] for row in lights], float)
    uneven = stored.ambient_direction and np.array(stored.ambient_direction, float)
    found = Lights(intensity[..., None] * direction, ambient, ambient_direction=uneven)
    if stored.middle_m is None:
        return found
    middle_m = np.array(stored.middle_m, float)
    position_m, beam = middle_m + FARTHEST_M * direction, np.zeros_like(direction)
    for i, row in enumerate(lights):
        for channel, lamp in enumerate(row):
            if lamp.position_m is not None:
                position_m[i, channel] = lamp.position_m
            if lamp.beam is not None:
                beam[i, channel] = lamp.beam
    lamps = [lamp for row in lights for lamp in row]
    if all(lamp.beam is None for lamp in lamps):
        return replace(found, position_m=position_m, middle_m=middle_m)
    near = any(lamp.position_m is not None for lamp in lamps)
    places = position_m if near else None
    return replace(found, position_m=places, middle_m=middle_m, beam=beam)


_LONGEST = 1.001  # of a component of a unit vector, rounded
_CHANNELS = (("white",), ("red", "green", "blue"))
# null is a number that was not finite.
_Vector = tuple[float | None, float | None, float | None]


class _Light(msgspec.Struct):
    direction: _Vector
    intensity: float | None
    ambient: float | None
    position_m: _Vector | None = None
    beam: _Vector | None = None


class _Photograph(msgspec.Struct):
    channels: dict[str, _Light]


class _LightsFile(msgspec.Struct):
    schema: str
    photographs: list[_Photograph]
    middle_m: _Vector | None = None
    ambient_direction: _Vector | None = None


def _lamp(lights: Lights, i: int, channel: int) -> dict[str, Any]:
    return {
        "direction": _numbers(lights.direction[i, channel]),
        "intensity": float(lights.intensity[i, channel]),
        "ambient": float(lights.ambient[i, channel]),
        "position_m": _position(lights, i, slice(channel, channel + 1)),
        "beam": None if lights.beam is None else _numbers(lights.beam[i, channel]),
    }


def _position(lights: Lights, i: int, channels: slice) -> list[float] | None:
    """Mean place of a photograph's lights in some channels, None if one of them is distant."""
    distance_m = lights.distance_m
    if lights.position_m is None or distance_m is None:
        return None
    if not np.isfinite(distance_m[i, channels]).all():
        return None
    return _numbers(lights.position_m[i, channels].mean(axis=0))


def _numbers(values: Floats) -> list[float]:
    return [float(value) for value in values]
