"""Any table or figure of the paper by its name, and all of them with what they say."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

from rakelight.paper.plots import require_matplotlib
from rakelight.paper.report import claims, page
from rakelight.paper.runs import Runs
from rakelight.paper.sheet import Sheet
from rakelight.paper.table1 import table1_markdown
from rakelight.paper.table2 import table2_markdown
from rakelight.paper.write import as_json

NAMES = ("table1", "table2", "scenarios", *(f"figure{number}" for number in range(1, 9)))
ALL = "all"
PLOTTED = ("figure7", ALL)
"""These need matplotlib."""


def require_extras(what: str) -> None:
    """Raise MissingExtraError, before any work, when `what` cannot be drawn."""
    if what in PLOTTED:
        require_matplotlib()


def make(name: str, runs: Runs) -> Sheet:
    """The table or figure `name` of `NAMES`.

    >>> make("figure2", Runs(size=0.25)).name
    'figure2'
    """
    function = getattr(import_module(f"rakelight.paper.{name}"), name)
    if name == "table1":
        table = function(runs.size, progress=runs.progress, runs=runs)
        pictures = {f"_{scenario}": picture for scenario, picture in table.pictures.items()}
        title = "Table 1: errors of every method on three paints"
        return Sheet(name, title, table.cells, pictures, markdown=table1_markdown(table.cells))
    if name == "table2":
        rows = function(runs.size, progress=runs.progress)
        title = "Table 2: runtimes on the pattern scenario"
        return Sheet(name, title, rows, markdown=table2_markdown(rows))
    made: Sheet = function(runs)
    return made


def make_all(runs: Runs) -> tuple[dict[str, bytes], str]:
    """File name -> content of the whole paper, and the claims with their verdicts as JSON."""
    sheets = {name: make(name, runs) for name in NAMES}
    files: dict[str, bytes] = {}
    for sheet in sheets.values():
        files |= sheet.files()
    found = claims(sheets)
    said = as_json(found)
    return {**files, **page(sheets, found, runs.size), "paper.json": said.encode()}, said


def folder_of(what: str, runs: Runs) -> tuple[Mapping[str, bytes], str, str]:
    """The files of `what`, its rows as JSON, and what to show on a terminal."""
    if what == ALL:
        files, said = make_all(runs)
        return files, said, "paper.md says which of the paper's claims hold here\n"
    sheet = make(what, runs)
    return sheet.files(), as_json(sheet.rows), sheet.text
