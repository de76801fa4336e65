"""Three small captures, and what each method makes of them, pinned in pins.json.

    python tests/quality/pins.py             compare every method with its pins
    python tests/quality/pins.py --write     pin the present numbers, after a change that is meant

The prepared input is pinned as well ("input"), so that a change of the captures is told from a
change of a method.
"""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

from rakelight.methods import METHODS, load_method
from rakelight.metrics import evaluate_depth, evaluate_maps
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

FILE = Path(__file__).with_name("pins.json")

# Different in object, paint, sensor and files, so that most of the package has a part in them.
CAPTURES = {
    "vase": (
        "pattern",
        {
            "depth_factor": 2,
            "depth_noise": DepthNoise(rms_mm=2.5, correlation_length_px=3.0, step_mm=1.0),
        },
    ),
    "cloth": (
        "complicated",
        {
            "photographs": 8,
            "bits": 8,
            "encoding": "srgb",
            "depth_noise": DepthNoise(rms_mm=3.0, correlation_length_px=8.0),
        },
    ),
    "head": (
        "simple",
        {
            "exposure_spread": 0.2,
            "depth_noise": DepthNoise(rms_mm=3.3, correlation_length_px=10.0, hole_fraction=0.02),
        },
    ),
}
SIZE = 0.5  # 240 x 180


@cache
def shape_of(name):
    """The shape of that name, which keeps what it has rendered: only the lights differ."""
    shape, views = make_shape(name), {}

    def render(camera, rows):
        key = camera, rows.start, rows.stop
        if key not in views:
            views[key] = shape.render(camera, rows)
        return views[key]

    return replace(shape, render=render)


@cache
def capture_for(name, lighting):
    """The capture of that name under the lights of `lighting`, and its truth."""
    albedo, settings = CAPTURES[name]
    shape = shape_of(name)
    options = SceneOptions(camera=shape.camera.scaled(SIZE), lighting=lighting, **settings)
    return render_scene(shape, make_albedo(albedo), options)


def measure(method, name):
    """{"rmse_mm", "mae_deg"} of "input" or a method on a capture; of a method, "iterations" too."""
    lighting = "moving-lamp" if method == "input" else load_method(method).lighting
    capture, truth = capture_for(name, lighting)
    if method == "input":
        prepared = prepare(capture)
        depth = prepared.embed(prepared.depth_m, float("nan"))
        scores, counted = evaluate_depth(depth, capture.camera, truth), {}
    else:
        result = refine(capture, method)
        scores = evaluate_maps(result.depth, result.normals, truth)
        counted = {"iterations": result.iterations}
    return {"rmse_mm": scores.depth.rmse_mm, "mae_deg": scores.normals.mae_deg, **counted}


def pinned():
    """{method: {capture: measured}} as stored."""
    return json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}


def main():
    """Print the numbers beside their pins; write them when asked to."""
    old, new = pinned(), {}
    for method in ("input", *METHODS):
        new[method] = {}
        for name in CAPTURES:
            new[method][name] = {
                key: value if key == "iterations" else round(value, 4)
                for key, value in measure(method, name).items()
            }
            before = old.get(method, {}).get(name)
            print(f"{method} on {name}: {new[method][name]}, pinned {before}")  # noqa: T201
    if "--write" in sys.argv[1:]:
        FILE.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8")
        print(f"written to {FILE}")  # noqa: T201


if __name__ == "__main__":
    main()
