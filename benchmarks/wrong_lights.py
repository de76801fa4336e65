"""Which lights that are given `rakelight` calls wrong, on captures drawn at random.

    python benchmarks/wrong_lights.py --seeds 300:360

Of every draw the true lights, the same turned to a random side by 5 degrees, and what mistakes make
of them.  Printed is of how many draws the warning `given-lights-wrong` is said.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np

from rakelight.model import Floats, GivenLights, Truth
from rakelight.pipeline.given_lights import wrong_lights
from rakelight.prepare import prepare
from rakelight.prepare.reduced import reduced
from rakelight.prepare.undistort import undistorted
from rakelight.synthetic import random_capture
from random_captures import given_lights

# Pixels of the object, as in the quick refinement of `rakelight check`.
PIXELS = 12_000


def lists_of_lights(truth: Truth, seed: int) -> dict[str, GivenLights]:
    """Right and wrong lights of a draw."""
    right, rng = given_lights(truth, seed, 0.0, True), np.random.default_rng(seed)
    count = len(right)
    vectors = np.asarray(right.directions if right.positions_m is None else right.positions_m)

    def given(made: Floats) -> GivenLights:
        if right.positions_m is None:
            return GivenLights(directions=made, fixed=True)
        return GivenLights(positions_m=made, fixed=True)

    azimuth, tilt = rng.uniform(0, 2 * np.pi, count), np.radians(rng.uniform(15, 50, count))
    other = [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)]
    return {
        "exact": right,
        "5 degrees off": given_lights(truth, seed, 5.0, True),
        "shuffled": given(vectors[rng.permutation(count)]),
        "reversed": given(vectors[::-1]),
        "one further": given(np.roll(vectors, 1, axis=0)),
        "x turned round": given(vectors * [-1, 1, 1]),
        "y turned round": given(vectors * [1, -1, 1]),
        "x and y exchanged": given(vectors[:, [1, 0, 2]]),
        "of another capture": GivenLights(directions=np.stack(other, axis=1), fixed=True),
        **({} if right.positions_m is None else {"millimetres": given(1000 * vectors)}),
    }


def main() -> None:
    """Print of how many draws each kind of lights is called wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="300:360")
    first, last = map(int, parser.parse_args().seeds.split(":"))
    all_of, said = Counter[str](), Counter[str]()
    for seed in range(first, last):
        capture, truth = random_capture(seed)
        prepared = prepare(reduced(undistorted(capture), PIXELS))
        for kind, lights in lists_of_lights(truth, seed).items():
            all_of[kind] += 1
            said[kind] += bool(wrong_lights(replace(prepared, lights=lights)))
    for kind, count in all_of.items():
        print(f"{kind:20} {said[kind]:3} of {count}")


if __name__ == "__main__":
    main()
