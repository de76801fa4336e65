"""`rakelight paper all -o DIR`, or one table or figure."""

from __future__ import annotations

from pathlib import Path

import click

from rakelight.cli.options import (
    NamedPath,
    output_folder,
    output_options,
    print_findings,
    refuse_input_as_output,
)
from rakelight.cli.progress import shown_progress
from rakelight.errors import printable

FIGURES = [f"figure{number}" for number in range(1, 9)]
OF_A_CAPTURE = ("figure1", "figure3", "figure4", "figure5", "all")
"""What can show a capture of one's own."""


@click.command("paper")
@click.argument("what", type=click.Choice(["all", "table1", "table2", "scenarios", *FIGURES]))
@output_folder("DIR", "Where it goes as Markdown, CSV and JSON, with pictures.")
@click.option("--size", type=float, default=1.0, show_default=True, help="Scale of 640 x 480.")
@click.option(
    "--capture",
    type=NamedPath(),
    metavar="FOLDER",
    help="A capture of your own, for figures 1, 3, 4 and 5.",
)
@click.option("--overwrite", is_flag=True, help="Replace an older one at DIR.")
@output_options
def command(
    what: str,
    output: Path,
    size: float,
    capture: Path | None,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    debug: bool,
) -> None:
    """Run the paper's experiment on synthetic captures: a table, a figure, or all of it.

    table1: errors of every method on three paints.  table2: runtimes.  scenarios: what the
    methods take for paint.  all: everything, and paper.md, which says what holds of the paper.
    """
    from rakelight.capture import load_capture
    from rakelight.errors import InputError
    from rakelight.files import write_bytes
    from rakelight.folders import file_list, only_writer, require_free, staged_folder
    from rakelight.paper.make import folder_of, require_extras
    from rakelight.paper.runs import Runs
    from rakelight.prepare.undistort import undistorted

    if not 0.1 <= size <= 4:
        raise InputError("not a size", source="--size", seen=str(size), needed="0.1 to 4")
    if capture is not None and what not in OF_A_CAPTURE:
        raise InputError(
            f"{what} is of synthetic captures alone",
            source="--capture",
            seen=printable(str(capture)),
            needed=f"--capture for {', '.join(OF_A_CAPTURE)}",
            remedy="leave it away",
        )
    require_extras(what)
    if capture is not None:
        refuse_input_as_output(capture, output)
    manifest = file_list(f"paper's {what}")
    require_free(output, manifest=manifest, overwrite=overwrite)
    own = None if capture is None else undistorted(load_capture(capture))
    with only_writer(output):
        with shown_progress(quiet or as_json) as progress:
            files, rows, text = folder_of(what, Runs(size, own, progress))
        with staged_folder(output, manifest=manifest, overwrite=overwrite) as staging:
            for name, content in files.items():
                (staging.path / name).parent.mkdir(exist_ok=True)
                write_bytes(staging.path / name, content)
    if not quiet:
        print_findings(staging.findings)
    if as_json:
        click.echo(rows)
    elif not quiet:
        click.echo(text)
        click.echo(f"written to {printable(str(output))}")
