"""Depth that was smoothed, or interpolated, across the object's outline.

Phones and programs that fill holes blur depth maps, and bilinear resampling makes ramps of their
jumps.  Beside the outline such depth is a mean of the object's and of what lies behind it, over
several pixels: too wide for flying pixels, and without a jump.
"""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.geometry.fill import nearest_fill
from rakelight.geometry.grid import bounding_window
from rakelight.geometry.masks import dilate
from rakelight.model import Floats, Mask

# Share of a pixel above which it counts as the object's.
HALF = 0.5
# Least distance from the object to what lies behind, over the object's depth, that shows how wide
# the ramp between them is.
CLEAR = 0.02
# The part of the ramp whose pixels are counted is from its middle to here: it lies beyond the
# outline, where the object's own shape does not reach.  And its width, deviations of a Gaussian.
MOST, WIDTH = 0.9, 1.2816
# Deviations within which a ramp ends; and distances from the outline, depth pixels, beyond which
# object and background are looked for: the first one by which the ramp has ended is taken.
RAMP, REACHES_PX = 3.0, (3, 6, 12, 24, 48)
# Where it has ended, the object reaches no farther than this share of the way to the background,
# but for so many of its pixels: else its own relief looks like a ramp.  Of a narrow object those
# pixels are looked at that are farther from the outline than this share of the largest distance.
RELIEF, MOSTLY, DEEP = 0.25, 0.2, 0.7
# Pixels on either side of the outline that are counted for its length: fewer would count slanted
# parts as shorter.
RIM_PX = 3
# Least deviation, pixels, that is none of a sharp map: a ring of mixed pixels, each of which sees
# the mean of an area, counts as 0.31, two rings of flying ones mostly as 0.5 to 0.7.  With 1.0 it
# is one of 220 random captures that is called blurred, not 7, but what is blurred by less is lost
# (depth-sensor.md).
LEAST_PX = 0.75
# Noise widths that are allowed for, as for flying pixels.
SIGMAS = 3.0
# Least share of the object's measurements that is left.
LEAST_KEPT = 0.2


def edge_blur(depth_m: Floats, inside: Mask) -> float:
    """Deviation of the Gaussian, pixels, by which a depth map is blurred across the outline.

    depth_m : (h, w) metres, NaN = no measurement, that of what lies behind the object too
    inside : (h, w) the pixels that see the object for the most part

    0 where it is less than `LEAST_PX`, or nothing behind the object shows it.  The pixels of the
    ramp are counted wherever it lies: a map that is shifted is not taken for blurred.

    >>> rows, columns = np.mgrid[:90, :90]
    >>> inside = np.hypot(rows - 45, columns - 45) < 20
    >>> depth = np.where(inside, 0.5, 0.8)
    >>> edge_blur(depth, inside), round(edge_blur(cv2.GaussianBlur(depth, (0, 0), 1.5), inside), 1)
    (0.0, 1.7)
    """
    for reach in REACHES_PX if inside.any() else ():
        part = bounding_window(inside, margin=2 * reach)
        front, behind = both_sides(depth_m[part], inside[part], reach)
        away = distance_from_outline(inside[part])
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            clear = behind > (1 + CLEAR) * front
            share = (depth_m[part] - front) / (behind - front)
            ramp = clear & (away <= reach) & (share > HALF) & (share < MOST)
        length = np.count_nonzero(clear & (away <= RIM_PX)) / (2 * RIM_PX)
        found = np.count_nonzero(ramp) / max(length, 1) / WIDTH
        if length and RAMP * found < reach:
            deep = min(reach / 2, DEEP * float(away[inside[part]].max()))
            own = share[clear & inside[part] & (away >= deep)]
            flat = own.size > 0 and np.mean(own > RELIEF) < MOSTLY
            return float(found) if flat and found >= LEAST_PX else 0.0
    return 0.0


def mixed_with_background(depth_m: Floats, sigma_m: Floats, share: Floats) -> Mask:
    """Which measurements (h, w) of the object are too far by more than their noise, since blurred.

    depth_m : (h, w) metres, NaN = no measurement, that of what lies behind the object too
    sigma_m : (h, w) its noise, metres
    share : (h, w) how much of each pixel the object covers, 0 to 1

    A measurement that is blurred as the ramps at the outline are (`edge_blur`) is too far by the
    background's share in it times how far that lies behind.  Where nearly all of the object is, the
    `LEAST_KEPT` of it that are too far by the least stay.

    >>> rows, columns = np.mgrid[:90, :90]
    >>> inside = np.hypot(rows - 45, columns - 45) < 20
    >>> depth = cv2.GaussianBlur(np.where(inside, 0.5, 0.8), (0, 0), 1.5)
    >>> mixed = mixed_with_background(depth, np.full(depth.shape, 0.001), inside.astype(float))
    >>> off = depth - 0.5
    >>> bool(off[inside].max() > 0.1), bool(off[inside & ~mixed].max() < 0.003)
    (True, True)
    """
    found, inside = np.zeros(share.shape, dtype=bool), share >= HALF
    blur = edge_blur(depth_m, inside)
    if not blur:
        return found
    reach = int(np.ceil(RAMP * blur))
    part = bounding_window(share > 0, margin=2 * reach)
    _, behind = both_sides(depth_m[part], inside[part], reach)
    behind = nearest_fill(behind, np.isfinite(behind))  # in narrow gaps too
    background = 1 - cv2.GaussianBlur(share[part].astype(np.float64), (0, 0), blur)
    with np.errstate(invalid="ignore", divide="ignore"):
        off = background / (1 - background) * (behind - depth_m[part]) / sigma_m[part]
    measured = (share[part] > 0) & np.isfinite(off)
    if measured.any():
        most = max(SIGMAS, float(np.quantile(off[measured], LEAST_KEPT)))
        found[part] = measured & (off > most)
    return found


def both_sides(depth_m: Floats, inside: Mask, reach: int) -> tuple[Floats, Floats]:
    """The depth (h, w) of the object and of what lies behind it, metres, around each pixel.

    The object's nearest within `reach` pixels, infinite where there is none; the mean of what is
    measured within twice that, `reach` or more beyond the outline, NaN where nothing is.
    """
    measured = np.isfinite(depth_m)
    own = np.where(inside & measured, depth_m, np.inf).astype(np.float32)
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    front = np.asarray(cv2.erode(own, square), dtype=np.float32)
    beyond = measured & ~dilate(inside, reach)
    total, count = (
        cv2.boxFilter(image.astype(np.float32), -1, (4 * reach + 1,) * 2, normalize=False)
        for image in (np.where(beyond, depth_m, 0.0), beyond)
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        return front, np.where(count > HALF, total / count, np.nan)


def distance_from_outline(inside: Mask) -> Floats:
    """(h, w) how far each pixel is from the nearest one on the other side of a mask's outline."""
    both = (cv2.distanceTransform(s.astype(np.uint8), cv2.DIST_L2, 5) for s in (inside, ~inside))
    return np.asarray(sum(both))
