"""The values that a check of a capture returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from rakelight.check.depth_quality import DepthQuality
from rakelight.check.next_lights import NextLight, azimuth_deg, tilt_deg
from rakelight.errors import InputError, printable
from rakelight.model import Finding, Floats

SCHEMA = "rakelight-check/1"

Verdict = Literal["good", "usable", "not usable"]


@dataclass(frozen=True)
class PhotographCheck:
    """One photograph.

    saturated, black : shares of the object; brightness : linear light of the object's brighter
        part, white = 1
    edge_px : blur of its sharpest edges, standard deviation in pixels; None without edges
    shift_px : (right, down) against most others, pixels; None where that is not known
    light : (3,) unit vector towards its lamp, camera frame; None where that is not known
    marks : what is wrong with it, a few words each
    """

    name: str
    saturated: float
    black: float
    brightness: float
    edge_px: float | None
    shift_px: tuple[float, float] | None
    light: Floats | None
    marks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Accuracy:
    """What to expect of the result, as ranges that held about three of four random captures.

    depth_mm, normals_deg : the errors that two thirds of the object's pixels are within
    """

    depth_mm: tuple[float, float]
    normals_deg: tuple[float, float]


@dataclass(frozen=True)
class CheckReport:
    """Whether a capture is any good, and what to do better.

    verdict : "good", "usable", or "not usable"; headline : the same in one line
    findings : the most important first
    method : that `refine` would take
    depth, accuracy : None where the capture is not usable and they are not known
    next_lights : the best directions for further photographs, the best first
    refusal : why the capture cannot be refined; None where it can
    timings_s : seconds
    """

    verdict: Verdict
    headline: str
    findings: tuple[Finding, ...]
    photographs: tuple[PhotographCheck, ...]
    method: str
    depth: DepthQuality | None = None
    accuracy: Accuracy | None = None
    next_lights: tuple[NextLight, ...] = ()
    refusal: InputError | None = None
    source: str = ""
    timings_s: Mapping[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The report as `rakelight check --json` prints it; docs/reference/check.md lists the keys.

        >>> report = CheckReport("good", "good", (), (), "multi-light")
        >>> report.as_dict()["verdict"], report.as_dict()["schema"]
        ('good', 'rakelight-check/1')
        """
        return {
            "schema": SCHEMA,
            "capture": printable(self.source),
            "verdict": self.verdict,
            "headline": self.headline,
            "method": self.method,
            "findings": [asdict(finding) for finding in self.findings],
            "photographs": [_photograph(each) for each in self.photographs],
            "depth": None if self.depth is None else _rounded(asdict(self.depth)),
            "accuracy": None if self.accuracy is None else _rounded(asdict(self.accuracy)),
            "next_lights": [
                {**_direction(each.direction), "words": each.words, "gain": round(each.gain, 4)}
                for each in self.next_lights
            ],
            "timings_s": _rounded(self.timings_s),
        }


def _photograph(each: PhotographCheck) -> dict[str, Any]:
    figures = {
        "saturated": each.saturated,
        "black": each.black,
        "brightness": each.brightness,
        "edge_px": each.edge_px,
        "shift_px": each.shift_px,
    }
    light = None if each.light is None else _direction(each.light)
    return {"name": each.name, **_rounded(figures), "light": light, "marks": list(each.marks)}


def _direction(direction: Floats) -> dict[str, Any]:
    return {
        "direction": [round(float(part), 4) for part in direction],
        "tilt_deg": round(tilt_deg(direction), 1),
        "azimuth_deg": round(azimuth_deg(direction), 1),
    }


def _rounded(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures for JSON, with four decimals."""

    def plain(value: Any) -> Any:
        if isinstance(value, (tuple, list)):
            return [plain(each) for each in value]
        return round(float(value), 4) if isinstance(value, (float, np.floating)) else value

    return {key: plain(value) for key, value in figures.items()}
