"""Figure 8: with and without the depth sensor: multi-light beside LDR-PS, front and side."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.metrics import evaluate_maps, normal_errors
from rakelight.model import Array, Camera, Floats, Mask, Result, Truth, silent
from rakelight.paper.bas_relief import bas_relief_aligned
from rakelight.paper.drawing import profile, turned
from rakelight.paper.runs import MAIN, Runs, row_of
from rakelight.paper.scenes import PAPER_OPTIONS
from rakelight.paper.sheet import Sheet
from rakelight.pictures.clay import clay
from rakelight.pictures.montage import in_column, in_row, panel
from rakelight.pictures.shown import object_window
from rakelight.synthetic import make_albedo, render_scene

METHODS = ("multi-light", "multi-light-alternating", "ldr-ps")
LAMBERTIAN = "LDR-PS, even grey paint, no ambient light"
SIDE_DEG = 80.0
JUMP_M = 0.010
"""Neighbours whose true depths differ by more lie on either side of a jump."""
BESIDE_PX = 3
"""The height of a jump is read this far from it on either side."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A recovered surface.

    rmse_mm : as it comes; LDR-PS has its distance from the depth map
    aligned_rmse_mm : after the best scale and offset of depth
    mae_deg, bas_relief_mae_deg : of the normals as they come and after the best bas-relief
    jump_percent : height of its depth jumps over that of the true ones
    """

    method: str
    rmse_mm: float
    aligned_rmse_mm: float
    mae_deg: float
    bas_relief_mae_deg: float
    jump_percent: float


def figure8(runs: Runs) -> Sheet:
    """The patterned bust by three methods; last LDR-PS on the scene that its model asks for."""
    capture, truth = runs.scene(MAIN, "moving-lamp")
    mask, camera = truth.mask, capture.camera
    rows, depths = [], {"truth": np.asarray(truth.depth, float)}
    for method in METHODS:
        row = row_of(method)
        result = runs.result(row, MAIN)
        rows.append(_row(row.label, result, truth))
        depths[row.label] = result.depth
    options = replace(PAPER_OPTIONS, camera=camera, ambient=0.0)
    grey, grey_truth = render_scene(runs.bust, make_albedo("grey"), options)
    rows.append(_row(LAMBERTIAN, row_of("ldr-ps").run(grey, silent), grey_truth))
    line = profile((object_window(mask)[0], _middle(mask)), **depths)
    title = "Figure 8: with the depth sensor and without, front and side"
    picture = _picture(depths, mask, camera)
    return Sheet("figure8", title, rows, {"": picture}, {"_profile": line})


def _row(label: str, result: Result, truth: Truth) -> Shape:
    scores = evaluate_maps(result.depth, result.normals, truth)
    aligned = bas_relief_aligned(result.normals, truth.normals, truth.mask)
    return Shape(
        label,
        scores.depth.rmse_mm,
        aligned_rmse_mm(result.depth, truth.depth, truth.mask),
        scores.normals.mae_deg,
        normal_errors(aligned, truth.normals, truth.mask).mae_deg,
        100 * jump_share(result.depth, truth.depth, truth.mask),
    )


def aligned_rmse_mm(depth_m: Floats, truth_m: Floats, mask: Mask) -> float:
    """RMS difference in millimetres after the scale and offset of depth that make it least.

    >>> truth = np.array([[0.7, 0.8, 0.9]])
    >>> round(aligned_rmse_mm(2 * truth - 0.5, truth, np.ones((1, 3), bool)), 9)
    0.0
    """
    z, t = depth_m[mask].astype(float), truth_m[mask].astype(float)
    slope, offset = np.polyfit(z - z.mean(), t, 1)
    return float(1000 * np.sqrt(np.mean((slope * (z - z.mean()) + offset - t) ** 2)))


def jump_share(depth_m: Floats, truth_m: Floats, mask: Mask) -> float:
    """How much of the true depth jumps' height is there, 1 being all of it.

    >>> truth = np.array([[0.7] * 5 + [0.8] * 5])
    >>> round(jump_share(0.4 * truth, truth, np.ones((1, 10), bool)), 9)
    0.4
    """
    found = true = 0.0
    span = 2 * BESIDE_PX - 1
    for z, t, inside in ((depth_m, truth_m, mask), (depth_m.T, truth_m.T, mask.T)):
        middle = slice(BESIDE_PX - 1, len(t) - BESIDE_PX + 1)
        with np.errstate(invalid="ignore"):
            jump = np.abs(np.diff(t[middle], axis=0)) > JUMP_M
        jump &= inside[:-span] & inside[span:]
        step_m = (t[span:] - t[:-span])[jump].astype(float)
        found += float(np.sum((z[span:] - z[:-span])[jump] * np.sign(step_m)))
        true += float(np.abs(step_m).sum())
    return found / true


def _middle(mask: Mask) -> int:
    """The column in the middle of the object."""
    return int(np.median(np.nonzero(mask)[1]))


def _picture(depths: dict[str, Floats], mask: Mask, camera: Camera) -> Array:
    window = object_window(mask)
    front = [panel(clay(z, mask, camera)[window], f"{name}, front") for name, z in depths.items()]
    side = [panel(turned(z, mask, camera, SIDE_DEG), f"{name}, side") for name, z in depths.items()]
    return in_column(in_row(*front), in_row(*side))
