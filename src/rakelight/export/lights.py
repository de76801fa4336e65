"""lights.json."""

from __future__ import annotations

from typing import Any

import numpy as np

from rakelight.export.plain import json_bytes
from rakelight.model import Lights

SCHEMA = "rakelight-lights/1"


def lights_json(lights: Lights, names: tuple[str, ...] = ()) -> bytes:
    """JSON with every photograph's light; `names` are the photographs' file names."""
    return json_bytes(lights_table(lights, names))


def lights_table(lights: Lights, names: tuple[str, ...] = ()) -> dict[str, Any]:
    """Direction, intensity and ambient of every photograph and channel, camera frame.

    >>> lights = Lights(vector=np.array([[[0.0, 0.0, -2.0]]]), ambient=np.array([[0.1]]))
    >>> lights_table(lights, ("000.png",))["photographs"][0]["channels"]["white"]
    {'direction': [0.0, 0.0, -1.0], 'intensity': 2.0, 'ambient': 0.1}
    """
    channels = ("white",) if lights.vector.shape[1] == 1 else ("red", "green", "blue")
    direction, intensity = lights.direction, lights.intensity
    photographs = [
        {
            "name": names[i] if i < len(names) else None,
            "channels": {
                channel: {
                    "direction": np.asarray(direction[i, c], np.float64).tolist(),
                    "intensity": float(intensity[i, c]),
                    "ambient": float(lights.ambient[i, c]),
                }
                for c, channel in enumerate(channels)
            },
            "position_m": None
            if lights.position_m is None
            else np.asarray(lights.position_m[i], np.float64).tolist(),
        }
        for i in range(len(lights))
    ]
    return {
        "schema": SCHEMA,
        "frame": "camera: x right, y down, z forward; directions point towards the lamp",
        "model": "value = albedo * (intensity * max(0, direction . normal) + ambient)",
        "photographs": photographs,
    }
