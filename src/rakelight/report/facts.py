"""What was done, in words and figures, for the report's tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import numpy as np

from rakelight.errors import printable
from rakelight.export.plain import plain
from rakelight.export.summary import STAGES
from rakelight.geometry.camera import focal_px
from rakelight.model import Result
from rakelight.pictures.shown import prepared_mask

Rows = list[tuple[str, str]]


def title_of(result: Result) -> str:
    """The capture's name: the last part of where it came from.

    Characters that do not print, or reverse the text around them, are escaped.
    """
    source = printable(result.source)
    return PurePath(source).name or source or "result"


def capture_rows(result: Result) -> Rows:
    """What was photographed and measured."""
    read, rows = result.capture, []
    if read:
        kinds = {"moving-lamp": "moving lamp", "rgb-leds": "red, green and blue LEDs"}
        rows.append(
            (
                "Photographs",
                f"{read['photographs']}, {_size(read['photograph_size'])}, {read['bits']} bit, "
                f"{read['encoding']}; {kinds.get(read['lighting'], read['lighting'])}",
            )
        )
        rows.append(("Depth maps", f"{read['depth_maps']}, {_size(read['depth_size'])}"))
    else:
        rows.append(("Photographs", str(len(result.lights))))
    z = float(np.median(result.depth[result.mask]))
    pixels = int(result.mask.sum())
    rows += [
        ("Object", f"{pixels:,} pixels at a median depth of {1000 * z:,.0f} mm"),
        ("One pixel covers", f"{1000 * z / focal_px(result.camera):.3g} mm of the object"),
        ("Result", _size([result.camera.width, result.camera.height])),
    ]
    if result.source:
        rows.append(("Read from", printable(result.source)))
    return rows


def method_rows(result: Result) -> Rows:
    """What was computed, and how it ended."""
    ended = "came to rest" if result.converged else "stopped before it came to rest"
    rows = [("Method", result.method), ("Iterations", f"{result.iterations}; {ended}")]
    prepared = prepared_mask(result)
    if prepared.any():
        moved = 1000 * np.abs(result.depth - result.prepared_depth)[prepared]
        rows.append(
            ("Depth moved by", f"{np.median(moved):.2f} mm, the median; 95 % by less than "
             f"{np.quantile(moved, 0.95):.2f} mm")
        )  # fmt: skip
    confidence = result.confidence[result.mask]
    rows.append(
        ("Confidence", f"{np.median(confidence):.2f}, the median; above one half on "
         f"{100 * np.mean(confidence > 0.5):.0f} % of the object")
    )  # fmt: skip
    if (expected := result.expected_errors) is not None:
        depth_m, normals_deg = expected
        rows.append(
            ("Expected errors", f"{1000 * depth_m:.2f} mm in depth, {normals_deg:.1f} degrees in "
             "normals, medians")
        )  # fmt: skip
    stages = {name: seconds for name, seconds in result.timings_s.items() if name in STAGES}
    if stages:
        parts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in stages.items())
        rows.append(("Seconds", f"{sum(stages.values()):.1f} ({parts})"))
    return rows


def option_rows(options: Mapping[str, Any]) -> Rows:
    """Every parameter with its value.

    >>> option_rows({"depth_weight": None, "near": True})
    [('depth weight', 'chosen from the data'), ('near', 'yes')]
    """
    words = {None: "chosen from the data", True: "yes", False: "no"}

    def shown(value: Any) -> str:
        if value is None or isinstance(value, bool):
            return words[value]
        return f"{value:g}" if isinstance(value, float) else printable(str(value))

    return [(key.replace("_", " "), shown(value)) for key, value in plain(options).items()]


def _size(sides: list[int]) -> str:
    return f"{sides[0]} × {sides[1]} pixels"
