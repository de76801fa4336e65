"""The rows of the paper's tables: which method, under which light, with which options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rakelight.methods import load_method
from rakelight.model import Capture, Lighting, ProgressCallback, Result
from rakelight.pipeline import refine


@dataclass(frozen=True)
class Row:
    """One line of a table.

    method : its name, None for the prepared input
    lighting : what the method needs to see
    settings : options that differ from the method's defaults
    paper : (RMSE mm, MAE degrees) per scenario as printed, None where the paper has no such row
    paper_seconds : runtime as printed in table 2
    """

    label: str
    method: str | None
    lighting: Lighting
    settings: Mapping[str, Any] = field(default_factory=dict)
    paper: tuple[tuple[float, float], ...] | None = None
    paper_seconds: float | None = None

    def run(self, capture: Capture, progress: ProgressCallback) -> Result:
        """Refine `capture` as this row says."""
        method = load_method(self.method or "")
        options = method.options(**self.settings)
        return refine(capture, method.name, options=options, progress=progress)


ROWS = (
    Row(
        "input reference",
        None,
        "moving-lamp",
        paper=((3.3305, 16.3096), (3.3305, 16.3096), (3.3305, 16.3096)),
    ),
    Row(
        "RGB-Fusion (no smooth)",
        "rgbd-fusion",
        "ambient",
        settings={"smooth": False},
        paper=((3.3418, 18.9115), (3.3872, 27.0026), (3.3411, 25.6574)),
    ),
    Row(
        "RGB-Fusion",
        "rgbd-fusion",
        "ambient",
        paper=((3.1751, 17.2197), (3.1890, 18.4722), (3.1708, 18.0850)),
        paper_seconds=21.64,
    ),
    Row(
        "Fusion-like (not smooth)",
        "fusion-like",
        "ambient",
        settings={"smooth": False},
        paper=((3.3475, 17.5911), (3.3459, 23.4808), (3.3898, 35.2610)),
        paper_seconds=7.75,
    ),
    Row(
        "RGB ratio",
        "rgb-ratio",
        "rgb-leds",
        paper=((1.9437, 5.0574), (2.9116, 17.5238), (3.1006, 21.2286)),
        paper_seconds=49.33,
    ),
    Row(
        "robust multi-light (as published)",
        "multi-light-alternating",
        "moving-lamp",
        paper=((2.3125, 3.8708), (1.5794, 1.7368), (1.8424, 2.6815)),
        paper_seconds=52.82,
    ),
    Row("multi-light, joint", "multi-light", "moving-lamp"),
    Row("LDR-PS", "ldr-ps", "moving-lamp"),
)
"""Table 1's rows in the paper's order, then ours.  The paper's numbers are in its table 1 and 2."""
