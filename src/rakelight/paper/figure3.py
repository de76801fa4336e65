"""Figure 3: what comes in: a photograph, and depth with missing areas and steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.model import Array, Camera, Capture, Floats, Mask, Truth
from rakelight.paper.drawing import close_up, profile
from rakelight.paper.runs import MAIN, Runs
from rakelight.paper.scenes import PAPER_OPTIONS, paper_camera
from rakelight.paper.sheet import Sheet
from rakelight.pictures.clay import clay
from rakelight.pictures.colors import depth_colors, photograph_picture
from rakelight.pictures.montage import in_row, panel
from rakelight.pictures.shown import object_window
from rakelight.prepare.linear import to_linear
from rakelight.prepare.sensor import SensorGrid, sensed, sensor_shape
from rakelight.synthetic import DepthNoise, make_albedo, render_scene

# A structured-light sensor's: noise that is smooth over a few pixels, steps, holes.
SENSOR = DepthNoise(
    rms_mm=2.5, correlation_length_px=5.0, step_mm=2.0, hole_fraction=0.03, hole_size_px=10.0
)


@dataclass(frozen=True, slots=True)
class Sensed:
    """A depth map as the sensor gives it.

    step_mm : the smallest difference between two depths that occur
    rmse_mm : against the truth where it measured, None where there is no truth
    """

    capture: str
    pixels: int
    missing_percent: float
    different_depths: int
    step_mm: float
    rmse_mm: float | None


def sensed_scene(runs: Runs) -> tuple[Capture, Truth]:
    """The patterned bust before a sensor with all its faults, one photograph."""
    options = replace(
        PAPER_OPTIONS,
        camera=paper_camera(runs.size),
        depth_noise=SENSOR,
        photographs=1,
    )
    return render_scene(runs.bust, make_albedo(MAIN), options)


def figure3(runs: Runs) -> Sheet:
    """Colour, depth and a close-up of the depth's steps; somebody's capture too.

    >>> [round(row.missing_percent) for row in figure3(Runs(size=0.25)).rows]
    [3]
    """
    capture, truth = sensed_scene(runs)
    rows = [_sensed("bust", capture, truth)]
    pictures = {"": _picture(capture)}
    down, across = close_up(capture.mask)
    line = profile(
        ((down.start + down.stop) // 2, across), truth=truth.depth, sensed=capture.depth_m[0]
    )
    if runs.capture is not None:
        rows.append(_sensed("capture", runs.capture, None))
        pictures["_capture"] = _picture(runs.capture)
    title = "Figure 3: a photograph, and depth with missing areas and steps"
    return Sheet("figure3", title, rows, pictures, {"_profile": line})


def depth_mask(capture: Capture) -> Mask:
    """(h, w) the object at the depth map's resolution."""
    return SensorGrid(sensor_shape(capture), capture.mask.shape).touched(capture.mask)


def depth_camera(capture: Capture) -> Camera:
    """The camera of the depth map, or of what it is registered to: it has the photographs' view."""
    height, width = sensor_shape(capture)
    return capture.camera.resized(width, height)


def first_map_m(capture: Capture) -> Floats:
    """(h, w) the first depth map, registered to the colour camera if it has a camera of its own."""
    if capture.depth_camera is None:
        return np.asarray(capture.depth_m[0])
    return sensed(replace(capture, depth_m=capture.depth_m[:1]), capture.mask)[0]


def _sensed(name: str, capture: Capture, truth: Truth | None) -> Sensed:
    depth_m, mask = first_map_m(capture), depth_mask(capture)
    measured = mask & np.isfinite(depth_m) & (np.nan_to_num(depth_m) > 0)
    depths_mm = np.unique(np.round(1000 * depth_m[measured].astype(float), 3))
    rmse_mm = None
    if truth is not None:
        error_mm = 1000 * (depth_m - truth.depth)[measured & truth.mask]
        rmse_mm = float(np.sqrt(np.mean(error_mm.astype(float) ** 2)))
    return Sensed(
        capture=name,
        pixels=int(mask.sum()),
        missing_percent=float(100 * (1 - measured.sum() / mask.sum())),
        different_depths=len(depths_mm),
        step_mm=float(np.diff(depths_mm).min()) if len(depths_mm) > 1 else 0.0,
        rmse_mm=rmse_mm,
    )


def _picture(capture: Capture) -> Array:
    mask = depth_mask(capture)
    first_m = first_map_m(capture)
    depth_m = np.where(first_m > 0, first_m, np.nan)
    window, close = object_window(mask), close_up(mask)
    colour = photograph_picture(to_linear(capture.photographs[0], capture.encoding))
    height, width = depth_m[window].shape
    return in_row(
        panel(colour[object_window(capture.mask)], "photograph", width),
        panel(depth_colors(depth_m, mask)[window], "depth; white: missing"),
        panel(clay(depth_m, mask, depth_camera(capture))[close], "close-up as clay", height),
    )
