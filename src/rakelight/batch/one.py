"""One capture from its source to its result folder; in a batch, unless that was done before."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from rakelight.batch.checksum import combined, content_checksum
from rakelight.batch.plan import Job
from rakelight.batch.record import Entry, figures_of
from rakelight.batch.remote import local_copy
from rakelight.capture import has_truth, load_truth
from rakelight.capture.readers import Wanted, find_reader
from rakelight.errors import InputError, MachineError, OutputExistsError, RakelightError, printable
from rakelight.export import RESULT, read_summary
from rakelight.export.normals import NormalMap
from rakelight.export.plain import json_bytes
from rakelight.export.summary import MeshFormat, program_version
from rakelight.files import MAX_TEXT_BYTES, read_bytes
from rakelight.folders import remove_unfinished
from rakelight.memory import give_memory_back
from rakelight.methods import Method, choose_method, load_method
from rakelight.model import Progress, ProgressCallback, Result, silent
from rakelight.pipeline import refine
from rakelight.prepare import Scale
from rakelight.report import save_result

STAMP = "batch-job.json"
"""File of a result folder that says of which input, options and version it is the result."""

_STAMP_SCHEMA = "rakelight-batch-job/1"


@dataclass(frozen=True)
class Recipe:
    """How captures are refined, and what is written.

    method : a name in METHODS, or "auto"
    settings : names and values of the method's options, as they were written
    options_for : makes the method's options of them; None for its defaults
    scale, photographs, mesh, normal_map : as in `refine`, `load_capture`, `save_result`
    """

    method: str = "auto"
    settings: tuple[tuple[str, str], ...] = ()
    options_for: Callable[[Method], Any] | None = None
    scale: Scale = "auto"
    photographs: tuple[int, ...] | None = None
    mesh: MeshFormat = "ply"
    normal_map: NormalMap = "opengl"

    def check(self) -> None:
        """Raise InputError for a wrong option, where that shows before a capture is read."""
        if self.method != "auto":
            method = load_method(self.method)
            if self.options_for is not None:
                self.options_for(method)

    def facts(self) -> dict[str, Any]:
        """All that the result depends on besides its input, for JSON."""
        return {
            "rakelight": program_version(),
            "method": self.method,
            "settings": dict(sorted(self.settings)),
            "scale": self.scale,
            "photographs": None if self.photographs is None else list(self.photographs),
            "mesh": self.mesh,
            "normal_map": self.normal_map,
        }


def refine_source(
    source: Path,
    output: Path,
    recipe: Recipe,
    *,
    overwrite: bool = False,
    progress: ProgressCallback = silent,
    extra_files: dict[str, bytes] | None = None,
    named: str = "",
) -> Result:
    """Read, refine and write; the result, with what is to be said of the writing.

    source : a capture folder or whatever else a reader recognises; output : the result folder
    extra_files : more files for that folder, name -> content
    named : what the result says of its source; as the reader has it when empty
    """
    began = perf_counter()
    progress(Progress("read"))
    capture = find_reader(source).read(source, Wanted(recipe.photographs, progress)).capture
    capture = replace(capture, source=named or capture.source)
    truth = load_truth(source) if has_truth(source) else None
    read_s = perf_counter() - began
    method, options = recipe.method, None
    if recipe.options_for is not None:
        method = choose_method(capture) if method == "auto" else method
        options = recipe.options_for(load_method(method))
    result = refine(capture, method, scale=recipe.scale, options=options, progress=progress)
    progress(Progress("write"))
    result = result.timed(read=read_s)
    kept = save_result(
        result,
        output,
        overwrite=overwrite,
        mesh=recipe.mesh,
        normal_map=recipe.normal_map,
        truth=truth,
        extra_files=extra_files,
    )
    return replace(result, findings=(*result.findings, *kept))


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
    stamp = {"schema": _STAMP_SCHEMA, "checksum": checksum, "source": job.shown, **recipe.facts()}
    try:
        refine_source(
            source, target, recipe,
            overwrite=overwrite or stored == checksum,
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
    try:
        return all((folder / name).is_file() for name in read_summary(folder).files)
    except (InputError, MachineError):
        return False


def explained(error: Exception) -> tuple[int, str]:
    """The exit code that `refine` would have ended with, and one line.

    >>> explained(MemoryError())
    (3, 'not enough memory. Fix: fewer --workers, or --scale 1')
    """
    if isinstance(error, RakelightError):
        return error.exit_code, str(error)
    if isinstance(error, MemoryError):
        return 3, "not enough memory. Fix: fewer --workers, or --scale 1"
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return 3, printable(f"{where}the system refused it (seen {error.strerror or error})")
    what = f"a bug in rakelight: {type(error).__name__}: {error}"
    return 1, printable(f"{what}. Fix: refine this capture alone with --debug and report all")
