"""All captures of a batch: each in a process of its own, and a failing one fails alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, sleep
from typing import Any, TypeAlias

import msgspec

from rakelight.batch.cluster import Deaths, local_client, remote_client, worker_count
from rakelight.batch.one import explained, run_one
from rakelight.batch.page import index_html
from rakelight.batch.plan import Job
from rakelight.batch.record import (
    INDEX,
    Entry,
    delete_remains,
    opened,
    write_record,
)
from rakelight.errors import InputError, MachineError
from rakelight.export import RESULT
from rakelight.export.summary import program_version
from rakelight.files import clear_errors
from rakelight.folders import only_writer, remove_unfinished, require_free
from rakelight.recipe import Recipe
from rakelight.report.sealed import require_free_page, write_page

# Seconds in which the system says how a process of ours ended; it takes milliseconds.
DEATH_S = 2.0


@dataclass(frozen=True)
class Standing:
    """How far a batch is.  left_s : seconds, from those that were computed; None at first."""

    done: int
    failed: int
    total: int
    left_s: float | None


Watcher: TypeAlias = Callable[[Standing], None]


def run_batch(
    jobs: Sequence[Job],
    out: Path,
    recipe: Recipe,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    overwrite: bool = False,
    watch: Watcher = lambda _: None,
) -> list[Entry]:
    """Refine the captures of all jobs into folders of `out`; write batch.json and index.html there.

    workers : processes on this machine, None for as many as it has cores and memory for
    scheduler : instead, the address of a Dask cluster whose workers see the same files
    overwrite : replace results of other inputs, options or versions
    watch : called whenever a capture is done

    Returns what came of each, in the order of the jobs.  A capture that fails does so alone.
    Raises InputError for wrong options, OutputExistsError where `out` is something else's,
    MachineError where another run writes into it, no workers can be had, or the disk is full.
    Whatever ends it, results that are whole stay, and a later call goes on from there.
    """
    recipe.check()
    if workers is not None and scheduler is not None:
        raise InputError(
            "two places to work at", source="--workers", needed="--workers or --scheduler, not both"
        )
    deaths: Deaths = {}
    place = _place(workers, scheduler, len(jobs), deaths)
    require_free_page(out / INDEX, overwrite=True, kind="batch")
    if opened(out) is None and not out.exists():
        require_free(out, manifest=RESULT)
    now = {job.name: Entry(source=job.shown, name=job.name) for job in jobs}
    others: list[Entry] | None = None
    with only_writer(out):
        try:
            with place as client:
                others = _begun(out, recipe, now)
                task = (str(out.resolve()), recipe, overwrite, program_version())
                for entry in _watched(_answers(client, jobs, task, deaths), len(jobs), watch):
                    now[entry.name] = entry
        finally:  # the workers have ended
            if others is not None:
                _ended(out, recipe, now, others)
    return list(now.values())


def _begun(out: Path, recipe: Recipe, now: dict[str, Entry]) -> list[Entry]:
    """Make the folder and its record; what earlier runs did that is not asked for now."""
    with clear_errors(str(out), "cannot be written"):
        out.mkdir(parents=True, exist_ok=True)
        record = opened(out)  # once more, now that nobody else writes it
        delete_remains(out)
    before = [] if record is None else record.captures
    others = [
        msgspec.structs.replace(each, computed=False, wall_s=0.0, cpu_s=0.0)
        for each in before
        if each.name not in now and each.state == "done"
    ]
    write_record(out, recipe.facts(), [*now.values(), *others])
    return others


def _ended(out: Path, recipe: Recipe, now: dict[str, Entry], others: list[Entry]) -> None:
    """Delete what is unfinished; bring the record and the page up to date."""
    for name, entry in now.items():
        if entry.state == "waiting":
            remove_unfinished(out / name, manifest=RESULT)
    entries = [*now.values(), *others]
    write_record(out, recipe.facts(), entries)
    write_page(out / INDEX, index_html(out, entries), overwrite=True, kind="batch")


def _place(
    workers: int | None, scheduler: str | None, jobs: int, deaths: Deaths
) -> AbstractContextManager[Any]:
    if scheduler is not None:
        return remote_client(scheduler)
    return local_client(worker_count(workers, jobs), deaths)


def _answers(
    client: Any, jobs: Sequence[Job], task: tuple[Any, ...], deaths: Deaths
) -> Iterator[Entry]:
    """What came of each job, as they end.

    No worker has more than one: whatever a dying worker had counts as tried.
    """
    from distributed import as_completed

    ended, running, left = as_completed(loop=client.loop), dict[str, Job](), iter(jobs)

    def begin() -> None:
        places = max(sum(client.nthreads().values()), 1)
        while len(running) < places and (job := next(left, None)) is not None:
            future = client.submit(run_one, job, *task, pure=False)
            running[future.key] = job
            ended.add(future)

    begin()
    while running:
        future = next(ended)
        yield _entry_of(future, running.pop(future.key), deaths)
        future.release()
        begin()


def _entry_of(future: Any, job: Job, deaths: Deaths) -> Entry:
    from distributed.scheduler import KilledWorker

    if future.status == "finished":
        entry: Entry = future.result()
        return entry
    if future.status in ("cancelled", "lost"):
        raise MachineError("the Dask scheduler has gone", remedy="start it and the batch again")
    error = future.exception()
    if isinstance(error, KilledWorker):
        signal = _signal_of(str(getattr(error.last_worker, "address", "")), deaths)
        how = f" (signal {signal})" if signal else ""
        code, message = MachineError.exit_code, (
            f"{job.shown}: the process was killed{how}, and once more when it was tried again, "
            "probably out of memory. Fix: fewer --workers, or --scale 1"
        )  # fmt: skip
    else:
        code, message = explained(error)
    return Entry(source=job.shown, name=job.name, state="failed", message=message, exit_code=code)


def _signal_of(worker: str, deaths: Deaths) -> int:
    """The signal that ended a worker of our own; 0 where that is not known.

    Its connection ends a moment before it does.
    """
    end = perf_counter() + DEATH_S
    while worker not in deaths and deaths and perf_counter() < end:
        sleep(0.02)
    return max(deaths.get(worker, 0), 0)


def _watched(entries: Iterator[Entry], total: int, watch: Watcher) -> Iterator[Entry]:
    """The same entries; `watch` is told of each."""
    done, failed, computed = 0, 0, 0
    began = perf_counter()
    watch(Standing(0, 0, total, None))
    for entry in entries:
        done, failed = done + 1, failed + (entry.state == "failed")
        computed += entry.computed or entry.state == "failed"
        if not computed:  # those that were done before tell nothing
            began = perf_counter()
        left_s = (perf_counter() - began) / computed * (total - done) if computed else None
        watch(Standing(done, failed, total, left_s))
        yield entry
