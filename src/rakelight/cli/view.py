"""`rakelight view OUT`."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from rakelight.cli.options import NamedPath
from rakelight.errors import InputError, MachineError
from rakelight.files import clear_errors


@click.command("view")
@click.argument("result", type=NamedPath(), metavar="OUT")
@click.option("--print", "only_print", is_flag=True, help="Print the report's address, no more.")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def command(result: Path, only_print: bool, debug: bool) -> None:
    """Open the report of the result folder OUT in the browser, to turn and relight the object.

    Of a folder that `rakelight batch` wrote, the page of all its results.
    """
    import webbrowser

    address = report_address(result)
    if only_print:
        click.echo(address)
    elif not webbrowser.open(address):
        raise MachineError(
            "no browser could be started",
            source=str(result),
            remedy=f"open {address} in one",
        )


def report_address(folder: Path) -> str:
    """The file: address of a folder's report, or page; bytes that do not print are escaped in it.

    folder : of a result, or one that `batch` wrote

    An older result that a killed run had moved aside is put back first.

    Raises InputError when the folder has none.
    """
    from rakelight.batch.record import INDEX, RECORD
    from rakelight.folders import put_back

    folder = put_back(folder)
    with clear_errors(str(folder), "cannot be read"):
        if (report := folder / "report.html").is_file():
            return report.resolve().as_uri()
        page, record = folder / INDEX, folder / RECORD
        of_batch = page.is_file() and record.is_file()
    if not of_batch:
        raise InputError(
            "no report here",
            source=str(folder),
            needed="a result folder with report.html",
            remedy="name the folder that `rakelight refine` wrote",
        )
    return page.resolve().as_uri()


def view_command(folder: Path) -> str:
    """What to type to see the report.

    >>> view_command(Path("out of it")), view_command(Path("-out"))
    ("rakelight view 'out of it'", 'rakelight view ./-out')
    """
    shown = str(folder)
    return f"rakelight view {shlex.quote(f'./{shown}' if shown.startswith('-') else shown)}"
