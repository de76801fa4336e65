"""The page: template, style, viewer, maps and pictures in one file that asks for nothing.

The content security policy allows the one script and the one style that are in it, by their
hashes, and pictures that are data; everything else is forbidden, requests above all.
"""

from __future__ import annotations

from base64 import b64encode
from hashlib import sha256
from importlib.resources import files
from typing import Any

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rakelight.errors import printable
from rakelight.export.pictures import CONFIDENCE_COLORS
from rakelight.export.summary import program_version
from rakelight.geometry.normals import surface_normals
from rakelight.metrics import evaluate_maps
from rakelight.model import Result, Truth
from rakelight.report import charts, facts
from rakelight.report.encoded_maps import pack, viewer_maps
from rakelight.report.pictures import result_pictures, truth_pictures

# In this order they are one script.
VIEWER = ("encoded_maps.js", "mesh.js", "view.js", "scene.js", "measure.js", "main.js")


def report_html(result: Result, truth: Truth | None = None) -> bytes:
    """The report of a finite result (`export.finite.only_finite`) as UTF-8 HTML.

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
    style, script = _style(), _script()
    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        finalize=shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.from_string(page_text("page.html")).render(
        policy=_policy(script, style),
        style=Markup(style),
        script=Markup(script),
        title=facts.title_of(result),
        version=program_version(),
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


def shown(value: Any) -> Any:
    """What the page says of a value: no text from outside reverses or hides the text around it."""
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def page_text(name: str) -> str:
    """The content of a file of this folder."""
    return files("rakelight.report").joinpath(name).read_text(encoding="utf-8")


def _style() -> str:
    return page_text("page.css")


def _script() -> str:
    parts = "\n".join(page_text(f"viewer/{name}") for name in VIEWER)
    return f'(() => {{\n"use strict";\n{parts}\n}})();\n'


def _policy(script: str, style: str) -> str:
    """What the page may do: run this script, use this style, show pictures that are data."""
    script_hash, style_hash = (
        b64encode(sha256(text.encode()).digest()).decode() for text in (script, style)
    )
    return (
        f"default-src 'none'; script-src 'sha256-{script_hash}'; "
        f"style-src 'sha256-{style_hash}'; img-src data:; base-uri 'none'; form-action 'none'"
    )
