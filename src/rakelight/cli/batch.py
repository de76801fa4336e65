"""`rakelight batch CAPTURE… -o OUT`."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rakelight.cli.options import output_folder, output_options, refuse_input_as_output
from rakelight.cli.progress import shown_captures
from rakelight.cli.refine import recipe_of, recipe_options
from rakelight.errors import InputError, printable

if TYPE_CHECKING:
    from rakelight.batch.plan import Job
    from rakelight.batch.record import Entry

SOME_FAILED = 4
"""Exit code of a batch in which captures failed."""


@click.command("batch")
@click.argument("captures", nargs=-1, required=True, metavar="CAPTURE...")
@output_folder("OUT", "The folder of the results; one of an earlier batch is continued.")
@click.option(
    "--workers",
    type=click.IntRange(1, 1000),
    metavar="N",
    help="Processes on this machine; as many as it has cores and memory for if left away.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Work on the Dask cluster at tcp://HOST:PORT instead, which sees the same files.",
)
@recipe_options
@click.option(
    "--overwrite",
    is_flag=True,
    help="Replace results at OUT that are of another input, other options or another version.",
)
@output_options
def command(
    captures: tuple[str, ...],
    output: Path,
    workers: int | None,
    scheduler: str | None,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    debug: bool,
    **options: Any,
) -> int:
    """Refine many captures into OUT, each in a process of its own.

    CAPTURE is what `refine` takes, a pattern of such paths in quotes, a .txt file with one on each
    line, or a URL that fsspec reads.  What is done already is not done again: the same command goes
    on after an interruption.  The exit code is 4 when captures failed.
    """
    from rakelight.batch.plan import make_jobs
    from rakelight.batch.record import opened
    from rakelight.batch.run import run_batch

    recipe = recipe_of(**options)
    record = opened(output)
    earlier = {} if record is None else {each.source: each.name for each in record.captures}
    named = make_jobs(captures, earlier)
    jobs = _but_output(named, output)
    if len(jobs) < len(named) and not (as_json or quiet):
        click.echo(printable(f"note: {output}: this is OUT itself, no capture"), err=True)
    for job in jobs:
        if not job.remote:
            refuse_input_as_output(Path(job.source), output)
    with shown_captures(quiet or as_json) as watch:
        entries = run_batch(
            jobs, output, recipe,
            workers=workers, scheduler=scheduler, overwrite=overwrite, watch=watch,
        )  # fmt: skip
    if as_json:
        click.echo(json.dumps(outcome(entries, output)))
    else:
        show(entries, output, quiet=quiet)
    return SOME_FAILED if any(entry.state == "failed" for entry in entries) else 0


def _but_output(jobs: list[Job], output: Path) -> list[Job]:
    """All jobs but OUT itself where it exists: a shell's `captures/*` names captures/out, too.

    OUT is an earlier batch, or empty.  Raises InputError where nothing else was named.
    """
    here = os.path.realpath(output) if output.exists() else None
    others = [job for job in jobs if job.remote or os.path.realpath(job.source) != here]
    if not others:
        raise InputError(
            "no capture but OUT itself", source=str(output), remedy="name the captures"
        )
    return others


def outcome(entries: list[Entry], output: Path) -> dict[str, Any]:
    """What `--json` prints."""
    import msgspec

    return {
        "output": printable(str(output)),
        **counts(entries),
        "captures": [msgspec.to_builtins(entry) for entry in entries],
    }


def counts(entries: list[Entry]) -> dict[str, int]:
    """How many of each kind."""
    done = [entry for entry in entries if entry.state == "done"]
    return {
        "computed": sum(entry.computed for entry in done),
        "skipped": sum(not entry.computed for entry in done),
        "failed": sum(entry.state == "failed" for entry in entries),
    }


def show(entries: list[Entry], output: Path, *, quiet: bool) -> None:
    """Print a line for each failure on stderr, then what was done and where it is."""
    for entry in entries:
        if entry.state == "failed":
            click.echo(printable(f"failed: {entry.name}: {entry.message}"), err=True)
    if not quiet:
        number, plural = counts(entries), "" if len(entries) == 1 else "s"
        click.echo(
            f"{len(entries)} capture{plural}: {number['computed']} refined, "
            f"{number['skipped']} were done before, {number['failed']} failed"
        )
        click.echo(f"results: {printable(str(output))}  (index.html shows them all)")
