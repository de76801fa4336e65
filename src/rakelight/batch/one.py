"""One capture of a batch: refined, unless that was done before."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import perf_counter, process_time

from rakelight.batch.checksum import combined, content_checksum
from rakelight.batch.plan import Job
from rakelight.batch.record import Entry, figures_of
from rakelight.batch.remote import local_copy
from rakelight.errors import (
    InputError,
    MachineError,
    OutputExistsError,
    RakelightError,
    machine_fault,
    printable,
)
from rakelight.export import RESULT, read_summary
from rakelight.export.plain import json_bytes
from rakelight.export.summary import program_version
from rakelight.files import MAX_TEXT_BYTES, clear_errors, read_bytes
from rakelight.folders import remove_unfinished, require_free, sha256
from rakelight.memory import give_memory_back
from rakelight.recipe import Recipe, refine_source

STAMP = "batch-job.json"
"""File of a result folder that says of which input, options and version it is the result."""

_STAMP_SCHEMA = "rakelight-batch-job/1"


def run_one(job: Job, out: str, recipe: Recipe, overwrite: bool, version: str) -> Entry:
    """Do one job of a batch in this process, or find that it was done; failures are answers here.

    out : the batch's folder; version : of rakelight where the batch was started
    """
    began, cpu_began = perf_counter(), process_time()
    entry = partial(Entry, source=job.shown, name=job.name)
    try:
        if program_version() != version:
            raise MachineError(
                "this worker runs another version of rakelight",
                source=os.uname().nodename if hasattr(os, "uname") else "",
                seen=program_version(),
                needed=version,
                remedy="install the same on every machine",
            )
        target = Path(out) / job.name
        with local_copy(job) as source:
            checksum, computed = _done_once(job, source, target, recipe, overwrite)
        entry = partial(
            entry,
            state="done",
            computed=computed,
            checksum=checksum,
            figures=figures_of(read_summary(target)),
        )
    except Exception as error:
        code, message = explained(error)
        message = f"{printable(job.line)}: {message}" if job.line else message
        entry = partial(entry, state="failed", message=message, exit_code=code)
    give_memory_back()  # the next capture may be small, and its neighbours large
    return entry(wall_s=perf_counter() - began, cpu_s=process_time() - cpu_began)


def _done_once(
    job: Job, source: Path, target: Path, recipe: Recipe, overwrite: bool
) -> tuple[str, bool]:
    """The job's checksum, and whether the result had to be computed."""
    remove_unfinished(target, manifest=RESULT)
    checksum = combined(content_checksum(source), recipe.facts())
    stored = stamp_of(target)
    if stored == checksum and _is_whole(target):
        return checksum, False
    if stored not in (None, checksum) and not overwrite:
        raise OutputExistsError(
            "here is the result of another input, other options or another version",
            source=str(target),
            remedy="--overwrite replaces it; or choose another OUT",
        )
    replaced = overwrite or stored == checksum
    require_free(target, manifest=RESULT, overwrite=replaced)  # before hours of work
    stamp = {"schema": _STAMP_SCHEMA, "checksum": checksum, "source": job.shown, **recipe.facts()}
    try:
        refine_source(
            source, target, recipe,
            overwrite=replaced,
            extra_files={STAMP: json_bytes(stamp)},
            named=job.shown if job.remote else "",
        )  # fmt: skip
    except RakelightError as error:
        if job.remote:  # the copy's name says nothing to anybody
            error.source = error.source.replace(str(source), job.shown)
        raise
    return checksum, True


def stamp_of(folder: Path) -> str | None:
    """The checksum in a result folder of a batch; None where there is none that can be read.

    >>> stamp_of(Path("no/such/folder"))
    """
    with suppress(InputError, MachineError, ValueError, RecursionError):
        stamp = json.loads(read_bytes(folder / STAMP, max_bytes=MAX_TEXT_BYTES))
        if isinstance(stamp, dict) and stamp.get("schema") == _STAMP_SCHEMA:
            return str(stamp.get("checksum"))
    return None


def _is_whole(folder: Path) -> bool:
    """Whether a result's files are there, as they were written."""
    try:
        summary = read_summary(folder)
        with clear_errors(str(folder), "cannot be read"):
            return all((folder / name).is_file() for name in summary.files) and all(
                sha256(folder / name) == written for name, written in summary.checksums.items()
            )
    except (InputError, MachineError):
        return False


def explained(error: Exception) -> tuple[int, str]:
    """The exit code that `refine` would have ended with, and one line.

    >>> explained(MemoryError())
    (3, 'not enough memory. Fix: fewer --workers, or --scale 1')
    """
    if isinstance(error, RakelightError):
        return error.exit_code, str(error)
    if (line := machine_fault(error, "fewer --workers, or --scale 1")) is not None:
        return 3, line
    what = f"a bug in rakelight: {type(error).__name__}: {error}"
    return 1, printable(f"{what}. Fix: refine this capture alone with --debug and report all")
