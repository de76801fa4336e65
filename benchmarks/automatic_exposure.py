"""Cameras that change their exposure from photograph to photograph, on captures drawn at random.

    python benchmarks/automatic_exposure.py --seeds 3540:3570 --jobs 2 -o out/known.json
    python benchmarks/automatic_exposure.py --seeds 3540:3570 --jobs 2 --unknown -o out/unknown.json
    python benchmarks/random_captures.py --compare out/unknown.json out/known.json

The draws of random_captures.py, in 16 bit.  Each photograph is exposed until the object's mean is
`MEAN`, as automatic exposure does; the exposures are known, as EXIF states them, but with
`--unknown`.  Errors as random_captures.py prints them.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from rakelight import Capture, Truth
from rakelight.synthetic import draw
from random_captures import Record, changed_draw, run_changed_draws

MEAN = 0.3
"""Light, white being 1: highlights are clipped, as they are by cameras."""


def exposed(capture: Capture, truth: Truth, unknown: bool) -> Capture:
    """The capture, in 16 bit and linear, under automatic exposure."""
    light = capture.photographs / capture.white
    exposures = MEAN / light[:, truth.mask].mean(axis=(1, 2))
    values = np.round(65535 * np.clip(light * exposures[:, None, None, None], 0, 1))
    capture = replace(capture, photographs=values.astype(np.uint16))
    return capture if unknown else replace(capture, exposures=tuple(exposures.tolist()))


def assess(seed: int, arguments: argparse.Namespace) -> Record:
    """All about one draw."""
    drawn = draw(
        seed, 1.0, arguments.scans, arguments.pictures, bits=16, encoding="linear", gamma=1.0
    )
    return changed_draw(
        drawn, lambda capture, truth: (exposed(capture, truth, arguments.unknown), truth)
    )


if __name__ == "__main__":
    unknown = "exposures that are not known"
    run_changed_draws(__doc__, assess, range(3540, 3570), "out/exposure.json", "--unknown", unknown)
