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
    """Open the report of the result folder OUT in the browser, to turn and relight the object."""
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
    """The file: address of a result folder's report; bytes that do not print are escaped in it.

    An older result that a killed run had moved aside is put back first.

    Raises InputError when the folder has none.
    """
    from rakelight.folders import put_back

    report = put_back(folder) / "report.html"
    with clear_errors(str(folder), "cannot be read"):
        there = report.is_file()
    if not there:
        raise InputError(
            "no report here",
            source=str(folder),
            needed="a result folder with report.html",
            remedy="name the folder that `rakelight refine` wrote",
        )
    return report.resolve().as_uri()


def view_command(folder: Path) -> str:
    """What to type to see the report.

    >>> view_command(Path("out of it")), view_command(Path("-out"))
    ("rakelight view 'out of it'", 'rakelight view ./-out')
    """
    shown = str(folder)
    return f"rakelight view {shlex.quote(f'./{shown}' if shown.startswith('-') else shown)}"
