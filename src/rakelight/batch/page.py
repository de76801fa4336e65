"""OUT/index.html: every result of a batch at a glance; it asks for nothing but files beside it."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from rakelight.batch.record import Entry
from rakelight.errors import printable
from rakelight.report.sealed import sealed
from rakelight.report.template import page_text, rendered


def index_html(out: Path, entries: Sequence[Entry]) -> bytes:
    """The page of a batch in the folder `out`, sealed; pictures and reports are beside it.

    >>> page = index_html(Path("out"), [Entry(source="/a/coin", name="coin", state="failed",
    ...                                       message="/a/coin: no such folder")])
    >>> b"no such folder" in page
    True
    """
    done = [_row(entry) for entry in entries if entry.state == "done"]
    page = rendered(
        _own("index.html"),
        style=page_text("page.css") + _own("index.css"),
        # file: for the page as it lies on a disk, 'self' for one that a server gives out.
        image_sources="'self' file: data:",
        title=printable(out.resolve().name) or "batch",
        total=len(entries),
        done=done,
        failed=[entry for entry in entries if entry.state == "failed"],
        waiting=[entry for entry in entries if entry.state == "waiting"],
        warned=sum(bool(row["figures"].warnings) for row in done),
    )
    return sealed(page, "batch")


def _own(name: str) -> str:
    """The content of a file of this folder."""
    return files("rakelight.batch").joinpath(name).read_text(encoding="utf-8")


def _row(entry: Entry) -> dict[str, Any]:
    """What the page says of a result, and where its files are."""
    folder = quote(entry.name)
    figures = entry.figures
    error = None if figures is None else figures.prediction_error
    return {
        "name": entry.name,
        "source": entry.source,
        "figures": figures,
        "error": "" if error is None else f"{100 * error:.1f} %",
        "report": f"{folder}/report.html",
        "preview": f"{folder}/preview.png",
    }
