"""Whether the depth grows where it should fall: disparity, or inverted depth, taken for depth.

Photographs do not distinguish relief from its mirror image in depth (the bas-relief ambiguity), but
the object's outline does.  What stands before a background is nearer than that; and a solid object
turns away from the camera towards its outline, so its depth grows there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.errors import CaptureError
from rakelight.geometry.blur import blurred
from rakelight.model import Capture, Finding, Floats
from rakelight.prepare.sensor import SensorGrid, sensed

# Of the square root of the object's area: smoothing of the depth, and width of the border in which
# slopes are taken, inside the outline, and the background is looked at, outside it.
SMOOTHING, BORDER = 0.02, 0.1
# Least pixels of a border.
FEWEST = 10
# The first pixels inside the outline see some of the background.
MIXED_PX = 1.5
# The border of the depth map counts as background where at least this share of it is measured.
MEASURED = 0.3
# Depth falls towards the outline on at least this share of the border: a hollow at the least.
FALLING = 0.8
# Without a background to compare with, its median slope (metres of depth per metre across) has to
# be as steep as that of solid objects: a warning, and beyond doubt.
STEEP, VERY_STEEP = -0.25, -0.5
REMEDY = (
    "turn disparity d into depth, focal length * baseline / d; if the object is a hollow, let the "
    "depth maps go on beyond the mask"
)


@dataclass(frozen=True, slots=True)
class Outline:
    """How the depth runs towards the object's outline.

    slope : median of the depth's outward slope in the border, metres per metre
    falling : share of the border where it falls
    behind : median log depth outside the outline less that inside; None where little is measured
    """

    slope: float
    falling: float
    behind: float | None


def inside_out(capture: Capture) -> tuple[Finding, ...]:
    """A warning where the depth may be inside out.

    Raises CaptureError where the outline says so beyond doubt.
    """
    outline = outline_of(capture)
    if outline is None or outline.falling < FALLING:
        return ()
    hollow = outline.behind is not None and outline.behind >= 0
    if hollow or (outline.behind is None and outline.slope > STEEP):
        return ()
    what = "the depth seems to be inside out: disparity taken for depth?"
    seen = f"depth falls towards the outline on {outline.falling:.0%} of it"
    if outline.behind is not None:
        seen += ", and what lies beyond is nearer"
    if outline.behind is not None or outline.slope <= VERY_STEEP:
        raise CaptureError(what, source=capture.source, seen=seen, remedy=REMEDY)
    return (Finding("warning", "depth-inside-out", f"{what} {seen}", REMEDY),)


def outline_of(capture: Capture) -> Outline | None:
    """How the depth of a capture runs towards its object's outline; None where nothing shows it."""
    from scipy.ndimage import distance_transform_edt

    depth_m, _ = sensed(replace(capture, depth_m=capture.depth_m[:1]))
    mask = SensorGrid(depth_m.shape, capture.mask.shape).covered(capture.mask)
    known = np.isfinite(depth_m)
    side = float(np.sqrt(np.count_nonzero(mask)))
    # The image's own border is no outline.
    inside = distance_transform_edt(np.pad(mask, 1, mode="edge"))[1:-1, 1:-1]
    border = mask & known & (inside > MIXED_PX) & (inside < MIXED_PX + BORDER * side)
    if mask.all() or np.count_nonzero(border) < max(side, FEWEST):
        return None
    camera = capture.camera.resized(*depth_m.shape[::-1])
    log_depth = np.log(np.where(known, depth_m, 1.0))
    sigma_px = max(SMOOTHING * side, 1.0)
    smooth = blurred(log_depth, sigma_px, mask & known)
    outward = _outward(blurred(inside, sigma_px, np.ones_like(mask)))
    down, right = np.gradient(smooth)
    slope = (camera.fx * right * outward[1] + camera.fy * down * outward[0])[border]
    beyond = ~mask & (distance_transform_edt(~mask) < MIXED_PX + BORDER * side)
    behind = None
    if np.count_nonzero(beyond & known) > MEASURED * np.count_nonzero(beyond):
        behind = float(np.median(log_depth[beyond & known]) - np.median(log_depth[border]))
    return Outline(float(np.median(slope)), float(np.mean(slope < 0)), behind)


def _outward(inside: Floats) -> Floats:
    """(2, h, w) unit vectors, down and right, along which the distance inside falls fastest."""
    uphill = np.stack([*np.gradient(inside)])
    return np.asarray(-uphill / np.maximum(np.linalg.norm(uphill, axis=0), 1e-9))
