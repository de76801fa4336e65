"""What light changes least in a photograph, and how far such pictures are shifted.

Lights change what a surface looks like, so photographs are compared by the detail that light hardly
changes: logarithms without their low frequencies, of equal contrast everywhere.  Corners of one
photograph are tracked into another and back (Shi & Tomasi 1994, Lucas & Kanade 1981).  Those of
paint, seams and background agree about a motion; those of shading and shadows do not.
"""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.model import Array, Floats, Mask

# Side, pixels, of the box blur whose result is subtracted; noise floor, over the bright parts'
# value; least contrast of the logarithms.
BLUR_PX, FLOOR, FLAT = 25, 0.05, 0.02
# Corners: most, least quality over the best one's, least distance in pixels.
CORNERS, CORNER_QUALITY, APART_PX = 200, 0.02, 5
# Window, pixels, and pyramid levels of Lucas-Kanade above the first: pixels of another one, as wide
# as 8, would see no detail of less than `BLUR_PX` but its aliases, and tiles would be taken for
# their neighbours.
WINDOW_PX, LEVELS = 15, 2
# Steps after which a corner's search ends, and the step, pixels, that is too small to go on: where
# the light differs most corners are not there, and OpenCV's 30 and 0.01 take half as long again.
STEPS, LEAST_STEP_PX = 15, 0.02
# Largest error, pixels, of a corner tracked there and back; largest distance from the median shift.
BACK_PX, SAME_PX = 0.2, 0.5
# Least number of corners for a shift, and least fraction of them that agree with the median.
FEWEST, AGREEING = 30, 0.6


def grey(image: Array) -> Floats:
    """(h, w) float32 grey of an image (h, w, 3)."""
    return np.asarray(cv2.cvtColor(image.astype(np.float32), cv2.COLOR_RGB2GRAY))


def detail(image: Array) -> Array:
    """(h, w) uint8 the detail of an image (h, w, 3)."""
    values = grey(image)
    floor = max(FLOOR * float(np.quantile(values[::4, ::4], 0.95)), 1.0)
    log = np.log(values + floor)
    fine = log - cv2.blur(log, (BLUR_PX, BLUR_PX))
    power = cv2.blur(fine**2, (2 * BLUR_PX, 2 * BLUR_PX))
    contrast = np.sqrt(np.maximum(power, FLAT**2))  # running sums may end below zero
    return np.asarray(np.clip(128 + 50 * fine / contrast, 0, 255), np.uint8)


def corners_of(picture: Array, mask: Mask | None = None) -> Array | None:
    """(M, 1, 2) float32 pixels that can be told from their surroundings, None without any.

    mask : (h, w) where to look
    """
    where = None if mask is None else mask.astype(np.uint8)
    found: Array | None = cv2.goodFeaturesToTrack(
        picture, CORNERS, CORNER_QUALITY, APART_PX, mask=where
    )
    return found


def shift_between(first: Array, second: Array, corners: Array) -> tuple[Floats, float] | None:
    """How far `second` is shifted against `first`, pixels right and down; None = not known.

    first, second : (h, w) uint8 from `detail`; corners : of the first

    Returns the median shift (2,) of the corners and the median of their deviations from it.
    """
    there, found = _track(first, second, corners)
    back, also = _track(second, first, there)
    consistent = found & also
    consistent &= np.abs(back - corners).max(axis=(1, 2)) < BACK_PX
    if consistent.sum() < FEWEST:
        return None
    flow = (there - corners)[consistent, 0]
    middle = np.median(flow, axis=0)
    off = np.abs(flow - middle)
    if (off.max(axis=1) < SAME_PX).mean() < AGREEING:
        return None
    return middle, float(np.median(off, axis=0).max())


def _track(source: Array, target: Array, points: Array) -> tuple[Array, Array]:
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        source, target, points, np.empty_like(points),
        winSize=(WINDOW_PX, WINDOW_PX), maxLevel=LEVELS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, STEPS, LEAST_STEP_PX),
    )  # fmt: skip
    return np.asarray(there), np.asarray(found).ravel() > 0
