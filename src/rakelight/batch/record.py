"""batch.json: every capture of a batch, by the name of its result, and what came of it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from rakelight.errors import InputError, OutputExistsError, parsing, printable
from rakelight.export.summary import STAGES, Summary, program_version
from rakelight.files import clear_errors, is_partial, read_bytes, replace_bytes

SCHEMA = "rakelight-batch/1"

RECORD, INDEX = "batch.json", "index.html"
# Bytes; a batch of 100,000 captures with ten warnings each has about as many.
_LARGEST = 300_000_000


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    """Of a result, from its result.json.

    size : [width, height] of its images, pixels; pixels : of the object
    prediction_error : how well each photograph is predicted by the others, share of its brightness,
        the median of all; None where nothing is known
    seconds : from reading to the end of the refinement
    """

    method: str
    photographs: int
    size: tuple[int, int]
    pixels: int
    iterations: int
    converged: bool
    prediction_error: float | None
    seconds: float
    warnings: list[str]


class Entry(msgspec.Struct, frozen=True, kw_only=True):
    """A capture of a batch.

    state : "waiting" until it is "done" or "failed"
    computed : by this run; False where an earlier one had done it
    message, exit_code : of a failure, as `refine` would have ended
    wall_s, cpu_s : that it took in this run, checksums and writing included: seconds of the clock,
        and of all cores together
    """

    source: str
    name: str
    state: Literal["waiting", "done", "failed"] = "waiting"
    computed: bool = False
    message: str = ""
    exit_code: int = 0
    checksum: str = ""
    wall_s: float = 0.0
    cpu_s: float = 0.0
    figures: Figures | None = None


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """The content of batch.json."""

    schema: str = SCHEMA
    rakelight: str
    options: dict[str, Any]
    captures: list[Entry]


def figures_of(summary: Summary) -> Figures:
    """The figures that the page shows of a result."""
    errors = [error for error in summary.prediction_errors if error is not None]
    seconds = (summary.timings_s.get(stage) or 0.0 for stage in STAGES)
    return Figures(
        method=summary.method,
        photographs=len(summary.photographs),
        size=(summary.camera.width, summary.camera.height),
        pixels=summary.pixels,
        iterations=summary.iterations,
        converged=summary.converged,
        prediction_error=float(np.median(errors)) if errors else None,
        seconds=round(sum(seconds), 3),
        warnings=[each.message for each in summary.findings if each.severity == "warning"],
    )


def read_record(out: Path) -> Record | None:
    """The record in a batch's folder; None where there is none.

    Raises InputError where a file of that name is something else, MachineError where it cannot be
    read.

    >>> read_record(Path("no/such/folder"))
    """
    path = out / RECORD
    if not os.path.lexists(path):
        return None
    with parsing(str(path), "not the record of a batch"):
        record = msgspec.json.decode(read_bytes(path, max_bytes=_LARGEST), type=Record)
        if record.schema != SCHEMA:
            raise InputError(
                "the record of another version", source=str(path), seen=record.schema, needed=SCHEMA
            )
        return record


def write_record(out: Path, options: Mapping[str, Any], entries: Iterable[Entry]) -> None:
    """Write batch.json whole or not at all, in the place of an older one."""
    record = Record(rakelight=program_version(), options=dict(options), captures=list(entries))
    data = msgspec.json.format(msgspec.json.encode(record), indent=1) + b"\n"
    replace_bytes(out / RECORD, data)


def opened(out: Path) -> Record | None:
    """The record of the batch that may be continued in `out`; None where it is new or empty.

    Raises OutputExistsError where something else stands there.
    """
    shown = str(out)
    with clear_errors(shown, "cannot be written"):
        if not os.path.lexists(out):
            return None
        if not out.is_dir():
            raise OutputExistsError(
                "a file stands where the folder is to be written",
                source=shown,
                remedy="choose another name",
            )
        present = sorted(path.name for path in out.iterdir())
    foreign = [name for name in present if not _is_remains(name)]
    if not foreign:
        return None
    try:
        record = read_record(out)
    except InputError:
        record = None
    if record is None:
        raise OutputExistsError(
            "the folder exists, and no batch wrote it",
            source=shown,
            seen=printable(foreign[0]),
            needed=f"no such folder, or one with the {RECORD} of an earlier batch",
            remedy="choose another name",
        )
    return record


def delete_remains(out: Path) -> None:
    """Delete what a killed run began to write of the record or the page."""
    for path in out.iterdir():
        if _is_remains(path.name) and path.is_file() and not path.is_symlink():
            path.unlink(missing_ok=True)


def _is_remains(name: str) -> bool:
    return any(is_partial(name, each) for each in (RECORD, INDEX))
