"""Seconds of the methods for one photograph on an object that fills 640 x 480 pixels.

    python benchmarks/single_photograph_time.py

After a run that compiles; the quickest of three, from prepared capture to result.  In brackets:
seconds of processor time, which other work on the machine does not change as much.
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter, process_time

from rakelight.methods import METHODS, load_method
from rakelight.model import silent
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

NEARER = 2.0  # than needed to see the whole of the cloth: then nothing else is seen
SHAPE = (480, 640)


def main() -> None:
    """Print the table of docs/results/single-photograph.md."""
    shape = make_shape("cloth")
    camera = shape.camera.scaled(SHAPE[0] / shape.camera.height)
    camera = replace(camera, fx=NEARER * camera.fx, fy=NEARER * camera.fy)
    methods = [load_method(name) for name in METHODS]
    methods = [method for method in methods if method.lighting != "moving-lamp"]
    print("| paint | pixels |", " | ".join(method.name for method in methods), "|")
    print("| --- | --- |" + " --- |" * len(methods))
    for paint in ("simple", "pattern", "complicated"):
        cells = []
        for method in methods:
            options = SceneOptions(
                camera=camera, lighting=method.lighting, depth_noise=DepthNoise(rms_mm=3.3)
            )
            prepared = prepare(render_scene(shape, make_albedo(paint), options)[0])
            seconds = []
            for _ in range(4):
                began = perf_counter(), process_time()
                method.run(prepared, method.options(), silent)
                seconds.append((perf_counter() - began[0], process_time() - began[1]))
            wall, processor = (min(each) for each in zip(*seconds[1:], strict=True))
            cells.append(f"{wall:.2f} ({processor:.2f})")
        print(f"| {paint} | {prepared.mask.sum()} |", " | ".join(cells), "|")


if __name__ == "__main__":
    main()
