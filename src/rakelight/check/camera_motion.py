"""Camera motion: how far each photograph is shifted against the others.

The shifts with which photographs explain one another best (alignment.py), first of what lies around
the object, whose pattern the lamp does not change, then of the object.  Where relief repeats its
shading moves with the lamp as if all of it moved; so shifts count only where the photographs, moved
back, explain one another clearly better than as they are (others.py): paint, outline and relief
have to have moved alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from rakelight.check.alignment import (
    FEWEST_PIXELS,
    SHORTEST_PX,
    aligned,
    details,
    moved_back,
    shifts_among,
    within,
)
from rakelight.check.evidence import LIKELY, evidence_in_blocks
from rakelight.check.exposure import UNDEREXPOSED, exposure
from rakelight.check.measured import Measured
from rakelight.check.others import better_explained, log_likelihood
from rakelight.errors import listed
from rakelight.geometry.grid import bounding_window
from rakelight.geometry.masks import dilate
from rakelight.model import Array, Capture, Encoding, Finding, Floats, Mask
from rakelight.prepare.linear import to_linear

# Margins around the object, over its width: of what shows the object and its border, and of what
# shows its surroundings; those are then seen at no less than half the object's resolution.
MARGIN, AROUND = 0.1, 0.5
# Pixels of the mask's border that are not surroundings: photographs are blurred, masks are narrow.
BORDER_PX = 4
# Pixels along the window's longer side at which photographs are compared, at the least.
SIDE_PX = 400
# Largest shift that light alone causes, pixels of a view.
MOVED_PX = 0.6
# Root mean square of a photograph's detail, white being 1, that is more than rounding: float32's is
# 6e-8, a step of 8 bits 3e-4.
LEAST_DETAIL = 1e-5
# Below this share of the photographs, those in one position are too few to be of a camera at rest:
# it was held in a hand.  Of one that drifts a quarter are (not varied on draws).
FEW = 0.25
# Probability that any photograph of a camera at rest counts as moved for the scatter of the shifts:
# moving shadows shift what is seen of one photograph alike.
FALSE_ALARM = 0.01
# Most times that shifts of the photographs that moved are found again; each time fewer may count.
MOST_ROUNDS = 8
# Median length of normally distributed shifts, over the standard deviation of one component.
RAYLEIGH_MEDIAN = float(np.sqrt(2 * np.log(2)))


def camera_motion(measured: Measured) -> tuple[Finding, ...]:
    """A warning where photographs are shifted against the others, with pixels and names."""
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
    where : (h, w) pixels of it in which shifts are looked for; how well photographs explain one
        another is judged by all
    """

    window: tuple[slice, ...]
    step: int
    where: Mask

    def light(self, photograph: Array, encoding: Encoding) -> Array:
        """(h, w) float32 linear light, 0 to 1, of a photograph (H, W, 3), averaged as encoded."""
        size = self.where.shape[::-1]
        values = cv2.resize(photograph[self.window], size, interpolation=cv2.INTER_AREA)
        return np.asarray(to_linear(values, encoding).mean(axis=-1), dtype=np.float32)


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

    Shifts are those beside the position in which most photographs are; NaN = not known.
    """
    known = np.full((len(capture.photographs), 2), np.nan)
    # Where the lamp hardly reaches the object there are shadows and ambient light.
    brightness = exposure(capture).brightness
    lit = brightness >= UNDEREXPOSED * np.median(brightness)
    for view in views(capture.mask):
        shifts, moved = seen_in(view, capture, lit)
        if moved.any():
            return shifts, moved
        known = np.where(np.isnan(known), shifts, known)
    return known, moved


def seen_in(view: View, capture: Capture, lit: Array) -> tuple[Floats, Array]:
    """As `stood_still`, by what a view shows of those photographs that are lit, (N,)."""
    pictures = [view.light(each, capture.encoding) for each in capture.photographs]
    bands, count = details(pictures), len(pictures)
    all_shifts, all_moved = np.full((count, 2), np.nan), np.zeros(count, dtype=bool)
    clear = lit & np.array([has_detail(each[view.where]) for each in bands])
    pictures, bands = (
        [each for each, shown in zip(images, clear, strict=True) if shown]
        for images in (pictures, bands)
    )
    shifts = shifts_among(pictures, view.where)
    if shifts is None:
        return all_shifts, all_moved
    shifts, moved = beside_most(shifts)
    sure = confirmed(bands, shifts, moved)
    if sure:
        shifts, moved = realigned(bands, shifts, moved)
        moved &= each_confirmed(bands, shifts)
        sure = confirmed(bands, shifts, moved)
    moved &= sure
    # What the light does to a photograph at rest is no shift of it.
    shifts[~moved & (np.hypot(*shifts.T) >= MOVED_PX)] = np.nan
    all_shifts[clear], all_moved[clear] = view.step * shifts, moved
    return all_shifts, all_moved


def has_detail(values: Floats) -> bool:
    """Whether the detail (P,) of a photograph is more than rounding."""
    return values.size > 0 and float(np.sqrt((values**2).mean())) > LEAST_DETAIL


def realigned(bands: list[Array], shifts: Floats, moved: Array) -> tuple[Floats, Array]:
    """The shifts (N, 2) of the pictures that moved, found again, and which of these still count.

    Those at rest are where they are, and explain the others better than all did that could move.

    bands : `details` of N pictures
    """
    everywhere = np.ones(bands[0].shape, dtype=bool)
    for _ in range(MOST_ROUNDS):
        which, before = moved[:, None], np.where(moved[:, None], shifts, 0.0)
        shifts = aligned(bands, everywhere, before, which)
        moved = np.hypot(*shifts.T) > MOVED_PX
        if np.abs(shifts - before).max() < SHORTEST_PX:
            break
    return np.where(moved[:, None], shifts, 0.0), moved


def beside_most(shifts: Floats) -> tuple[Floats, Array]:
    """Shifts (N, 2) beside the position of most, and (N,) which of them light does not cause.

    Where few are in one position, as of a camera in a hand, they are beside the middle of all.
    """
    apart = np.hypot(*(shifts[:, None] - shifts).transpose(2, 0, 1))
    most = apart[np.argmax((apart < MOVED_PX).sum(axis=1))] < MOVED_PX
    few = np.count_nonzero(most) < max(FEW * len(shifts), 2)
    shifts = shifts - np.median(shifts if few else shifts[most], axis=0)
    length = np.hypot(*shifts.T)
    if few:
        return shifts, length > MOVED_PX
    sigma_px = float(np.median(length[most])) / RAYLEIGH_MEDIAN
    by_light = max(MOVED_PX, sigma_px * float(np.sqrt(-2 * np.log(FALSE_ALARM / len(shifts)))))
    return shifts, length > by_light


def confirmed(bands: list[Array], shifts: Floats, moved: Array) -> bool:
    """Whether pictures explain one another better with those that moved moved back.

    bands : `details` of N pictures; shifts : (N, 2); moved : (N,)
    """
    if not moved.any():
        return False
    before, after, there = compared(bands, np.where(moved[:, None], shifts, 0.0))
    return bool(there.any()) and better_explained(before, after, there) >= LIKELY


def each_confirmed(bands: list[Array], shifts: Floats) -> Array:
    """(N,) which pictures the others explain better moved back, as these are, than not.

    bands : `details` of N pictures; shifts : (N, 2), 0 of those at rest
    """
    found = np.zeros(len(bands), dtype=bool)
    before, after, there = compared(bands, shifts)
    products = after @ after.T
    needed = LIKELY + float(np.log(len(bands)))  # any of so many may look moved
    for i in np.flatnonzero(shifts.any(axis=1) & there.any()).tolist():
        still, back = (log_likelihood(each[i], after, products, i) for each in (before, after))
        found[i] = evidence_in_blocks(back - still, there) >= needed
    return found


def compared(bands: list[Array], shifts: Floats) -> tuple[Floats, Floats, Mask]:
    """(N, P) the details of N pictures as they are and moved back, and (h, w) those P pixels.

    No pixels where those that all pictures have are too few.
    """
    there = within(np.ones(bands[0].shape, dtype=bool), shifts)
    there &= np.count_nonzero(there) >= FEWEST_PIXELS
    before, after = (
        np.stack([each[there] for each in images]).astype(np.float64)
        for images in (bands, moved_back(bands, shifts))
    )
    return before, after, there
