"""`rakelight paper table1 -o DIR`."""

from __future__ import annotations

from pathlib import Path

import click

from rakelight.cli.options import output_options
from rakelight.cli.progress import shown_progress
from rakelight.errors import printable


@click.command("paper")
@click.argument("what", type=click.Choice(["table1", "table2"]))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    required=True,
    metavar="DIR",
    help="Where the table goes as Markdown, CSV and JSON, with pictures.",
)
@click.option("--size", type=float, default=1.0, show_default=True, help="Scale of 640 x 480.")
@click.option("--overwrite", is_flag=True, help="Replace an older table at DIR.")
@output_options
def command(
    what: str,
    output: Path,
    size: float,
    overwrite: bool,
    as_json: bool,
    quiet: bool,
    debug: bool,
) -> None:
    """Run the paper's experiment on synthetic captures and print the table.

    table1: errors of every method on three paintings of one object.  table2: runtimes.
    """
    from rakelight.capture.images import encode_png
    from rakelight.errors import InputError
    from rakelight.files import require_free, staged_folder, write_bytes
    from rakelight.paper.table1 import table1
    from rakelight.paper.table2 import table2
    from rakelight.paper.write import as_csv, table1_markdown, table2_markdown
    from rakelight.paper.write import as_json as to_json

    if not 0.1 <= size <= 4:
        raise InputError("not a size", source="--size", seen=str(size), needed="0.1 to 4")
    marker = f"{what}.json"
    require_free(output, overwrite=overwrite, marker=marker)
    pictures = {}
    with shown_progress(quiet or as_json) as progress:
        if what == "table1":
            table = table1(size, progress=progress)
            rows, markdown, pictures = table.cells, table1_markdown(table.cells), table.pictures
        else:
            rows = table2(size, progress=progress)  # type: ignore[assignment]
            markdown = table2_markdown(rows)
    with staged_folder(output, overwrite=overwrite, marker=marker) as staging:
        write_bytes(staging / f"{what}.md", markdown.encode())
        write_bytes(staging / f"{what}.csv", as_csv(rows).encode())
        for name, picture in pictures.items():
            write_bytes(staging / f"{what}_{name}.png", encode_png(picture))
        write_bytes(staging / marker, to_json(rows).encode())
    if as_json:
        click.echo(to_json(rows))
    elif not quiet:
        click.echo(markdown)
        click.echo(f"written to {printable(str(output))}")
