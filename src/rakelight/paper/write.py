"""A table as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any


def as_json(rows: Sequence[Any]) -> str:
    """`{"rows": [...]}` of dataclass instances; a missing number is null."""
    return json.dumps({"rows": [asdict(row) for row in rows]}, indent=1)


def as_csv(rows: Sequence[Any]) -> str:
    """A header of field names and a line per row; a missing number is an empty field."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(field.name for field in fields(rows[0]))
    for row in rows:
        writer.writerow("" if value is None else value for value in asdict(row).values())
    return text.getvalue()


@dataclass(frozen=True, slots=True)
class Column:
    """A number of every cell or row, as a table prints it: ours, and the paper's in brackets.

    ours, paper : of a cell or row; the paper's is None where it has none
    format : of both
    """

    title: str
    ours: Callable[[Any], float]
    paper: Callable[[Any], float | None] = lambda _: None
    format: str = ".2f"

    def text(self, row: Any) -> str:
        """The entry of a cell or row."""
        ours, paper = format(self.ours(row), self.format), self.paper(row)
        return ours if paper is None else f"{ours} ({format(paper, self.format)})"


def as_markdown(titles: Sequence[str], lines: Mapping[str, Sequence[str]]) -> str:
    """A table of methods: entries (name -> one per title), the paper's own in brackets.

    >>> print(as_markdown(["seconds"], {"ours": ["1.00 (2.00)"]}))
    | method | seconds |
    | --- | --- |
    | ours | 1.00 (2.00) |
    <BLANKLINE>
    In brackets: the paper's own numbers.
    <BLANKLINE>
    """
    head = [f"| method | {' | '.join(titles)} |", "| --- |" + " --- |" * len(titles)]
    body = [f"| {method} | {' | '.join(entries)} |" for method, entries in lines.items()]
    return "\n".join([*head, *body, "", "In brackets: the paper's own numbers.", ""])
