"""What a long run shows on a terminal: stage, iteration, energy, time left."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from typing import TYPE_CHECKING, Any

from rakelight.model import Progress, ProgressCallback, silent

if TYPE_CHECKING:
    from rakelight.batch.run import Standing


@contextmanager
def shown_progress(quiet: bool = False, *, compiles: bool = True) -> Iterator[ProgressCallback]:
    """A callback that draws on stderr when that is a terminal, and does nothing when it is not.

    compiles : whether the work needs compiled kernels, so that the first run takes longer
    """
    if quiet or not sys.stderr.isatty():
        yield silent
        return
    from rich.progress import TaskID, TextColumn, TimeRemainingColumn

    with _bars(TextColumn("left"), TimeRemainingColumn()) as bars:
        if compiles and not _compiled():
            bars.console.print("first run: compiling takes 15 seconds or so, later runs need none")
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


@contextmanager
def shown_captures(quiet: bool = False) -> Iterator[Callable[[Standing], None]]:
    """The same for the captures of a batch: how many are done, how many failed, the time left."""
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.progress import TextColumn

    # rich's own estimate forgets what is older than half a minute.
    with _bars(TextColumn("left {task.fields[left]}")) as bars:
        task = bars.add_task("captures", total=None, detail="starting", left="-:--:--")

        def show(now: Standing) -> None:
            detail = f"{now.done}/{now.total}" + (f"  {now.failed} failed" if now.failed else "")
            left = "-:--:--" if now.left_s is None else str(timedelta(seconds=round(now.left_s)))
            bars.update(task, total=now.total, completed=now.done, detail=detail, left=left)

        yield show


def _bars(*last: Any) -> Any:
    """rich's bars on stderr: what, a bar, its `detail`, the time, and these last columns."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (
        TextColumn("{task.description:>8}"),
        BarColumn(),
        TextColumn("{task.fields[detail]}"),
        TimeElapsedColumn(),
    )
    return Bars(*columns, *last, console=Console(stderr=True))


def _compiled() -> bool:
    """Whether the kernels have been compiled by an earlier run."""
    from rakelight import jit
    from rakelight.cli.compiling import load_kernels

    load_kernels()
    return jit.compiled()
