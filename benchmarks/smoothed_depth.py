"""Depth that the sensor's filters smooth, on captures drawn at random.

    python benchmarks/smoothed_depth.py --seeds 3500:3540 --jobs 2 -o out/smoothed.json
    python benchmarks/smoothed_depth.py --seeds 3500:3540 --jobs 2 --sharp -o out/sharp.json
    python benchmarks/random_captures.py --compare out/sharp.json out/smoothed.json

The draws of random_captures.py, their depth maps, errors and all, as a Gaussian of 1.5 to 4 depth
pixels (standard deviation) smooths them over the object.  `--sharp` leaves that away.  Errors as
random_captures.py prints them.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from rakelight import Capture, Truth
from rakelight.geometry.blur import blurred
from rakelight.geometry.grid import area_mean
from rakelight.synthetic import draw
from random_captures import Record, changed_draw, run_changed_draws

# Share of the object in a depth pixel, from which on the filter takes it for the object's.
HALF = 0.5


def smoothed(capture: Capture, truth: Truth, seed: int, sharp: bool) -> Capture:
    """The capture, its depth smoothed over the object by a filter; itself if that is sharp."""
    if sharp:
        return capture
    blur_px = np.random.default_rng(seed).uniform(1.5, 4.0)
    factor = truth.mask.shape[0] // capture.depth_m.shape[1]
    on_object = area_mean(1.0 * truth.mask, factor) > HALF
    maps = []
    for depth in capture.depth_m.astype(float):
        seen = on_object & np.isfinite(depth) & (depth > 0)
        maps.append(np.where(seen, blurred(depth, blur_px, seen), depth))
    return replace(capture, depth_m=np.stack(maps).astype(np.float32))


def assess(seed: int, arguments: argparse.Namespace) -> Record:
    """All about one draw."""
    drawn = draw(seed, 1.0, arguments.scans, arguments.pictures)
    return changed_draw(
        drawn, lambda capture, truth: (smoothed(capture, truth, seed, arguments.sharp), truth)
    )


if __name__ == "__main__":
    sharp = "depth that is not smoothed"
    run_changed_draws(__doc__, assess, range(3500, 3540), "out/smoothed.json", "--sharp", sharp)
