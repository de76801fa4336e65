"""Figure 5: the photographs under a moving lamp, and where the lamp was."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.model import Array, Capture, Lights, Result
from rakelight.paper.runs import MAIN, Runs
from rakelight.paper.sheet import Sheet
from rakelight.pictures.colors import photograph_picture
from rakelight.pictures.montage import in_column, in_row, panel
from rakelight.pictures.shown import object_window
from rakelight.prepare.linear import to_linear

IN_A_ROW, MOST = 4, 12
WIDTH_PX = 240


@dataclass(frozen=True, slots=True)
class LightRow:
    """One photograph's lamp as our joint method finds it.

    tilt_deg : from the optical axis; azimuth_deg : 0 is to the right, 90 below
    off_deg : angle to the true direction, None where there is no truth
    brightness : mean of the object's linear values
    """

    capture: str
    photograph: int
    tilt_deg: float
    azimuth_deg: float
    off_deg: float | None
    brightness: float


def figure5(runs: Runs) -> Sheet:
    """The bust's photographs, each with its lamp; somebody's capture's too."""
    capture, truth = runs.scene(MAIN, "moving-lamp")
    rows = _lights("bust", capture, runs.joint(), truth.lights)
    pictures = {"": _picture(capture, rows)}
    own = runs.refined()
    if own is not None:
        lights = _lights("capture", *own, None)
        pictures["_capture"] = _picture(own[0], lights)
        rows = rows + lights
    title = "Figure 5: photographs under a moving lamp"
    return Sheet("figure5", title, rows, pictures)


def _lights(name: str, capture: Capture, result: Result, truth: Lights | None) -> list[LightRow]:
    found = result.lights.direction.mean(axis=1)
    found = found / np.linalg.norm(found, axis=-1, keepdims=True)
    names = result.photograph_names  # of those that were used
    used = [capture.names.index(name) for name in names] if names else range(len(found))
    rows = []
    for i, (x, y, z) in zip(used, found, strict=True):
        off = None
        if truth is not None:
            off = float(np.degrees(np.arccos(np.clip((x, y, z) @ truth.direction[i, 0], -1, 1))))
        light = to_linear(capture.photographs[i][capture.mask], capture.encoding)
        tilt = float(np.degrees(np.arccos(np.clip(-z, -1, 1))))
        azimuth = float(np.degrees(np.arctan2(y, x)))
        rows.append(LightRow(name, i, tilt, azimuth, off, float(light.mean(dtype=np.float64))))
    return rows


def _picture(capture: Capture, lights: list[LightRow]) -> Array:
    window = object_window(capture.mask)
    panels = [
        panel(
            photograph_picture(
                to_linear(capture.photographs[row.photograph][window], capture.encoding)
            ),
            f"lamp {row.tilt_deg:.0f} deg off, at {row.azimuth_deg:.0f} deg",
            WIDTH_PX,
        )
        for row in lights[:MOST]
    ]
    rows = [panels[i : i + IN_A_ROW] for i in range(0, len(panels), IN_A_ROW)]
    return in_column(*(in_row(*row) for row in rows))
