"""`rakelight import SOURCE -o CAPTURE`."""

from __future__ import annotations

import json
from pathlib import Path

import click

from rakelight.cli.options import (
    NamedPath,
    findings_as_json,
    output_folder,
    output_options,
    print_findings,
    refuse_input_as_output,
)
from rakelight.cli.progress import shown_progress
from rakelight.errors import counted, printable
from rakelight.model import Progress


class _Import(click.Command):
    """Knows of --json before --list, which ends the command, is looked at."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        ctx.meta[_AS_JSON] = "--json" in args
        return super().parse_args(ctx, args)


_AS_JSON = "rakelight.as_json"


def _list_readers(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted:
        return
    from rakelight.capture.readers import readers

    if ctx.meta[_AS_JSON]:
        keys = ("name", "reads", "extra")
        rows = [{key: getattr(reader, key) for key in keys} for reader in readers()]
        click.echo(json.dumps({"readers": rows}))
        ctx.exit()
    width = max(len(reader.name) for reader in readers())
    for reader in readers():
        extra = f'  (pip install "rakelight[{reader.extra}]")' if reader.extra else ""
        click.echo(f"{reader.name:{width}}  {reader.reads}{extra}")
    ctx.exit()


@click.command("import", cls=_Import)
@click.argument("source", type=NamedPath())
@output_folder("CAPTURE", "The capture folder; appears complete or not at all.")
@click.option("--overwrite", is_flag=True, help="Replace an older imported capture at CAPTURE.")
@click.option(
    "--list", is_flag=True, is_eager=True, expose_value=False, callback=_list_readers,
    help="Show what is read, and exit.",
)  # fmt: skip
@output_options
def command(
    source: Path, output: Path, overwrite: bool, as_json: bool, quiet: bool, debug: bool
) -> None:
    """Make a capture folder of SOURCE: a recording, a dataset's folder, loose photographs."""
    from rakelight.capture import CAPTURE, write_capture
    from rakelight.capture.readers import Wanted, find_reader
    from rakelight.folders import only_writer, require_free

    refuse_input_as_output(source, output, "source")
    require_free(output, manifest=CAPTURE, overwrite=overwrite)
    with only_writer(output), shown_progress(quiet or as_json, compiles=False) as progress:
        progress(Progress("read"))
        reader = find_reader(source)
        reading = reader.read(source, Wanted(progress=progress))
        progress(Progress("write"))
        kept = write_capture(
            reading.capture, output, contact_sheet=reading.contact_sheet, overwrite=overwrite
        )
    capture = reading.capture
    findings = (*capture.findings, *kept)
    if as_json:
        facts = {
            "output": printable(str(output)),
            "reader": reader.name,
            "photographs": len(capture.photographs),
            "names": list(capture.names),
            "size": [capture.camera.width, capture.camera.height],
            "pixels": int(capture.mask.sum()),
            "findings": findings_as_json(findings),
        }
        click.echo(json.dumps(facts))
    elif not quiet:
        print_findings(findings)
        click.echo(
            f"capture: {printable(str(output))}  "
            f"({reader.name}, {counted(len(capture.photographs), 'photograph')})"
        )
