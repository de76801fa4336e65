"""Figure 4: the preparation of the depth: as measured, holes filled, smoothed (the paper's 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.normals import surface_normals
from rakelight.metrics import depth_errors, normal_errors
from rakelight.model import Array, Capture, Floats, Truth
from rakelight.paper.drawing import close_up, profile
from rakelight.paper.figure3 import depth_camera, depth_mask, sensed_scene
from rakelight.paper.runs import Runs
from rakelight.paper.sheet import Sheet
from rakelight.pictures.clay import clay
from rakelight.pictures.colors import depth_colors
from rakelight.pictures.montage import in_column, in_row, panel
from rakelight.pictures.shown import object_window
from rakelight.prepare.denoise import bilateral
from rakelight.prepare.inpaint import inpaint
from rakelight.prepare.sensor import sensed


@dataclass(frozen=True, slots=True)
class Stage:
    """The depth after a step.

    roughness_mm : root mean square of its second differences
    rmse_mm, mae_deg : against the truth over the whole object, None where there is no truth
    """

    capture: str
    stage: str
    missing_percent: float
    roughness_mm: float
    rmse_mm: float | None
    mae_deg: float | None


def figure4(runs: Runs) -> Sheet:
    """The steps of `prepare`, one by one; of somebody's capture too.

    >>> [row.stage for row in figure4(Runs(size=0.25)).rows]
    ['measured', 'inpainted', 'smoothed']
    """
    capture, truth = sensed_scene(runs)
    stages = depth_stages(capture)
    rows = [_row("bust", name, depth_m, capture, truth) for name, depth_m in stages.items()]
    down, across = close_up(capture.mask)
    line = profile(((down.start + down.stop) // 2, across), truth=truth.depth, **stages)
    pictures = {"": _picture(stages, capture)}
    if runs.capture is not None:
        own = depth_stages(runs.capture)
        rows += [
            _row("capture", name, depth_m, runs.capture, None) for name, depth_m in own.items()
        ]
        pictures["_capture"] = _picture(own, runs.capture)
    title = "Figure 4: depth as measured, after inpainting, after smoothing"
    return Sheet("figure4", title, rows, pictures, {"_profile": line})


def depth_stages(capture: Capture) -> dict[str, Floats]:
    """Stage -> depth (h, w) in metres, NaN outside the object and where there is none."""
    mask = depth_mask(capture)
    average, sigma = sensed(capture, capture.mask)
    measured = np.where(mask, average, np.nan)
    filled = inpaint(measured, mask)
    sigma_m = float(np.nanmedian(sigma[mask]))
    pixel_m = float(np.median(filled[mask])) / depth_camera(capture).fx
    return {
        "measured": measured,
        "inpainted": filled,
        "smoothed": bilateral(filled, mask, sigma_m, pixel_m),
    }


def _row(name: str, stage: str, depth_m: Floats, capture: Capture, truth: Truth | None) -> Stage:
    mask = depth_mask(capture)
    bends = np.concatenate([np.diff(depth_m, 2, axis).ravel() for axis in (0, 1)])
    rmse_mm = mae_deg = None
    if truth is not None:
        normals = surface_normals(depth_m, np.isfinite(depth_m), depth_camera(capture))
        rmse_mm = depth_errors(depth_m, truth.depth, mask).rmse_mm
        mae_deg = normal_errors(normals, truth.normals, mask).mae_deg
    return Stage(
        name,
        stage,
        float(100 * np.mean(~np.isfinite(depth_m[mask]))),
        float(1000 * np.sqrt(np.nanmean(bends**2))),
        rmse_mm,
        mae_deg,
    )


def _picture(stages: dict[str, Floats], capture: Capture) -> Array:
    mask, camera = depth_mask(capture), depth_camera(capture)
    window = object_window(mask)
    return in_column(
        in_row(*(panel(depth_colors(z, mask)[window], name) for name, z in stages.items())),
        in_row(*(panel(clay(z, mask, camera)[window], name) for name, z in stages.items())),
    )
