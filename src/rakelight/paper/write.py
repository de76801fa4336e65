"""A table as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, fields
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


def table1_markdown(cells: Sequence[Any]) -> str:
    """Table 1 as the paper prints it, ours first and the paper's in brackets."""
    scenarios = list(dict.fromkeys(cell.scenario for cell in cells))
    head = [f"{s} RMSE, mm | {s} MAE, deg" for s in scenarios]
    lines = [
        "| method | " + " | ".join(head) + " |",
        "| --- |" + " --- | --- |" * len(scenarios),
    ]
    for method in dict.fromkeys(cell.method for cell in cells):
        entries = []
        for cell in (cell for cell in cells if cell.method == method):
            entries += [
                _beside(cell.rmse_mm, cell.paper_rmse_mm),
                _beside(cell.mae_deg, cell.paper_mae_deg),
            ]
        lines.append(f"| {method} | " + " | ".join(entries) + " |")
    return "\n".join([*lines, "", "In brackets: the paper's own numbers.", ""])


def table2_markdown(rows: Sequence[Any]) -> str:
    """Table 2, ours first and the paper's in brackets."""
    lines = ["| method | seconds | parameters |", "| --- | --- | --- |"]
    for row in rows:
        lines.append(
            f"| {row.method} | {_beside(row.seconds, row.paper_seconds)} | {row.parameters} |"
        )
    return "\n".join([*lines, "", "In brackets: the paper's own numbers.", ""])


def _beside(ours: float, paper: float | None) -> str:
    shown = f"{ours:.2f}"
    return shown if paper is None else f"{shown} ({paper:.2f})"
