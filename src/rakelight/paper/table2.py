"""Table 2: runtimes of the methods, and how many parameters each has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from time import perf_counter

from rakelight.methods import load_method
from rakelight.model import Progress, ProgressCallback, silent
from rakelight.paper.rows import ROWS, Row
from rakelight.paper.scenes import paper_object, paper_scene
from rakelight.paper.write import Column, as_markdown
from rakelight.synthetic import Shape


@dataclass(frozen=True, slots=True)
class Runtime:
    """One method's time from capture to result, and the number of its parameters."""

    method: str
    seconds: float
    parameters: int
    paper_seconds: float | None


COLUMNS = (
    Column("seconds", lambda row: row.seconds, lambda row: row.paper_seconds),
    Column("parameters", lambda row: row.parameters, format="d"),
)


def table2(
    size: float = 1.0, rows: Sequence[Row] = ROWS, progress: ProgressCallback = silent
) -> tuple[Runtime, ...]:
    """Time every method on the `pattern` scenario, after one run that compiles.

    >>> [(row.method, row.seconds > 0) for row in table2(size=0.1, rows=ROWS[1:2])]
    [('RGB-Fusion (no smooth)', True)]
    """
    timed, bust = [], paper_object()
    methods = [row for row in rows if row.method is not None]
    for step, row in enumerate(methods):
        progress(Progress(row.label, step, len(methods)))
        timed.append(_time(row, size, bust))
    return tuple(timed)


def table2_markdown(rows: Sequence[Runtime]) -> str:
    """Table 2, ours first and the paper's in brackets."""
    lines = {row.method: [column.text(row) for column in COLUMNS] for row in rows}
    return as_markdown([column.title for column in COLUMNS], lines)


def _time(row: Row, size: float, bust: Shape) -> Runtime:
    capture, _ = paper_scene("pattern", row.lighting, size, bust)
    small, _ = paper_scene("pattern", row.lighting, size / 4, bust)
    row.run(small, silent)
    began = perf_counter()
    row.run(capture, silent)
    seconds = perf_counter() - began
    parameters = len(fields(load_method(row.method or "").options))
    return Runtime(row.label, seconds, parameters, row.paper_seconds)
