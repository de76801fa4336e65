"""Camera motion: how far each photograph is shifted against the others.

Lights change what a surface looks like, so photographs are compared by the detail that light hardly
changes: logarithms without their low frequencies, of equal contrast everywhere.  Corners of one
photograph are tracked into each of the others and back (Shi & Tomasi 1994, Lucas & Kanade 1981).
Those of paint, seams and background agree about a motion; those of shading and shadows do not.
"""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.errors import listed
from rakelight.geometry.grid import bounding_window
from rakelight.model import Array, Capture, Finding, Floats

# Margin around the object, over its width, for the background behind it.
MARGIN = 0.1
# Pixels along the window's longer side at which photographs are compared, at the least.
SIDE_PX = 400
# Side, pixels, of the box blur whose result is subtracted; noise floor, over the bright parts'
# value; least contrast of the logarithms.
DETAIL_PX, FLOOR, FLAT = 25, 0.05, 0.02
# Corners: most, least quality over the best one's, least distance in pixels.
CORNERS, CORNER_QUALITY, APART_PX = 200, 0.02, 5
# Window, pixels, and pyramid levels of Lucas-Kanade.
WINDOW_PX, LEVELS = 15, 3
# Largest error, pixels, of a corner tracked there and back; largest distance from the median shift.
BACK_PX, SAME_PX = 0.2, 0.5
# Least number of corners for a shift, and least fraction of them that agree with the median.
FEWEST, AGREEING = 30, 0.6
# Least fraction of the photographs that have a shift.
MOST = 0.65
# Largest shift that light alone causes: pixels, and median deviations of the corners.
MOVED_PX, MOVED_DEVIATIONS = 0.6, 3.0


def camera_motion(capture: Capture) -> tuple[Finding, ...]:
    """A warning where photographs are shifted against the others, with the pixels and their names.

    None unless most photographs have a shift: without texture a surface shows shading alone.
    """
    return motion_finding(capture, *stood_still(capture))


def motion_finding(capture: Capture, shifts: Floats, moved: Array) -> tuple[Finding, ...]:
    """The warning about photographs that moved, from what `stood_still` says of the capture."""
    if not moved.any():
        return ()
    names = capture.names or tuple(f"photograph {i}" for i in range(len(moved)))
    farthest = shifts[np.argmax(np.where(moved, np.hypot(*shifts.T), 0))]
    message = (
        f"the camera moved between the photographs: {listed(names, moved)} "
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
    return step * shifts, np.hypot(*shifts.T) > np.fmax(MOVED_PX, MOVED_DEVIATIONS * deviation)


def detail(photograph: Array, step: int) -> Array:
    """(h, w) uint8 the detail of a photograph (H, W, 3), `step` times smaller."""
    size = photograph.shape[1] // step, photograph.shape[0] // step
    small = cv2.resize(photograph, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    grey = cv2.cvtColor(small, cv2.COLOR_RGB2GRAY)
    floor = max(FLOOR * float(np.quantile(grey[::4, ::4], 0.95)), 1.0)
    log = np.log(grey + floor)
    fine = log - cv2.blur(log, (DETAIL_PX, DETAIL_PX))
    power = cv2.blur(fine**2, (2 * DETAIL_PX, 2 * DETAIL_PX))
    contrast = np.sqrt(np.maximum(power, FLAT**2))  # running sums may end below zero
    return np.asarray(np.clip(128 + 50 * fine / contrast, 0, 255), np.uint8)


def _tracked(pictures: list[Array], reference: int) -> tuple[Floats, Floats]:
    """(N, 2) shifts from the reference and (N,) the corners' median deviation; NaN = not known."""
    shifts, deviation = np.full((len(pictures), 2), np.nan), np.full(len(pictures), np.nan)
    first = pictures[reference]
    corners: Array | None = cv2.goodFeaturesToTrack(first, CORNERS, CORNER_QUALITY, APART_PX)
    if corners is None:
        return shifts, deviation

    def track(source: Array, target: Array, points: Array) -> tuple[Array, Array]:
        there, found, _ = cv2.calcOpticalFlowPyrLK(
            source, target, points, np.empty_like(points),
            winSize=(WINDOW_PX, WINDOW_PX), maxLevel=LEVELS,
        )  # fmt: skip
        return np.asarray(there), np.asarray(found).ravel() > 0

    for i, picture in enumerate(pictures):
        there, found = track(first, picture, corners)
        back, also = track(picture, first, there)
        consistent = found & also
        consistent &= np.abs(back - corners).max(axis=(1, 2)) < BACK_PX
        if consistent.sum() < FEWEST:
            continue
        flow = (there - corners)[consistent, 0]
        middle = np.median(flow, axis=0)
        off = np.abs(flow - middle)
        if (off.max(axis=1) < SAME_PX).mean() >= AGREEING:
            shifts[i], deviation[i] = middle, np.median(off, axis=0).max()
    return shifts, deviation
