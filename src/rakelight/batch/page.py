"""OUT/index.html: every result of a batch at a glance; it asks for nothing but files beside it."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rakelight.batch.record import Entry
from rakelight.errors import printable
from rakelight.export.summary import program_version
from rakelight.report.page import page_text, shown
from rakelight.report.sealed import sealed


def index_html(out: Path, entries: Sequence[Entry]) -> bytes:
    """The page of a batch in the folder `out`, sealed; pictures and reports are beside it.

    >>> page = index_html(Path("out"), [Entry(source="/a/coin", name="coin", state="failed",
    ...                                       message="/a/coin: no such folder")])
    >>> b"no such folder" in page
    True
    """
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, finalize=shown,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    style = page_text("page.css") + _own("index.css")
    digest = b64encode(sha256(style.encode()).digest()).decode()
    done = [_row(entry) for entry in entries if entry.state == "done"]
    page = environment.from_string(_own("index.html")).render(
        # file: for the page as it lies on a disk, 'self' for one that a server gives out.
        policy=f"default-src 'none'; style-src 'sha256-{digest}'; img-src 'self' file: data:; "
        "base-uri 'none'; form-action 'none'",
        style=Markup(style),
        title=printable(out.resolve().name) or "batch",
        version=program_version(),
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
