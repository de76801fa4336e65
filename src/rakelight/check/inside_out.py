"""Whether the depth grows where it should fall: disparity, or inverted depth, taken for depth.

Photographs do not distinguish relief from its mirror image in depth (the bas-relief ambiguity), but
the object's surroundings do: an object stands before its background, and a solid one turns away
from the camera towards its outline.  An object that is a hollow itself turns towards the camera
there, and one with a side wall, a bowl sunk in a table or a niche, has surroundings that are nearer
by a jump.  So the outline alone gives a warning; whether the depth is refused is for the
photographs to say (`pipeline.inside_out`).  What stands in a frame is no hollow.

Both figures are taken from sectors around the object.  Errors of the depth are correlated over much
of a sector and little between sectors, so these give the variance of their mean; see `evidence`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.check.evidence import LIKELY, PRIOR, SURELY, log_likelihood_ratio
from rakelight.check.measured import Measured
from rakelight.geometry.blur import blurred
from rakelight.model import Array, Capture, Finding, Floats, Mask
from rakelight.prepare.sensor import SensorGrid, sensed

# Of the square root of the object's area: smoothing of the depth, and width of the border in which
# slopes are taken, inside the outline, and the background is looked at, outside it.
SMOOTHING, BORDER = 0.02, 0.1
# Least pixels of a border, and of a sector's part of it.
FEWEST, FEWEST_OF_SECTOR = 10, 2
# Sectors around the object's middle: 30 degrees each, a quarter of the object's width at its
# outline.  With 8 or 16 the same draws are found (3000 to 3099, docs/results/depth-sensor.md).
SECTORS = 12
# The first pixels inside the outline see some of the background.
MIXED_PX = 1.5
# The border of the depth map counts as background where at least this share of it is measured.
MEASURED = 0.3
# Prior probability that the depth of a sound object falls towards its outline, as random captures
# are drawn; and the evidence for a nearer background that then makes inverted depth as likely.
HOLLOW = 0.1
LIKELY_WHERE_IT_FALLS = float(np.log(HOLLOW / PRIOR))
# Where no background decides, the median slope (metres of depth per metre across) has to be as
# steep as that of solid objects: rims of low relief are less so.
STEEP = -0.25
# Depth of a hole over its width beyond which it is taken for inverted depth unless the photographs
# deny it: a lamp 45 degrees off the camera's axis does not reach its bottom.
DEEPEST = 1.0
# Least share of each of the image's sides that a mask of the background takes; where an object
# stands on one, it has less of it than the background.
MOST_OF_SIDE = 0.5
REMEDY = (
    "turn disparity d into depth, focal length * baseline / d; if the object is a hollow, let the "
    "depth maps go on beyond the mask, or hold the lamp nearer"
)


@dataclass(frozen=True, slots=True)
class Outline:
    """How the depth runs towards the object's outline, in sectors around it.

    slope : (K,) medians of the depth's outward slope in the border, metres per metre
    behind : (K,) median depth outside the outline less that inside, in units of what a slope of 1
        makes over the border's width; empty where little is measured outside
    falling : share of the border where depth falls
    """

    slope: Floats
    behind: Floats
    falling: float

    @property
    def falls(self) -> float:
        """Evidence that depth falls towards the outline: a hollow, or inverted depth."""
        return log_likelihood_ratio(-self.slope)

    @property
    def nearer(self) -> float:
        """Evidence that what lies beyond the outline is nearer."""
        return log_likelihood_ratio(-self.behind)

    @property
    def jumps(self) -> Floats:
        """(K,) how much nearer it is than the object's own slope makes it, in the same units."""
        return np.minimum(self.slope, 0) - self.behind

    @property
    def falls_and_jumps(self) -> bool:
        """Whether depth falls and jumps nearer for sure: a recess with a side wall, or inverted."""
        return min(self.falls, log_likelihood_ratio(self.jumps)) >= SURELY

    @property
    def deeper_than_wide(self) -> bool:
        """Whether the jump is larger than the object is wide: hardly a recess that is lit."""
        return BORDER * float(np.nanmedian(self.jumps)) > DEEPEST


