"""The report: template, style, viewer, maps and pictures in one file that asks for nothing."""

from __future__ import annotations

from typing import Any

import numpy as np

from rakelight.errors import printable
from rakelight.geometry.normals import surface_normals
from rakelight.metrics import evaluate_maps
from rakelight.model import Result, Truth
from rakelight.pictures.colors import CONFIDENCE_COLORS
from rakelight.report import charts, facts
from rakelight.report.encoded_maps import pack, viewer_maps
from rakelight.report.pictures import result_pictures, truth_pictures
from rakelight.report.template import page_text, rendered

# In this order they are one script.
VIEWER = ("encoded_maps.js", "mesh.js", "view.js", "scene.js", "measure.js", "main.js")


def report_html(result: Result, truth: Truth | None = None) -> bytes:
    """The report of a finite result (`geometry.finite.only_finite`) as UTF-8 HTML.

    truth : at the result's resolution, for the errors; None for none
    """
    names = tuple(map(printable, result.photograph_names))
    lights = charts.drawn_lights(result.lights, names)
    maps = viewer_maps(result)
    encoded, viewer = pack(maps)
    viewer |= {
        "ramp": [[value / 255 for value in color] for color in CONFIDENCE_COLORS],
        "lights": charts.viewer_lights(lights),
    }
    page = rendered(
        page_text("page.html"),
        style=page_text("page.css"),
        script=_script(),
        title=facts.title_of(result),
        result=result,
        warnings=[f for f in result.findings if f.severity == "warning"],
        notes=[f for f in result.findings if f.severity != "warning"],
        capture_rows=facts.capture_rows(result),
        method_rows=facts.method_rows(result),
        option_rows=facts.option_rows(result.options),
        lights=lights,
        aims=viewer["lights"],
        tilts=charts.tilts(lights) if lights else None,
        energy=charts.energy_curve(result.energy),
        prediction=_prediction(result, names),
        pictures=result_pictures(maps),
        truth=None if truth is None else _against(result, truth),
        shrunk=maps.shrunk,
        encoded_maps=encoded,
        viewer=viewer,
    )
    return page.encode("utf-8", "backslashreplace")


def _prediction(result: Result, names: tuple[str, ...]) -> dict[str, Any] | None:
    errors = [error for error in result.prediction_errors if np.isfinite(error)]
    if not errors:
        return None
    bars = charts.error_bars(result.prediction_errors, names)
    worst = max((bar for bar in bars if bar["percent"] is not None), key=lambda b: b["percent"])
    return {"median": 100 * float(np.median(errors)), "worst": worst, "bars": bars}


def _against(result: Result, truth: Truth) -> dict[str, Any]:
    normals = surface_normals(result.prepared_depth, truth.mask, result.camera)
    before, after = (result.prepared_depth, normals), (result.depth, result.normals)
    return {
        "rows": [
            ("before", evaluate_maps(*before, truth)),
            ("after", evaluate_maps(*after, truth)),
        ],
        "pictures": truth_pictures(before, after, truth),
    }


def _script() -> str:
    parts = "\n".join(page_text(f"viewer/{name}") for name in VIEWER)
    return f'(() => {{\n"use strict";\n{parts}\n}})();\n'
