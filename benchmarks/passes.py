"""How far each pass over a large capture is from the machine's limit: bytes over bandwidth.

    python benchmarks/passes.py [--photographs 20] [--folder out/large]

The capture is that of large.py with one megapixel.  The bandwidth is what all cores together read
of an array that no cache holds.  A pass must read or write each of its arrays once: those bytes,
over the bandwidth, are the least time that it could take.  Seconds are the best of five.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import rakelight
from large import FACTORS, write_capture
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light.energy import depth_system, first_fit
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.prepare import prepare
from rakelight.solve import build_hierarchy

REPEATS = 5
# Size of the array that is read for the bandwidth, megabytes: more than any cache holds.
READ_MB = 400


def best(work: Callable[[], Any]) -> float:
    """Seconds of the fastest of some calls, after one that compiles."""
    work()
    seconds = []
    for _ in range(REPEATS):
        began = perf_counter()
        work()
        seconds.append(perf_counter() - began)
    return min(seconds)


def bandwidth() -> float:
    """Bytes that all cores together read in a second."""
    cores = cpu_count() or 1
    parts = np.array_split(np.ones(READ_MB * 125_000), cores)
    with ThreadPoolExecutor(cores) as pool:
        seconds = best(lambda: list(pool.map(np.sum, parts)))
    return 1e6 * READ_MB / seconds


def passes(capture: Path) -> Iterator[tuple[str, float, int]]:
    """Name, seconds and bytes of each pass; the bytes are those that it must read and write."""
    prepared = prepare(rakelight.load_capture(capture))
    level = finest_level(prepared, cut=True, unbiased=True)
    pixels = int(np.count_nonzero(level.mask))
    fit = first_fit(level, level.prior, lights_of_prior(level))
    photographs, count = level.photographs, len(level.photographs)
    values = 6 * count  # three channels of 16 bit

    def linearize(slope: bool) -> Any:
        return photographs.linearize(
            fit.surface, fit.lights, scale=fit.scales, start=fit.linearization.albedo,
            with_light_slope=slope,
        )  # fmt: skip

    # gradient, points, scale and albedo in; albedo, M, b and the mean residual out
    images = 8 * (2 + 3 + 1 + 3 + 3 + 3 + 2 + 1)
    yield "residuals and M (linearize)", best(lambda: linearize(False)), pixels * (values + images)
    yield "with the lights' slope", best(lambda: linearize(True)), pixels * (values + images)
    yield "half the resolution (halved)", best(photographs.halved), pixels * values * 5 // 4
    sample = int(np.count_nonzero(photographs.subsample()))
    terms = best(
        lambda: photographs.light_terms(
            fit.surface, fit.lights, fit.linearization.albedo, scale=fit.scales,
            subsampling=photographs.subsampling(),
        )
    )  # fmt: skip
    yield "second derivatives of the lights, of a sample", terms, sample * (values + images)

    tensor = fit.linearization.jtwj
    system = depth_system(level, fit, tensor)
    # M, b, data weight and target in; stencil and right side out
    assembling = best(lambda: depth_system(level, fit, tensor))
    yield "assembling the depth system", assembling, pixels * 8 * (3 + 2 + 2 + 5 + 1)
    hierarchy = build_hierarchy(system)
    # stencil in double; in single precision the stencil, two pivots, interpolation; 4/3 for levels
    building = best(lambda: build_hierarchy(system))
    yield "multigrid, building it", building, pixels * (40 + 4 * (5 + 2 + 4)) * 4 // 3
    # Four sweeps over lines read stencil, pivots, right side and x, and write x.
    cycle = pixels * 4 * 4 * (5 + 1 + 1 + 2) * 4 // 3
    rhs = system.rhs
    norm = float(np.linalg.norm(rhs))
    yield "multigrid, a cycle", best(lambda: hierarchy.precondition(rhs, norm)), cycle
    x = np.pad(level.prior, 1)
    out = np.zeros_like(x)
    yield "the matrix times a vector", best(lambda: system.apply_window(x, out)), pixels * 8 * 7


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--photographs", type=int, default=20)
    parser.add_argument("--folder", type=Path, help="where the capture is kept")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        capture = (given.folder or Path(scratch)) / f"1mp-{given.photographs}"
        if not capture.exists():
            write_capture(capture, FACTORS[1], given.photographs)
        rate = bandwidth()
        print(f"bandwidth {rate / 1e9:.1f} GB/s, {cpu_count()} cores\n")
        print("| pass | ms | MB | ms at that bandwidth | times as long |")
        print("|" + " --- |" * 5)
        for name, seconds, size in passes(capture):
            least = size / rate
            print(
                f"| {name} | {1e3 * seconds:.1f} | {size / 1e6:.0f} | {1e3 * least:.1f} "
                f"| {seconds / least:.1f} |"
            )


if __name__ == "__main__":
    main()