def inside_out(measured: Measured) -> tuple[Finding, ...]:
    """A warning where the depth may be inside out."""
    outline = measured(outline_of)
    if outline is None or outline.falls < LIKELY:
        return ()
    if holds_the_frame(measured.capture.mask) and outline.nearer >= LIKELY:
        return ()  # the mask may be inverted; see `inverted_mask`
    seen = f"depth falls towards the outline on {outline.falling:.0%} of it"
    if outline.nearer >= LIKELY_WHERE_IT_FALLS:
        what = "the object is sunk in its surroundings, or its depth inside out: disparity?"
        seen += ", and what lies beyond is nearer"
    elif outline.nearer > -LIKELY and np.median(outline.slope) <= STEEP:
        what = "the object is a hollow, or its depth inside out: disparity taken for depth?"
    else:
        return ()
    return (Finding("warning", "depth-inside-out", f"{what} {seen}", REMEDY),)


def holds_the_frame(mask: Mask) -> bool:
    """Whether a mask (h, w) takes most of each of the image's four sides, and not all of it."""
    sides = mask[0], mask[-1], mask[:, 0], mask[:, -1]
    return not mask.all() and all(side.mean() > MOST_OF_SIDE for side in sides)


def outline_of(capture: Capture) -> Outline | None:
    """How the depth of a capture runs towards its object's outline; None where nothing shows it."""
    from scipy.ndimage import distance_transform_edt

    depth_m, _ = sensed(replace(capture, depth_m=capture.depth_m[:1]))
    mask = SensorGrid(depth_m.shape, capture.mask.shape).covered(capture.mask)
    measured = np.isfinite(depth_m)
    side = float(np.sqrt(np.count_nonzero(mask)))
    # The image's own border is no outline.
    inside = distance_transform_edt(np.pad(mask, 1, mode="edge"))[1:-1, 1:-1]
    border = mask & measured & (inside > MIXED_PX) & (inside < MIXED_PX + BORDER * side)
    if mask.all() or np.count_nonzero(border) < max(side, FEWEST):
        return None
    camera = capture.camera.resized(*depth_m.shape[::-1])
    log_depth = np.log(np.where(measured, depth_m, 1.0))
    sigma_px = max(SMOOTHING * side, 1.0)
    smooth = blurred(log_depth, sigma_px, mask & measured)
    outward = _outward(blurred(inside, sigma_px, np.ones_like(mask)))
    down, right = np.gradient(smooth)
    slope = camera.fx * right * outward[1] + camera.fy * down * outward[0]
    beyond = ~mask & (distance_transform_edt(~mask) < MIXED_PX + BORDER * side)
    seen = beyond & measured
    sector = _sectors(mask)
    slopes = _medians(slope, border, sector)
    behind = np.full(SECTORS, np.nan)
    if np.count_nonzero(seen) > MEASURED * np.count_nonzero(beyond):
        behind = _medians(log_depth, seen, sector) - _medians(log_depth, border, sector)
    there = np.isfinite(slopes)
    unit = BORDER * side / float(np.sqrt(camera.fx * camera.fy))
    return Outline(slopes[there], behind[there] / unit, float(np.mean(slope[border] < 0)))


def _outward(inside: Floats) -> Floats:
    """(2, h, w) unit vectors, down and right, along which the distance inside falls fastest."""
    uphill = np.stack([*np.gradient(inside)])
    return np.asarray(-uphill / np.maximum(np.linalg.norm(uphill, axis=0), 1e-9))


def _sectors(mask: Mask) -> Array:
    """(h, w) the sector, 0 to `SECTORS` - 1, around the middle of a mask that each pixel is in."""
    rows, columns = np.mgrid[: mask.shape[0], : mask.shape[1]]
    angle = np.arctan2(rows - rows[mask].mean(), columns - columns[mask].mean())
    return np.asarray(((angle / (2 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS)


def _medians(image: Floats, where: Mask, sector: Array) -> Floats:
    """(SECTORS,) medians of an image over the sectors of a mask; NaN where there is too little."""
    values = [image[where & (sector == k)] for k in range(SECTORS)]
    return np.array(
        [np.median(each) if len(each) >= FEWEST_OF_SECTOR else np.nan for each in values]
    )
