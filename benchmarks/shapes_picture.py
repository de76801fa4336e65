"""docs/pictures/synthetic.png: the built-in shapes in each of the paper's paints, and as clay.

python benchmarks/shapes_picture.py docs/pictures/synthetic.png
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from rakelight.model import Array
from rakelight.pictures.clay import shaded
from rakelight.prepare.linear import srgb
from rakelight.synthetic import SHAPES, SceneOptions, make_albedo, make_shape, render_scene

ALBEDOS = ("simple", "pattern", "complicated")
OPTIONS = SceneOptions(photographs=1, tilt_deg=(35.0, 35.0), image_noise=0.0)
SCALE = 0.5  # 240 x 180 each
COLORS = 128  # in the file's palette


def column(name: str) -> Array:
    """One shape: its photographs (a lamp at 35 degrees) above its bare surface."""
    shape = make_shape(name)
    options = replace(OPTIONS, camera=shape.camera.scaled(SCALE))
    tiles = []
    for albedo in ALBEDOS:
        capture, truth = render_scene(shape, make_albedo(albedo), options)
        light = np.where(truth.mask[..., None], capture.photographs[0] / capture.white, 0.015)
        tiles.append(np.rint(255 * srgb(light)).astype(np.uint8))
    clay = shaded(truth.normals, truth.mask)
    tiles.append(np.repeat(clay[..., None], 3, axis=2))
    return np.concatenate(tiles)


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path)
    output = parser.parse_args().output
    picture = np.concatenate([column(name) for name in SHAPES], axis=1)
    few = Image.fromarray(picture).quantize(COLORS, dither=Image.Dither.NONE)
    few.save(output, format="PNG", optimize=True)
    print(f"{output}: {few.width} x {few.height}, {output.stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
