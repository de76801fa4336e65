"""One table or figure: its numbers, its pictures, and the files that hold them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from rakelight.capture.images import encode_png
from rakelight.model import Array
from rakelight.paper.write import as_csv, as_json

SECONDS = "_seconds"
"""The suffix of files whose numbers are times, and so differ from run to run."""


@dataclass(frozen=True)
class Sheet:
    """A table or figure of the paper on our captures.

    name : "table1", "figure1", ...; title : one line for people
    rows : dataclass instances of one kind, the numbers
    more : suffix -> further rows, such as "_profile"; `SECONDS` for times
    pictures : suffix -> uint8 picture, (H, W) or (H, W, 3) RGB
    markdown : the rows as a table for people, made from their fields where it is empty
    """

    name: str
    title: str
    rows: Sequence[Any]
    pictures: Mapping[str, Array] = field(default_factory=dict)
    more: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    markdown: str = ""

    @property
    def text(self) -> str:
        """The rows as Markdown."""
        return self.markdown or markdown_table(self.rows)

    def files(self) -> dict[str, bytes]:
        """File name -> content: Markdown, JSON, a CSV per kind of rows, a PNG per picture."""
        return {
            f"{self.name}.md": self.text.encode(),
            f"{self.name}.json": as_json(self.rows).encode(),
            **{
                f"{self.name}{suffix}.csv": as_csv(rows).encode()
                for suffix, rows in {"": self.rows, **self.more}.items()
            },
            **{
                f"{self.name}{suffix}.png": encode_png(picture)
                for suffix, picture in self.pictures.items()
            },
        }


def markdown_table(rows: Sequence[Any]) -> str:
    """Dataclass instances as a Markdown table; fields are the columns, two decimals.

    >>> from rakelight.model import Progress
    >>> print(markdown_table([Progress("solve", 3, 7, 0.5)]))
    | stage | step | steps | energy |
    | --- | --- | --- | --- |
    | solve | 3 | 7 | 0.50 |
    <BLANKLINE>
    """
    names = [each.name for each in fields(rows[0])]
    lines = [names, ["---"] * len(names)]
    lines += [[_shown(getattr(row, name)) for name in names] for row in rows]
    return "\n".join(f"| {' | '.join(line).replace('_', ' ')} |" for line in lines) + "\n"


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.2f}" if isinstance(value, float) else str(value)
