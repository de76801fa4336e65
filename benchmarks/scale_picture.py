"""One part of a result at the depth's resolution and at the colour camera's, side by side.

    python benchmarks/scale_picture.py COARSE_RESULT FINE_RESULT picture.png --at 0.5 0.5

Each is shaded as bare clay; the coarse one's pixels are repeated, so that both cover the same part.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from rakelight.capture.images import encode_png
from rakelight.pictures.clay import shaded
from rakelight.pictures.montage import side_by_side
from rakelight.pictures.shown import object_window

ENLARGED = 3


def part(folder: Path, centre: tuple[float, float], width: float) -> np.ndarray:
    """A part of a result folder as clay; `width` and `centre` are shares of the object's window."""
    normals = cv2.imdecode(
        np.frombuffer((folder / "normals.tiff").read_bytes(), np.uint8), cv2.IMREAD_UNCHANGED
    )[..., ::-1]
    mask = np.isfinite(normals[..., 2])
    rows, columns = object_window(mask, margin=0)
    window = shaded(normals[rows, columns], mask[rows, columns])
    height, across = window.shape[:2]
    side = round(width * across)
    top, left = (
        round(share * length - side / 2)
        for share, length in zip(centre[::-1], (height, across), strict=True)
    )
    return window[max(top, 0) : top + side, max(left, 0) : left + side]


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("coarse", type=Path)
    parser.add_argument("fine", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--at", type=float, nargs=2, default=(0.5, 0.5), metavar=("X", "Y"))
    parser.add_argument("--width", type=float, default=0.4)
    arguments = parser.parse_args()
    coarse, fine = (
        part(folder, tuple(arguments.at), arguments.width)
        for folder in (arguments.coarse, arguments.fine)
    )
    size = tuple(ENLARGED * side for side in fine.shape[1::-1])
    coarse, fine = (
        cv2.resize(each, size, interpolation=cv2.INTER_NEAREST) for each in (coarse, fine)
    )
    arguments.picture.write_bytes(encode_png(side_by_side(coarse, fine)))


if __name__ == "__main__":
    main()
