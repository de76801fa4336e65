"""The three scenarios: what each method takes for paint and what for shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rakelight.model import Array, Floats, Mask, Truth
from rakelight.paper.rows import ROWS, Row
from rakelight.paper.runs import Runs
from rakelight.paper.scenes import SCENARIOS
from rakelight.paper.sheet import Sheet
from rakelight.pictures.clay import clay
from rakelight.pictures.colors import photograph_picture
from rakelight.pictures.montage import in_column, in_row, panel
from rakelight.pictures.shown import object_window

DETAIL_PX = 3.0
"""Detail is what an average over this many pixels, at 640 x 480, takes away."""


@dataclass(frozen=True, slots=True)
class Paint:
    """A method's albedo against the truth, after one scale for all of it.

    rmse : root mean square difference, 1 being white
    detail : correlation of its detail with the true detail, 1 being all of it
    """

    method: str
    scenario: str
    rmse: float
    detail: float


def scenarios(runs: Runs, rows: Sequence[Row] = ROWS) -> Sheet:
    """Albedo above depth, the truth first, for every paint and method."""
    paints: list[Paint] = []
    pictures: dict[str, Array] = {}
    methods = [row for row in rows if row.method is not None]
    for scenario in SCENARIOS:
        capture, truth = runs.scene(scenario, methods[0].lighting)
        window, mask = object_window(truth.mask), truth.mask
        above = [panel(photograph_picture(truth.albedo)[window], "truth")]
        below = [panel(clay(truth.depth, mask, capture.camera)[window], "truth")]
        for row in methods:
            result = runs.result(row, scenario)
            albedo = _scaled(result.albedo, truth)
            rmse = float(np.sqrt(np.mean((albedo - truth.albedo)[mask] ** 2, dtype=np.float64)))
            detail = detail_kept(albedo, truth.albedo, mask, DETAIL_PX * runs.size)
            paints.append(Paint(row.label, scenario, rmse, detail))
            above.append(panel(photograph_picture(albedo)[window], row.label))
            below.append(panel(clay(result.depth, mask, capture.camera)[window], row.label))
        pictures[f"_{scenario}"] = in_column(in_row(*above), in_row(*below))
    title = "The three scenarios: albedo and depth of every method"
    return Sheet("scenarios", title, paints, pictures)


def _scaled(albedo: Floats, truth: Truth) -> Floats:
    """The albedo times the factor that brings it closest to the truth's."""
    ours, theirs = (each[truth.mask].astype(float).ravel() for each in (albedo, truth.albedo))
    return albedo * float(ours @ theirs / max(ours @ ours, 1e-12))


def detail_kept(albedo: Floats, truth: Floats, mask: Mask, sigma_px: float) -> float:
    """Correlation of two albedos (H, W, 3) over a mask without what varies slowly.

    >>> rng = np.random.default_rng(0)
    >>> paint = rng.random((20, 20, 3))
    >>> round(detail_kept(paint * 0.5 + 0.2, paint, np.ones((20, 20), bool), 3.0), 6)
    1.0
    """
    from scipy.ndimage import gaussian_filter

    share = np.maximum(gaussian_filter(mask.astype(float), sigma_px), 1e-6)[..., None]
    fine = []
    for image in (albedo, truth):
        inside = np.where(mask[..., None], image, 0.0).astype(float)
        smooth = gaussian_filter(inside, (sigma_px, sigma_px, 0)) / share
        fine.append((inside - smooth)[mask].ravel())
    return float(np.corrcoef(fine)[0, 1])
