"""Camera motion: how far each photograph is shifted against the others.

Corners of one photograph are found again in each of the others (prepare/detail.py).
"""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.check.measured import Measured
from rakelight.errors import listed
from rakelight.geometry.grid import bounding_window
from rakelight.model import Array, Capture, Finding, Floats
from rakelight.prepare.detail import corners_of, shift_between
from rakelight.prepare.detail import detail as detail_of

# Margin around the object, over its width, for the background behind it.
MARGIN = 0.1
# Pixels along the window's longer side at which photographs are compared, at the least.
SIDE_PX = 400
# Least fraction of the photographs that have a shift.
MOST = 0.65
# Largest shift that light alone causes: pixels, and median deviations of the corners.
MOVED_PX, MOVED_DEVIATIONS = 0.6, 3.0
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


def stood_still(capture: Capture) -> tuple[Floats, Array]:
    """(N, 2) shift of every photograph, pixels right and down, and (N,) which of them moved.

    Shifts are those beside the position in which most photographs are; NaN = not known.
    """
    count = len(capture.photographs)
    window = bounding_window(capture.mask, round(MARGIN * np.sqrt(capture.mask.sum())))
    step = max(round(max(capture.mask[window].shape) / SIDE_PX), 1)
    pictures = [detail(each[window], step) for each in capture.photographs]
    brightness = [float(each[window][::4, ::4].mean()) for each in capture.photographs]
    shifts, deviation = _tracked(pictures, int(np.argsort(brightness)[count // 2]))
    if np.isfinite(deviation).mean() < MOST:
        return np.full((count, 2), np.nan), np.zeros(count, dtype=bool)
    apart = np.hypot(*(shifts[:, None] - shifts).transpose(2, 0, 1))
    most = apart[np.argmax((apart < MOVED_PX).sum(axis=1))] < MOVED_PX
    shifts -= np.median(shifts[most], axis=0)
    length = np.hypot(*shifts.T)
    sigma_px = float(np.median(length[most])) / RAYLEIGH_MEDIAN
    by_light = max(MOVED_PX, sigma_px * float(np.sqrt(-2 * np.log(FALSE_ALARM / count))))
    return step * shifts, length > np.fmax(by_light, MOVED_DEVIATIONS * deviation)


def detail(photograph: Array, step: int) -> Array:
    """(h, w) uint8 the detail of a photograph (H, W, 3), `step` times smaller."""
    size = photograph.shape[1] // step, photograph.shape[0] // step
    return detail_of(np.asarray(cv2.resize(photograph, size, interpolation=cv2.INTER_AREA)))


def _tracked(pictures: list[Array], reference: int) -> tuple[Floats, Floats]:
    """(N, 2) shifts from the reference and (N,) the corners' median deviation; NaN = not known."""
    shifts, deviation = np.full((len(pictures), 2), np.nan), np.full(len(pictures), np.nan)
    first = pictures[reference]
    corners = corners_of(first)
    if corners is None:
        return shifts, deviation
    for i, picture in enumerate(pictures):
        found = shift_between(first, picture, corners)
        if found is not None:
            shifts[i], deviation[i] = found
    return shifts, deviation
