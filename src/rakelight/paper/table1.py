"""Table 1: RMSE of depth and mean angular error of normals, per method and paint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rakelight.geometry.normals import surface_normals
from rakelight.metrics import Evaluation, evaluate_maps
from rakelight.model import Array, Progress, ProgressCallback, Truth, silent
from rakelight.paper.rows import ROWS, Row
from rakelight.paper.runs import Runs
from rakelight.paper.scenes import SCENARIOS
from rakelight.paper.write import Column, as_markdown
from rakelight.pictures.clay import shaded
from rakelight.pictures.montage import side_by_side
from rakelight.pictures.shown import object_window
from rakelight.prepare import prepare


@dataclass(frozen=True, slots=True)
class Cell:
    """One method on one scenario, beside the paper's numbers; None where it has none."""

    method: str
    scenario: str
    rmse_mm: float
    mae_deg: float
    paper_rmse_mm: float | None
    paper_mae_deg: float | None


COLUMNS = (
    Column("RMSE, mm", lambda cell: cell.rmse_mm, lambda cell: cell.paper_rmse_mm),
    Column("MAE, deg", lambda cell: cell.mae_deg, lambda cell: cell.paper_mae_deg),
)
"""What is printed of a cell; every field of it is in the JSON and CSV files."""


@dataclass(frozen=True)
class Table1:
    """The cells row by row, and a picture per scenario.

    pictures : scenario -> uint8 picture: the truth, then every row, as bare surfaces
    """

    cells: tuple[Cell, ...]
    pictures: dict[str, Array]


def table1(
    size: float = 1.0,
    rows: Sequence[Row] = ROWS,
    progress: ProgressCallback = silent,
    runs: Runs | None = None,
) -> Table1:
    """Run every method on the three scenarios.

    size : scale of the photographs, 640 x 480 at 1
    runs : scenes and results to share with figures, of that size

    >>> table = table1(size=0.1, rows=ROWS[:2])
    >>> [(cell.method, cell.rmse_mm > 0) for cell in table.cells[::3]]
    [('input reference', True), ('RGB-Fusion (no smooth)', True)]
    """
    scores: dict[tuple[str, str], Evaluation] = {}
    pictures: dict[str, Array] = {}
    runs = runs or Runs(size)
    steps = len(SCENARIOS) * len(rows)
    for scenario in SCENARIOS:
        strip: list[Array] = []
        for row in rows:
            progress(Progress(f"{scenario}: {row.label}", len(scores), steps))
            _, truth = runs.scene(scenario, row.lighting)
            if not strip:
                strip.append(_picture(truth.normals, truth))
            scores[row.label, scenario], normals = _score(row, scenario, runs)
            strip.append(_picture(normals, truth))
        pictures[scenario] = side_by_side(*strip)
    cells = tuple(
        _cell(row, index, scores[row.label, scenario])
        for row in rows
        for index, scenario in enumerate(SCENARIOS)
    )
    return Table1(cells, pictures)


def table1_markdown(cells: Sequence[Cell]) -> str:
    """Table 1 as the paper prints it, ours first and the paper's in brackets."""
    scenarios = dict.fromkeys(cell.scenario for cell in cells)
    lines: dict[str, list[str]] = {}
    for cell in cells:
        lines.setdefault(cell.method, []).extend(column.text(cell) for column in COLUMNS)
    titles = [f"{scenario} {column.title}" for scenario in scenarios for column in COLUMNS]
    return as_markdown(titles, lines)


def _score(row: Row, scenario: str, runs: Runs) -> tuple[Evaluation, Array]:
    capture, truth = runs.scene(scenario, row.lighting)
    if row.method is None:
        prepared = prepare(capture)
        depth = prepared.embed(prepared.depth_m, float("nan"))
        normals = surface_normals(depth, truth.mask, capture.camera)
    else:
        result = runs.result(row, scenario)
        depth, normals = result.depth, result.normals
    return evaluate_maps(depth, normals, truth), normals


def _picture(normals: Array, truth: Truth) -> Array:
    window = object_window(truth.mask)
    return shaded(normals[window], truth.mask[window])


def _cell(row: Row, index: int, scores: Evaluation) -> Cell:
    paper = row.paper[index] if row.paper else (None, None)
    return Cell(
        method=row.label,
        scenario=SCENARIOS[index],
        rmse_mm=scores.depth.rmse_mm,
        mae_deg=scores.normals.mae_deg,
        paper_rmse_mm=paper[0],
        paper_mae_deg=paper[1],
    )
