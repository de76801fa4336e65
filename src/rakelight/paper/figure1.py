"""Figure 1: the sensor's depth and the refined depth as surfaces, with a close-up."""

from __future__ import annotations

from dataclasses import dataclass

from rakelight.geometry.normals import surface_normals
from rakelight.metrics import evaluate_maps
from rakelight.model import Array, Result
from rakelight.paper.drawing import FACE, close_up, profile, turned
from rakelight.paper.runs import MAIN, Runs
from rakelight.paper.sheet import Sheet
from rakelight.pictures.clay import clay
from rakelight.pictures.montage import in_column, in_row, panel
from rakelight.pictures.shown import object_window

YAW_DEG = 35.0
MIDDLE = (0.5, 0.5)


@dataclass(frozen=True, slots=True)
class Surface:
    """A surface of the figure and how far it is from the truth."""

    surface: str
    rmse_mm: float
    mae_deg: float


def figure1(runs: Runs) -> Sheet:
    """The bust before and after our joint method; somebody's capture too."""
    _, truth = runs.scene(MAIN, "moving-lamp")
    result = runs.joint()
    before = surface_normals(result.prepared_depth, truth.mask, result.camera)
    rows = []
    for name, depth_m, normals in (
        ("input", result.prepared_depth, before),
        ("refined", result.depth, result.normals),
    ):
        scores = evaluate_maps(depth_m, normals, truth)
        rows.append(Surface(name, scores.depth.rmse_mm, scores.normals.mae_deg))
    down, across = close_up(truth.mask)
    line = profile(
        ((down.start + down.stop) // 2, across),
        truth=truth.depth,
        input=result.prepared_depth,
        refined=result.depth,
    )
    pictures = {"": surfaces(result, FACE)}
    own = runs.refined()
    if own is not None:
        pictures["_capture"] = surfaces(own[1], MIDDLE)
    title = "Figure 1: depth before and after, as surfaces"
    return Sheet("figure1", title, rows, pictures, {"_profile": line})


def surfaces(result: Result, where: tuple[float, float]) -> Array:
    """Input above refined: from the front, turned, and close, `where` of `close_up`."""
    mask, camera = result.mask, result.camera
    window, close = object_window(mask), close_up(mask, where)
    rows = []
    for name, depth_m in (("input", result.prepared_depth), ("refined", result.depth)):
        front = clay(depth_m, mask, camera)
        rows.append(
            in_row(
                panel(front[window], f"{name}, front"),
                panel(turned(depth_m, mask, camera, YAW_DEG), f"{name}, turned {YAW_DEG:.0f} deg"),
                panel(front[close], f"{name}, close-up", width=front[window].shape[0]),
            )
        )
    return in_column(*rows)
