"""lights.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from rakelight.export.plain import json_bytes
from rakelight.model import Floats, Lights

SCHEMA = "rakelight-lights/1"


def lights_json(lights: Lights, names: tuple[str, ...] = ()) -> bytes:
    """JSON with every photograph's light; `names` are the photographs' file names."""
    return json_bytes(lights_table(lights, names))


def lights_table(lights: Lights, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """Direction, intensity and ambient of every photograph and channel, camera frame.

    >>> lights = Lights(vector=np.array([[[0.0, 0.0, -2.0]]]), ambient=np.array([[0.1]]))
    >>> lights_table(lights, ("000.png",))["photographs"][0]["channels"]["white"]
    {'direction': [0.0, 0.0, -1.0], 'intensity': 2.0, 'ambient': 0.1, 'position_m': None}
    """
    channels = ("white",) if lights.vector.shape[1] == 1 else ("red", "green", "blue")
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
        "model": "value = albedo * (max(0, s . normal) + ambient), s = intensity * direction at "
        "middle_m and for distant lamps everywhere; at X from a lamp at P = position_m, "
        "s = intensity * (P - X) / |P - X| * (|P - middle_m| / |P - X|)^2",
        "middle_m": None if lights.middle_m is None else _numbers(lights.middle_m),
        "photographs": photographs,
    }


def _lamp(lights: Lights, i: int, channel: int) -> dict[str, Any]:
    return {
        "direction": _numbers(lights.direction[i, channel]),
        "intensity": float(lights.intensity[i, channel]),
        "ambient": float(lights.ambient[i, channel]),
        "position_m": _position(lights, i, slice(channel, channel + 1)),
    }


def _position(lights: Lights, i: int, channels: slice) -> list[float] | None:
    """Mean place of a photograph's lamps in some channels, None if one of them is distant."""
    distance_m = lights.distance_m
    if lights.position_m is None or distance_m is None:
        return None
    if not np.isfinite(distance_m[i, channels]).all():
        return None
    return _numbers(lights.position_m[i, channels].mean(axis=0))


def _numbers(values: Floats) -> list[float]:
    return [float(value) for value in values]
