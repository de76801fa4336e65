"""Seconds of `check_capture` beside those of `refine`, in memory, on captures and random draws.

    python benchmarks/check_time.py ../shared/captures/mitten --seeds 100:106 --repeat 3

The two take turns; of each the least is printed, in wall time and in processor time of all threads.
Processor time is the one to compare by on a machine that others use.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter, process_time

from rakelight import check_capture, load_capture, refine
from rakelight.model import Capture
from rakelight.synthetic import random_capture


def timed(action: Callable[[Capture], object], capture: Capture) -> tuple[float, float]:
    """Seconds on the wall and of the processor."""
    wall, processor = perf_counter(), process_time()
    action(capture)
    return perf_counter() - wall, process_time() - processor


def captures(arguments: argparse.Namespace) -> Iterator[tuple[str, Capture]]:
    """Name and capture."""
    for folder in arguments.captures:
        yield folder.name, load_capture(folder)
    for seed in range(*map(int, arguments.seeds.split(":"))):
        yield f"draw {seed}", random_capture(seed, size=arguments.size)[0]


def main() -> None:
    """Print a row per capture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("captures", type=Path, nargs="*", help="capture folders")
    parser.add_argument("--seeds", default="100:106", help="random draws, first:end")
    parser.add_argument("--size", type=float, default=1.7, help="scale of the draws' images")
    parser.add_argument("--repeat", type=int, default=3)
    arguments = parser.parse_args()
    print("| capture | check, s | refine, s | ratio | the same, processor time |")
    print("| --- | --- | --- | --- | --- |")
    for name, capture in captures(arguments):
        rounds = [
            (timed(check_capture, capture), timed(refine, capture)) for _ in range(arguments.repeat)
        ]
        check, whole = (
            [min(times[i] for times in side) for i in range(2)]
            for side in zip(*rounds, strict=True)
        )
        print(
            f"| {name} | {check[0]:.2f} | {whole[0]:.2f} | {check[0] / whole[0]:.2f} "
            f"| {check[1]:.2f} / {whole[1]:.2f} = {check[1] / whole[1]:.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
