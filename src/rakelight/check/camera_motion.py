"""Camera motion: how far each photograph is shifted against the others.

Corners of one photograph are found again in each of the others (prepare/detail.py), in what lies
around the object, whose pattern the lamp does not change, and on the object.  Where relief repeats
its shading moves with the lamp as if all of it moved; so a shift counts only where the photographs,
moved back, explain one another better than as they are (others.py): paint, outline and relief have
to have moved alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rakelight.check.evidence import LIKELY
from rakelight.check.measured import Measured
from rakelight.check.others import band, better_explained
from rakelight.errors import listed
from rakelight.geometry.grid import bounding_window
from rakelight.geometry.masks import dilate
from rakelight.model import Array, Capture, Finding, Floats, Mask
from rakelight.prepare.detail import FEWEST, corners_of, detail, shift_between
from rakelight.prepare.linear import to_linear

# Margins around the object, over its width: of what shows the object and its border, and of what
# shows its surroundings; those are then seen at no less than half the object's resolution.
MARGIN, AROUND = 0.1, 0.5
# Pixels of the mask's border that are not surroundings: photographs are blurred, masks are narrow.
BORDER_PX = 4
# Pixels along the window's longer side at which photographs are compared, at the least.
SIDE_PX = 400
# Least fraction of the photographs that have a shift.
MOST = 0.65
# Largest shift that light alone causes: pixels, and median deviations of the corners.
MOVED_PX, MOVED_DEVIATIONS = 0.6, 3.0
# Standard deviations of the two blurs between which photographs are compared, pixels: of shifts as
# small as `MOVED_PX` finer detail says most.
FINE_PX, COARSE_PX = 1.0, 4.0
# Fewest pixels on which photographs are compared.
FEWEST_PIXELS = 500
# Probability that any photograph of a camera at rest counts as moved for the scatter of the shifts:
# moving shadows shift corners of one photograph alike, which its own corners do not show.
FALSE_ALARM = 0.01
# Median length of normally distributed shifts, over the standard deviation of one component.
RAYLEIGH_MEDIAN = float(np.sqrt(2 * np.log(2)))


def camera_motion(measured: Measured) -> tuple[Finding, ...]:
    """A warning where photographs are shifted against the others, with the pixels and their names.

    None unless most photographs have a shift: without texture a surface shows shading alone.
    """
    shifts, moved = measured(stood_still)
    if not moved.any():
        return ()
    farthest = shifts[np.argmax(np.where(moved, np.hypot(*shifts.T), 0))]
    message = (
        f"the camera moved between the photographs: {listed(measured.names, moved)} "
        f"shifted by {in_words(farthest, 1)} at most"
    )
    remedy = "fix the camera and take these again, or leave them out"
    return (Finding("warning", "camera-moved", message, remedy),)


def in_words(shift_px: Floats, digits: int) -> str:
    """A shift (2,), pixels right and down, for people.

    >>> in_words(np.array([3.0, -4.0]), 0)
    '5 pixels (3 right, 4 up)'
    """
    words = ("right", "left"), ("down", "up")
    parts = (
        f"{abs(x):.{digits}f} {word[int(x < 0)]}" for x, word in zip(shift_px, words, strict=True)
    )
    return f"{np.hypot(*shift_px):.{digits}f} pixels ({', '.join(parts)})"


@dataclass(frozen=True, slots=True)
class View:
    """A part of the image, reduced, in which photographs are compared.

    window : rows and columns of the image; step : by which it is reduced
    where : (h, w) pixels of it whose corners are looked for
    """

    window: tuple[slice, ...]
    step: int
    where: Mask

    def reduced(self, photograph: Array) -> Array:
        """(h, w, 3) what a photograph (H, W, 3) shows there."""
        size = self.where.shape[::-1]
        return np.asarray(cv2.resize(photograph[self.window], size, interpolation=cv2.INTER_AREA))


def views(mask: Mask) -> tuple[View, View]:
    """The surroundings of an object, and the object with its border."""
    width, found = float(np.sqrt(mask.sum())), []
    for margin in (AROUND, MARGIN):
        window = bounding_window(mask, round(margin * width))
        height, across = mask[window].shape
        step = max(round(max(height, across) / SIDE_PX), 1)
        found.append(View(window, step, np.ones((height // step, across // step), dtype=bool)))
    size = found[0].where.shape[::-1]
    object_there = cv2.resize(mask[found[0].window].astype(np.uint8), size) > 0
    beside = ~dilate(object_there, BORDER_PX)
    return View(found[0].window, found[0].step, beside), found[1]


def stood_still(capture: Capture) -> tuple[Floats, Array]:
    """(N, 2) shift of every photograph, pixels right and down, and (N,) which of them moved.

    Shifts are those beside the position in which most photographs are; NaN = not known.  The object
    is looked at unless its surroundings tell of every photograph.
    """
    count = len(capture.photographs)
    known = np.full((count, 2), np.nan), np.zeros(count, dtype=bool)
    for view in views(capture.mask):
        brightness = [float(each[view.window][::4, ::4].mean()) for each in capture.photographs]
        reference = int(np.argsort(brightness)[count // 2])
        shifts, moved = beside_most(*_tracked(capture, view, reference))
        moved &= confirmed(capture, view, shifts, moved)
        if moved.any() or np.isnan(known[0]).all():
            known = view.step * shifts, moved
        if moved.any() or np.isfinite(shifts).all():
            break
    return known


def beside_most(shifts: Floats, deviation: Floats) -> tuple[Floats, Array]:
    """Shifts (N, 2) beside the position of most, and (N,) which of them light does not cause.

    deviation : (N,) of each photograph's corners; NaN, and all of them so where few are known
    """
    count = len(shifts)
    if np.isfinite(deviation).mean() < MOST:
        return np.full((count, 2), np.nan), np.zeros(count, dtype=bool)
    apart = np.hypot(*(shifts[:, None] - shifts).transpose(2, 0, 1))
    most = apart[np.argmax((apart < MOVED_PX).sum(axis=1))] < MOVED_PX
    shifts = shifts - np.median(shifts[most], axis=0)
    length = np.hypot(*shifts.T)
    sigma_px = float(np.median(length[most])) / RAYLEIGH_MEDIAN
    by_light = max(MOVED_PX, sigma_px * float(np.sqrt(-2 * np.log(FALSE_ALARM / count))))
    return shifts, length > np.fmax(by_light, MOVED_DEVIATIONS * deviation)


def confirmed(capture: Capture, view: View, shifts: Floats, which: Array) -> Array:
    """(N,) which of those photographs the others explain better with all moved back.

    shifts : (N, 2) reduced pixels, NaN = not known
    """
    found = np.zeros(len(shifts), dtype=bool)
    back = np.nan_to_num(shifts)
    border = int(np.ceil(np.abs(back).max())) + round(FINE_PX)
    there = np.zeros(view.where.shape, dtype=bool)
    there[border:-border, border:-border] = True
    if not which.any() or np.count_nonzero(there) < FEWEST_PIXELS:
        return found
    before, after = [], []
    for photograph, (right, down) in zip(capture.photographs, back, strict=True):
        light = to_linear(photograph[view.window], capture.encoding).mean(axis=-1)
        grey = cv2.resize(light, there.shape[::-1], interpolation=cv2.INTER_AREA)
        motion = np.array([[1.0, 0.0, -right], [0.0, 1.0, -down]])
        moved = cv2.warpAffine(
            grey, motion, there.shape[::-1],
            flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        before.append(band(grey, FINE_PX, COARSE_PX)[there])
        after.append(band(moved, FINE_PX, COARSE_PX)[there])
    many = float(np.log(len(shifts)))  # any of so many may look moved
    both = np.stack(before), np.stack(after)
    for i in np.flatnonzero(which).tolist():
        found[i] = better_explained(*both, i, there) - many >= LIKELY
    return found


def _tracked(capture: Capture, view: View, reference: int) -> tuple[Floats, Floats]:
    """(N, 2) shifts from the reference and (N,) the corners' median deviation; NaN = not known.

    All are NaN as soon as those of too many photographs are, so the least alike are tried first.
    """
    count = len(capture.photographs)
    shifts, deviation = np.full((count, 2), np.nan), np.full(count, np.nan)
    unknown = shifts.copy(), deviation.copy()
    first = detail(view.reduced(capture.photographs[reference]))
    corners = corners_of(first, view.where) if view.where.any() else None
    if corners is None or len(corners) < FEWEST:
        return unknown
    shifts[reference], deviation[reference] = 0.0, 0.0
    pictures = [detail(view.reduced(each)) for each in capture.photographs]
    alike = [_alike(first, each) for each in pictures]
    for tried, i in enumerate([i for i in np.argsort(alike) if i != reference], 2):
        found = shift_between(first, pictures[i], corners)
        if found is not None:
            shifts[i], deviation[i] = found
        if np.isfinite(deviation).sum() + count - tried < MOST * count:
            return unknown
    return shifts, deviation


def _alike(one: Array, other: Array) -> float:
    """Correlation of two pictures (h, w), of a ninth of their pixels; 0 where one is plain."""
    with np.errstate(invalid="ignore"):
        correlation = np.corrcoef(one[::3, ::3].ravel(), other[::3, ::3].ravel())[0, 1]
    return float(np.nan_to_num(correlation))
