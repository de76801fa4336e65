"""How well `rakelight check` predicts the accuracy of a refinement, on captures drawn at random.

    python benchmarks/check_accuracy.py --seeds 790:840 [--size 1.7]

Of every draw: the range that the check states, and the error against the truth that two thirds of
the refined pixels are within, of depth (mm) and normals (degrees); at the end how many of these
errors lie within their ranges.
"""

from __future__ import annotations

import argparse

import numpy as np

from rakelight import check_capture, refine
from rakelight.metrics import normal_error_map_deg
from rakelight.synthetic import random_capture

# The share of the pixels whose errors are compared.
WITHIN = 2 / 3


def main() -> None:
    """Print a line per draw, and how many errors lie within their ranges."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0:22", help="first:end")
    parser.add_argument("--size", type=float, default=1.7, help="scale of the images")
    arguments = parser.parse_args()
    first, end = map(int, arguments.seeds.split(":"))
    inside, count = {"depth": 0, "normals": 0}, 0
    for seed in range(first, end):
        capture, truth = random_capture(seed, size=arguments.size)
        expected = check_capture(capture).accuracy
        if expected is None:
            print(f"{seed:4}  nothing is expected", flush=True)
            continue
        result = refine(capture)
        seen = result.mask & np.isfinite(truth.depth)
        off_mm = 1000 * np.abs(result.depth - truth.depth)[seen]
        off_deg = normal_error_map_deg(result.normals, truth.normals, seen)[seen]
        count += 1
        line = f"{seed:4}"
        for name, unit, (least, most), errors in (
            ("depth", "mm", expected.depth_mm, off_mm),
            ("normals", "deg", expected.normals_deg, off_deg),
        ):
            error = float(np.nanquantile(errors, WITHIN))
            within = least <= error <= most
            inside[name] += within
            line += f"  {name} {least:.2f} to {most:.2f}, is {error:.2f} {unit}"
            line += "" if within else " (outside)"
        print(line, flush=True)
    for name, number in inside.items():
        print(f"{name}: {number} of {count} within the range")


if __name__ == "__main__":
    main()
