"""What the depth is worth on the object: holes, noise, and whether its unit can be right."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.check.measured import Measured
from rakelight.geometry.grid import bounding_window
from rakelight.model import Capture, Finding
from rakelight.prepare.holes import hole_findings, within_reach
from rakelight.prepare.sensor import SensorGrid, no_depth, sensed

# Most depth maps that are looked at: their noise is right to a fifth.
MOST_MAPS = 6
# Share of the object without depth above which the photographs carry much of it.  Cautious: of 19
# random draws 1 is worse by a tenth with patches of 6 pixels missing from 10 %, 2 from 30 %
# (ablation.md).
MANY_HOLES = 0.10
# Distances, metres, at which depth cameras for objects measure; metres of an object's longer side
# that they can resolve and see whole.  Beyond, the unit of the depth is the likelier mistake.
# Taken from data sheets; of 51 random draws none is doubted as it is, all with depth 10 times too
# small or 25.4 times too large, 28 with 10 times too large: the others are within 6 m then
# (ablation.md).
LIKELY_M, LIKELY_WIDTH_M = (0.12, 6.0), (0.008, 4.0)


@dataclass(frozen=True, slots=True)
class DepthQuality:
    """The depth on the object.

    median_m, width_m, height_m : its distance, and what it takes up of the picture there
    holes : share of the object without depth
    noise_mm : standard deviation of a depth pixel: what the maps differ by, or the sensor's model
    pixels : depth pixels on the object
    """

    median_m: float
    width_m: float
    height_m: float
    holes: float
    noise_mm: float
    pixels: int


def depth_findings(measured: Measured) -> tuple[Finding, ...]:
    """What to say of the depth on the object; raises CaptureError where it has none."""
    found, holes = measured(depth_quality)
    if found is None:
        raise no_depth(measured.capture)
    return (*_unit(found), *_many_holes(found), *holes)


def some_maps(capture: Capture) -> Capture:
    """The capture with at most `MOST_MAPS` of its depth maps, evenly chosen."""
    every = -(-len(capture.depth_m) // MOST_MAPS)
    return replace(capture, depth_m=capture.depth_m[::every])


def depth_quality(capture: Capture) -> tuple[DepthQuality | None, tuple[Finding, ...]]:
    """The depth of a capture on its object, and what to say of its holes; None without depth."""
    depth_m, sigma_m = sensed(some_maps(capture), capture.mask)
    grid = SensorGrid(depth_m.shape, capture.mask.shape)
    inside = grid.of_object(capture.mask)
    measured = inside & np.isfinite(depth_m)
    if not measured.any():
        return None, ()
    median_m = float(np.median(depth_m[measured]))
    rows, columns = bounding_window(capture.mask)
    across = (columns.stop - columns.start) / capture.camera.fx
    along = (rows.stop - rows.start) / capture.camera.fy
    found = DepthQuality(
        median_m=median_m,
        width_m=median_m * across,
        height_m=median_m * along,
        holes=1 - float(np.count_nonzero(measured) / np.count_nonzero(inside)),
        noise_mm=1000 * float(np.median(sigma_m[measured])),
        pixels=int(np.count_nonzero(inside)),
    )
    reached = within_reach(measured, inside)
    return found, hole_findings(inside, reached, measured, grid.factor)


def one_value(measured: Measured) -> tuple[Finding, ...]:
    """A warning where all of the depth is one value, which no sensor gives."""
    depth_m = measured.capture.depth_m
    known = depth_m[np.isfinite(depth_m)]
    if known.size < 2 or np.ptp(known) > 0:
        return ()
    message = f"every depth value is {known[0]:.4g} m: the depth shows no shape"
    remedy = "look at the depth map: it may be a placeholder, or of another capture"
    return (Finding("warning", "depth-one-value", message, remedy),)


def _many_holes(found: DepthQuality) -> tuple[Finding, ...]:
    if found.holes <= MANY_HOLES:
        return ()
    message = f"{found.holes:.0%} of the object has no depth: the photographs carry it there"
    remedy = "change the distance or the angle, keep the lamp out of the sensor, or spray it matt"
    return (Finding("warning", "depth-holes", message, remedy),)


def _unit(found: DepthQuality) -> tuple[Finding, ...]:
    """A warning where distance or size are none that a depth camera sees.

    >>> codes = [DepthQuality(z, w, w, 0.0, 1.0, 9) for z, w in ((0.6, 0.2), (0.06, 0.02))]
    >>> [[finding.code for finding in _unit(each)] for each in codes]
    [[], ['depth-unit']]
    """
    longer_m = max(found.width_m, found.height_m)
    seen = ((found.median_m, LIKELY_M), (longer_m, LIKELY_WIDTH_M))
    if all(least <= value <= most for value, (least, most) in seen):
        return ()
    message = (
        f"by its depth the object is {found.median_m:.3g} m away and {longer_m:.3g} m long: "
        "is the unit right?"
    )
    remedy = "compare with a ruler and correct depth_scale, the depth value of one metre"
    return (Finding("warning", "depth-unit", message, remedy),)
