"""What a long run shows on a terminal: stage, iteration, energy, time left."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rakelight.model import Progress, ProgressCallback, silent


@contextmanager
def shown_progress(quiet: bool = False) -> Iterator[ProgressCallback]:
    """A callback that draws on stderr when that is a terminal, and does nothing when it is not."""
    if quiet or not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description:>8}"),
        BarColumn(),
        TextColumn("{task.fields[detail]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Bars(*columns, console=Console(stderr=True)) as bars:
        if not _compiled():
            bars.console.print("first run: compiling takes 20 seconds or so, later runs need none")
        tasks: dict[str, TaskID] = {}

        def show(now: Progress) -> None:
            if now.stage not in tasks:
                for earlier in tasks.values():
                    bars.update(earlier, total=1, completed=1)
                tasks[now.stage] = bars.add_task(now.stage, total=None, detail="")
            detail = f"{now.step}/{now.steps}" if now.steps else ""
            detail += f"  energy {now.energy:.5g}" if now.energy is not None else ""
            bars.update(
                tasks[now.stage], total=now.steps or None, completed=now.step, detail=detail
            )

        yield show
        for task in tasks.values():
            bars.update(task, total=1, completed=1)


def _compiled() -> bool:
    """Whether the kernels have been compiled by an earlier run."""
    from rakelight import jit
    from rakelight.photometry import _kernels as _photographs  # noqa: F401 - registers its kernels
    from rakelight.solve import _kernels as _solver  # noqa: F401

    return jit.compiled()
