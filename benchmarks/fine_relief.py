"""Plates with waves a few depth pixels wide, drawn at random, refined: how high they come out.

    python benchmarks/fine_relief.py --seeds 0:40 [--jobs 2]

Preparing smooths such relief away: photographs show its shape, and only the measurements how high
it is.  Per plate the share of the true height, and the normals' mean angle, degrees, prepared and
refined.  The height is the slope of the regression of depth on true depth, both without the plate's
tilt and bend: less the second-order polynomial that fits best.
"""

from __future__ import annotations

import argparse
from functools import partial
from typing import Any

import numpy as np

from rakelight import Capture, Truth, refine
from rakelight.geometry.normals import surface_normals
from rakelight.metrics import evaluate_maps
from rakelight.model import Floats
from rakelight.synthetic import DepthNoise, SceneOptions, Shape, make_albedo, make_shape
from rakelight.synthetic.implicit import Solid, trace
from rakelight.synthetic.scene import render_scene
from random_captures import processes, seeds

DISTANCE_M = 0.6
CAMERA = make_shape("coin").camera.scaled(0.2)
PIXEL_M = DISTANCE_M / CAMERA.fx
# What is printed of every plate, prepared and refined: share of the true height, degrees.
UNITS = ("height", "angle")


def plate(seed: int) -> tuple[Capture, Truth, str]:
    """A capture, its truth and what it is.

    Four waves of random direction, 6 to 40 pixels long, on a tilted plate that may be bent; one
    depth pixel is 1, 2 or 4 wide; 5 to 15 photographs; two fifths have near lights.
    """
    rng = np.random.default_rng(seed)
    period_px = rng.uniform(6, 40)
    amplitude_m = rng.uniform(0.01, 0.05) * period_px * PIXEL_M
    turns, phases = rng.uniform(0, np.pi, 4), rng.uniform(0, 2 * np.pi, 4)
    lengths_m = rng.uniform(0.8, 1.6, 4) * period_px * PIXEL_M
    tilt, bend = rng.uniform(-0.3, 0.3, 2), rng.choice([0.0, 2.0])

    def field(x: Floats, y: Floats, z: Floats) -> Floats:
        """0 on the surface, of points in metres."""
        along = (x * np.cos(turn) + y * np.sin(turn) for turn in turns)
        waves = (
            np.sin(2 * np.pi * each / length_m + phase)
            for each, length_m, phase in zip(along, lengths_m, phases, strict=True)
        )
        plain = tilt[0] * x + tilt[1] * y + bend * (x * x + y * y)
        return np.asarray(z + plain - amplitude_m * sum(waves))

    solid = Solid(field, DISTANCE_M, radius_m=0.5, steepness=2.5)
    near = rng.uniform() < 0.4
    options = SceneOptions(
        camera=CAMERA,
        photographs=int(rng.integers(5, 16)),
        lamp_distance_m=rng.uniform(0.4, 1.0) if near else None,
        depth_factor=int(rng.choice([1, 2, 4])),
        depth_noise=DepthNoise(
            rms_mm=rng.uniform(0.1, 1.0), correlation_length_px=float(rng.choice([0, 3]))
        ),
        seed=seed,
    )
    shape = Shape("plate", CAMERA, partial(trace, solid), solid)
    capture, truth = render_scene(
        shape, make_albedo(str(rng.choice(["white", "pattern"]))), options
    )
    lamps = "near" if near else "distant"
    return capture, truth, f"{period_px:4.1f} px, depth 1/{options.depth_factor}, {lamps:7s}"


def scores(seed: int) -> dict[str, Any]:
    """What one plate is, and its heights and errors."""
    capture, truth, what = plate(seed)
    result = refine(capture)
    inside = truth.mask & np.isfinite(result.prepared_depth)
    v, u = (each[inside] / CAMERA.width for each in np.indices(CAMERA.shape))
    smooth, _ = np.linalg.qr(np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1))

    def waves(depth: Floats) -> Floats:
        """Depth inside, without tilt and bend."""
        values = depth[inside].astype(float)
        return np.asarray(values - smooth @ (smooth.T @ values))

    true_m = waves(truth.depth)

    def height(depth: Floats) -> float:
        """Of the true one."""
        return float(waves(depth) @ true_m / (true_m @ true_m))

    def angle(depth: Floats, normals: Floats) -> float:
        """Degrees."""
        return float(evaluate_maps(depth, normals, truth, inside).normals.mae_deg)

    before = result.prepared_depth
    return {
        "what": what,
        "height": [height(before), height(result.depth)],
        "angle": [
            angle(before, surface_normals(before, np.isfinite(before), capture.camera)),
            angle(result.depth, result.normals),
        ],
    }


def main() -> None:
    """Print a line for each plate, and medians."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=seeds, default=range(40), help="FIRST:END")
    parser.add_argument("--jobs", type=int, default=1, help="processes of one thread each")
    arguments = parser.parse_args()
    heights, angles = [], []
    with processes(arguments.jobs) as pool:
        for seed, found in zip(arguments.seeds, pool.imap(scores, arguments.seeds), strict=True):
            heights.append(found["height"])
            angles.append(found["angle"])
            cells = (f"{name} {found[name][0]:5.2f} to {found[name][1]:5.2f}" for name in UNITS)
            print(f"{seed:4d} {found['what']}", *cells, sep=" | ", flush=True)
    off = np.abs(np.log(np.maximum(np.array(heights), 1e-3)))
    for index, name in enumerate(("prepared", "refined")):
        angle = np.array(angles)[:, index]
        print(
            f"{name}: angle {np.median(angle):.2f} (median), {np.quantile(angle, 0.9):.2f} (90 %); "
            f"height off by more than 10 %: {np.count_nonzero(off[:, index] > np.log(1.1))}"
            f" of {len(angle)}"
        )


if __name__ == "__main__":
    main()
