"""Figure 6: two shining objects: several lights outvote a highlight, one photograph believes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rakelight.geometry.normals import surface_normals
from rakelight.metrics import depth_errors, normal_errors
from rakelight.model import Array, Capture, Floats, Mask, Progress, Truth, silent
from rakelight.paper.rows import Row
from rakelight.paper.runs import MAIN, Runs, row_of
from rakelight.paper.scenes import PAPER_OPTIONS, paper_camera
from rakelight.paper.sheet import Sheet
from rakelight.pictures.clay import clay
from rakelight.pictures.colors import depth_colors, normal_map, photograph_picture
from rakelight.pictures.montage import in_column, in_row, panel
from rakelight.pictures.shown import object_window
from rakelight.prepare.linear import to_linear
from rakelight.synthetic import make_albedo, make_shape, render_scene

OBJECTS = ("vase", "head")
METHODS = ("rgbd-fusion", "multi-light-alternating", "multi-light")
FEW, MANY = 4, 12
"""Photographs: as many as in the paper's figure, and as in its tables."""
HIGHLIGHT = 0.05
"""A highlight adds at least this much to a value, white being 1."""
SHINY = replace(PAPER_OPTIONS, specular=0.5, specular_exponent=40.0, exposure=0.7)


@dataclass(frozen=True, slots=True)
class Shining:
    """A surface of a shining object: errors over all of it, and where the first photograph shines.

    highlight_percent : share of the object where it does
    """

    shape: str
    photographs: int
    surface: str
    rmse_mm: float
    mae_deg: float
    highlight_mae_deg: float
    highlight_percent: float


def figure6(runs: Runs) -> Sheet:
    """RGB-Fusion from the first of four photographs, multi-light from all four, and from twelve."""
    rows: list[Shining] = []
    strips: list[Array] = []
    for name in OBJECTS:
        for count in (FEW, MANY):
            runs.progress(Progress(f"figure6: {name}", count, MANY))
            capture, truth, shines = shining_scene(name, count, runs)
            surfaces = _surfaces(capture, truth, METHODS if count == FEW else METHODS[1:])
            rows += [
                _row(name, count, label, *surface, truth, shines)
                for label, surface in surfaces.items()
                if count == FEW or label != "input"
            ]
            if count == FEW:
                strips.append(_picture(capture, truth, surfaces))
    title = "Figure 6: shining objects; of four photographs the picture"
    return Sheet("figure6", title, rows, {"": in_column(*strips)})


def shining_scene(name: str, count: int, runs: Runs) -> tuple[Capture, Truth, Mask]:
    """A shining object, its truth, and (H, W) where its first photograph has a highlight."""
    shape = runs.bust if name == "head" else make_shape(name)
    options = replace(SHINY, camera=paper_camera(runs.size), photographs=count)
    paint = make_albedo(MAIN)
    capture, truth = render_scene(shape, paint, options)
    dull, _ = render_scene(shape, paint, replace(options, specular=0.0))
    added = (capture.photographs[0].astype(float) - dull.photographs[0]).max(axis=-1)
    return capture, truth, truth.mask & (added > HIGHLIGHT * capture.white)


def _surfaces(
    capture: Capture, truth: Truth, methods: Sequence[str]
) -> dict[str, tuple[Floats, Floats]]:
    """The input and the methods' labels -> depth and normals."""
    surfaces: dict[str, tuple[Floats, Floats]] = {}
    for method in methods:
        row = row_of(method)
        result = row.run(_seen_by(row, capture), silent)
        before = result.prepared_depth
        surfaces["input"] = before, surface_normals(before, truth.mask, capture.camera)
        surfaces[row.label] = result.depth, result.normals
    return surfaces


def _seen_by(row: Row, capture: Capture) -> Capture:
    return capture if row.lighting == "moving-lamp" else capture.select([0])


def _row(
    name: str, count: int, label: str, depth_m: Floats, normals: Floats, truth: Truth, shines: Mask
) -> Shining:
    return Shining(
        name,
        count,
        label,
        depth_errors(depth_m, truth.depth, truth.mask).rmse_mm,
        normal_errors(normals, truth.normals, truth.mask).mae_deg,
        normal_errors(normals, truth.normals, shines).mae_deg,
        float(100 * shines.sum() / truth.mask.sum()),
    )


def _picture(capture: Capture, truth: Truth, surfaces: dict[str, tuple[Floats, Floats]]) -> Array:
    window, mask = object_window(truth.mask), truth.mask
    surfaces = {"truth": (truth.depth, truth.normals), **surfaces}
    photograph = photograph_picture(to_linear(capture.photographs[0], capture.encoding))
    above = [
        panel(normal_map(normals)[window], f"{label}: normals")
        for label, (_, normals) in surfaces.items()
    ]
    below = [
        panel(clay(depth_m, mask, capture.camera)[window], f"{label}: depth")
        for label, (depth_m, _) in surfaces.items()
    ]
    colors = panel(depth_colors(truth.depth, mask)[window], "true depth")
    first = panel(photograph[window], "the first photograph")
    return in_column(in_row(first, *above), in_row(colors, *below))
