"""What refining in tiles costs in accuracy: against refining all at once, for three objects.

    python benchmarks/tile_accuracy.py
    python benchmarks/tile_accuracy.py --shapes vase --depth-factors 1 2 --shrinks 2

Ten photographs of 960 x 720; the depth's noise has 2.5 mm rms and is correlated over 6 of its
pixels.  Prints the mean error of the normals, degrees, and the median error of the depth, mm.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from rakelight import evaluate
from rakelight.methods import load_method
from rakelight.metrics import Evaluation, evaluate_maps
from rakelight.model import Capture, Progress, Truth
from rakelight.pipeline import refine
from rakelight.pipeline.guarded import estimated
from rakelight.pipeline.lower_resolution import coarse_view
from rakelight.pipeline.tiles import LARGEST_TILE, refined_in_tiles
from rakelight.prepare import prepared_view
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

SIZE = 2.0  # times 480 x 360


def silent(_: Progress) -> None:
    """Say nothing."""


def in_tiles(capture: Capture, truth: Truth, shrink: int) -> Evaluation:
    """The errors when the whole object is refined at a resolution `shrink` times lower first."""
    method, view = load_method("multi-light"), prepared_view(capture)
    coarse = coarse_view(capture, view, shrink)
    prepared = coarse.window(*coarse.object_window)
    prepared, estimate = estimated(method, prepared, method.options(), silent)
    maps, _ = refined_in_tiles(view, prepared, estimate, shrink, LARGEST_TILE, 1, silent)
    return evaluate_maps(maps.depth_m, maps.normals, truth)


def rows(
    shapes: list[str], depth_factors: list[float], shrinks: list[int]
) -> Iterator[tuple[str, ...]]:
    """The cells of the table."""
    for shape in shapes:
        solid = make_shape(shape)
        for depth_factor in depth_factors:
            options = SceneOptions(
                camera=solid.camera.scaled(SIZE),
                photographs=10,
                depth_factor=depth_factor,
                depth_noise=DepthNoise(rms_mm=2.5, correlation_length_px=6.0),
            )
            capture, truth = render_scene(solid, make_albedo("pattern"), options)
            found = [evaluate(refine(capture), truth)]
            found += [in_tiles(capture, truth, shrink) for shrink in shrinks]
            cells = (f"{s.normals.mae_deg:.3f}, {s.depth.median_mm:.3f}" for s in found)
            yield f"{shape}, {depth_factor:g}", *cells


def main() -> None:
    """Print the table, a row at a time."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--shapes", nargs="+", default=["vase", "cloth", "head"])
    parser.add_argument("--depth-factors", nargs="+", type=float, default=[1, 2, 4])
    parser.add_argument("--shrinks", nargs="+", type=int, default=[2, 4])
    chosen = parser.parse_args()
    head = ["object, pixels per depth pixel", "at once", *(f"from 1/{s}" for s in chosen.shrinks)]
    print("|", " | ".join(head), "|\n|", " | ".join("---" for _ in head), "|")
    for cells in rows(chosen.shapes, chosen.depth_factors, chosen.shrinks):
        print("|", " | ".join(cells), "|", flush=True)


if __name__ == "__main__":
    main()
