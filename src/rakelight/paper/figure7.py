"""Figure 7: runtime and errors of the multi-light methods against the number of photographs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import perf_counter, process_time

from rakelight.metrics import evaluate_maps
from rakelight.model import Array, Progress, silent
from rakelight.paper.plots import curves, plotted, require_matplotlib
from rakelight.paper.runs import MAIN, Runs, row_of
from rakelight.paper.scenes import PAPER_OPTIONS, paper_camera
from rakelight.paper.sheet import SECONDS, Sheet
from rakelight.synthetic import make_albedo, render_scene

COUNTS = (4, 6, 8, 10, 12, 15, 20, 25, 30)
METHODS = ("multi-light-alternating", "multi-light")
LITTLE, NOTHING = 0.10, 0.05
"""Fractions of the best angle within which more photographs pay little, then nothing."""


@dataclass(frozen=True, slots=True)
class Count:
    """A method's errors with so many photographs."""

    method: str
    photographs: int
    rmse_mm: float
    mae_deg: float
    iterations: int


@dataclass(frozen=True, slots=True)
class Time:
    """How long it took by the clock, and of the cores' time, which other programs do not bend."""

    method: str
    photographs: int
    seconds: float
    core_seconds_per_iteration: float


def figure7(runs: Runs) -> Sheet:
    """Curves against 4 to 30 photographs.  Raises MissingExtraError without matplotlib."""
    require_matplotlib()
    rows, times = counted(runs, COUNTS)
    title = "Figure 7: errors and runtime against the number of photographs"
    pictures = {"": _errors(rows), SECONDS: _runtimes(times)}
    return Sheet("figure7", title, rows, pictures, {SECONDS: times})


def counted(
    runs: Runs, counts: Sequence[int], methods: Sequence[str] = METHODS
) -> tuple[list[Count], list[Time]]:
    """Errors and times with the first photographs of one scene, whose lights are spread evenly."""
    options = replace(
        PAPER_OPTIONS,
        camera=paper_camera(runs.size),
        photographs=max(counts),
    )
    capture, truth = render_scene(runs.bust, make_albedo(MAIN), options)
    rows: list[Count] = []
    times: list[Time] = []
    for method in methods:
        row = row_of(method)
        row.run(capture.select(range(min(counts))), silent)  # compiles
        for count in counts:
            runs.progress(Progress(f"figure7: {row.label}", count, max(counts)))
            began, worked = perf_counter(), process_time()
            result = row.run(capture.select(range(count)), silent)
            seconds, core_s = perf_counter() - began, process_time() - worked
            scores = evaluate_maps(result.depth, result.normals, truth)
            rmse_mm, mae_deg = scores.depth.rmse_mm, scores.normals.mae_deg
            rows.append(Count(row.label, count, rmse_mm, mae_deg, result.iterations))
            times.append(Time(row.label, count, seconds, core_s / max(result.iterations, 1)))
    return rows, times


def enough(rows: Sequence[Count], within: float) -> int:
    """The least number of photographs from which on the angle is `within` a fraction of the best.

    >>> rows = [Count("m", 4, 1, 3.0, 1), Count("m", 10, 1, 2.1, 1), Count("m", 30, 1, 2.0, 1)]
    >>> enough(rows, 0.1), enough(rows, 0.01)
    (10, 30)
    """
    best = min(row.mae_deg for row in rows)
    wanting = [row.photographs for row in rows if row.mae_deg > (1 + within) * best]
    counts = [row.photographs for row in rows]
    later = [count for count in counts if count > max(wanting, default=0)]
    return min(later, default=max(counts))


def _errors(rows: Sequence[Count]) -> Array:
    published = [row for row in rows if row.method == rows[0].method]
    return plotted(
        {
            "RMSE, mm": curves((row.method, row.photographs, row.rmse_mm) for row in rows),
            "MAE, degrees": curves((row.method, row.photographs, row.mae_deg) for row in rows),
        },
        "photographs",
        (enough(published, LITTLE), enough(published, NOTHING)),
        "10 % to 5 % above the best angle",
    )


def _runtimes(times: Sequence[Time]) -> Array:
    return plotted(
        {
            "seconds": curves((t.method, t.photographs, t.seconds) for t in times),
            "core seconds per iteration": curves(
                (t.method, t.photographs, t.core_seconds_per_iteration) for t in times
            ),
        },
        "photographs",
    )
