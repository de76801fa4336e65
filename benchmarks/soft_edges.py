"""Depth that was smoothed across the object's outline, on captures drawn at random.

    python benchmarks/soft_edges.py --seeds 3200:3250 --jobs 2 -o out/soft.json
    python benchmarks/soft_edges.py --seeds 3200:3250 --jobs 2 --sharp -o out/sharp.json
    python benchmarks/random_captures.py --compare out/sharp.json out/soft.json

The draws of random_captures.py before a wall 0.03 to 1 m behind them, in the middle of the image.
The depth map is one of a smoothing sensor: 2 to 8 times as coarse, blurred by a Gaussian of 0.8 to
2.5 of its pixels over object and wall alike, and off by an error of 0.5 to 2 mm that is correlated
over three pixels.  `--sharp` leaves the blur away.  Errors as random_captures.py prints them.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import cv2
import numpy as np

from rakelight import Capture, Truth
from rakelight.geometry.grid import area_mean
from rakelight.model import Array
from rakelight.synthetic import draw
from random_captures import Record, changed_draw, run_changed_draws

# Depth pixels around the object's image that show the wall alone.
AROUND_PX = 16
# Correlation of the depth's errors, depth pixels.
CORRELATED_PX = 3.0


def around(image: Array, width: int, value: float, axes: tuple[int, int] = (0, 1)) -> Array:
    """An image with a border of `width` pixels of one value on all sides."""
    pads = [(width, width) if axis in axes else (0, 0) for axis in range(image.ndim)]
    return np.pad(image, pads, constant_values=value)


def softened(capture: Capture, truth: Truth, seed: int, sharp: bool) -> tuple[Capture, Truth]:
    """The capture and its truth with a wider view, and with depth of a smoothing sensor."""
    rng = np.random.default_rng(seed)
    factor = int(rng.choice([2, 4, 8]))
    blur_px, gap_m = rng.uniform(0.8, 2.5), np.exp(rng.uniform(np.log(0.03), np.log(1.0)))
    error_m = rng.uniform(0.5e-3, 2e-3)
    height, width = (side // factor * factor for side in truth.mask.shape)
    inside, border = np.s_[:height, :width], AROUND_PX * factor

    def wider(image: Array, value: float) -> Array:
        return around(image[inside], border, value)

    mask = wider(truth.mask, False)
    camera = replace(
        capture.camera,
        width=width + 2 * border, height=height + 2 * border,
        cx=capture.camera.cx + border, cy=capture.camera.cy + border,
    )  # fmt: skip
    truth = Truth(
        wider(truth.depth, np.nan), wider(truth.normals, np.nan), wider(truth.albedo, 0),
        truth.lights,
    )  # fmt: skip
    scene = np.where(mask, np.nan_to_num(truth.depth), np.nanmax(truth.depth) + gap_m)
    depth = area_mean(scene, factor)
    if not sharp:
        depth = cv2.GaussianBlur(depth, (0, 0), blur_px, borderType=cv2.BORDER_REPLICATE)
    error = cv2.GaussianBlur(rng.normal(size=depth.shape), (0, 0), CORRELATED_PX)
    depth += error_m / error.std() * error
    capture = replace(
        capture,
        photographs=around(capture.photographs[:, :height, :width], border, 0, (1, 2)),
        depth_m=depth[None].astype(np.float32),
        mask=mask,
        camera=camera,
    )
    return capture, truth


def assess(seed: int, arguments: argparse.Namespace) -> Record:
    """All about one draw."""
    drawn = draw(seed, 1.0, arguments.scans, arguments.pictures, wall=False)
    return changed_draw(drawn, partial(softened, seed=seed, sharp=arguments.sharp))


if __name__ == "__main__":
    sharp = "depth that is not blurred"
    run_changed_draws(__doc__, assess, range(3200, 3250), "out/soft.json", "--sharp", sharp)
