"""Pictures of docs/results/single-photograph.md: what one photograph adds to a depth map.

    python benchmarks/single_photograph.py ../shared/captures/android -o docs/pictures/android.png
    python benchmarks/single_photograph.py ../shared/captures/monkey -o docs/pictures/monkey.png

From left to right: the photograph, the prepared depth and fusion-like as it comes, as clay under a
raking lamp at the upper left, and fusion-like under one at the upper right, where copied shading
would not look like relief; twice as large as they are.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from rakelight.capture import load_capture
from rakelight.capture.images import encode_png
from rakelight.geometry.normals import surface_normals
from rakelight.model import Array, Capture
from rakelight.pictures.clay import RAKING, shaded
from rakelight.pictures.montage import side_by_side
from rakelight.pipeline import refine
from rakelight.prepare import prepare

TIMES = 2


def strip(capture: Capture) -> Array:
    """The pictures side by side, cut to the object."""
    result, prepared = refine(capture, "fusion-like"), prepare(capture)
    values, _ = prepared.pixels(0)
    grey = np.zeros(prepared.mask.shape)
    grey[prepared.mask] = values.mean(axis=1) / np.percentile(values.mean(axis=1), 99)
    photograph = np.round(255 * np.clip(grey, 0, 1) ** (1 / 2.2)).astype(np.uint8)
    before = surface_normals(prepared.depth_m, prepared.mask, prepared.camera)
    after = result.normals[prepared.rows, prepared.columns]
    other = (-RAKING[0], *RAKING[1:])
    surfaces = [
        shaded(normals, prepared.mask, lamp)
        for normals, lamp in ((before, RAKING), (after, RAKING), (after, other))
    ]
    picture = side_by_side(photograph, *surfaces)
    return np.repeat(np.repeat(picture, TIMES, axis=0), TIMES, axis=1)


def main() -> None:
    """Write the picture that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("capture", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.output.write_bytes(encode_png(strip(load_capture(arguments.capture))))


if __name__ == "__main__":
    main()
