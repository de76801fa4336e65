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
# Distance from a pixel up to which planes are fitted, over that reach.  2 to 4 do alike
# (depth-sensor.md).
AROUND = 2
# Of a narrow object those pixels are looked at that are farther from the outline than this share
# of the largest distance.
DEEP = 0.7
# Least share of the outline that shows a ramp's width: an object on a table shows none where it
# touches it.  0.2 to 0.4 do alike (depth-sensor.md).
SHOWN = 0.25
# Pixels on either side of the outline that are counted for its length: fewer would count slanted
# parts as shorter.
RIM_PX = 3
# Least deviation, pixels, that is none of a sharp map: a ring of mixed pixels, each of which sees
# the mean of an area, counts as 0.31, two rings of flying ones mostly as 0.5 to 0.7.  With 1.0
# two of 220 random captures are called blurred, not 5, but what is blurred by less is lost
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

    0 where it is less than `LEAST_PX`, or less than `SHOWN` of the outline shows it: where object
    and background, each a plane beyond the ramp, lie a jump apart, and these planes are right up
    to the ramp.  Where an object touches its table none is.  The pixels of the ramp are counted
    wherever it lies: a map that is shifted is not taken for blurred.

    >>> rows, columns = np.mgrid[:90, :90]
    >>> inside = np.hypot(rows - 45, columns - 45) < 20
    >>> depth = np.where(inside, 0.5, 0.8)
    >>> edge_blur(depth, inside), round(edge_blur(cv2.GaussianBlur(depth, (0, 0), 1.5), inside), 1)
    (0.0, 1.7)
    """
    for reach in REACHES_PX if inside.any() else ():
        part = bounding_window(inside, margin=AROUND * reach)
        depth, on = depth_m[part], inside[part]
        away = distance_from_outline(on)
        front, behind = both_sides(depth, on, away, reach)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            gap = behind - front
            # What is off: beside the ramp, from the planes; in it, what does not lie between them.
            ended = away >= reach / 2
            plane = np.where(on, front, behind)
            off = depth - np.where(ended, plane, np.clip(depth, front, behind))
            near = (away <= reach) & np.isfinite(off)
            squares = local_sum(np.where(near, off, 0) ** 2, reach)
            misfit = np.sqrt(squares / local_sum(near & ended, reach))
            clear = (gap > CLEAR * front) & ((1 - MOST) * gap > misfit)
            share = (depth - front) / gap
            ramp = clear & (away <= reach) & (share > HALF) & (share < MOST)
        rim = away <= RIM_PX
        shown = np.count_nonzero(clear & rim)
        if shown > SHOWN * np.count_nonzero(rim):
            found = np.count_nonzero(ramp) / shown * 2 * RIM_PX / WIDTH
            if RAMP * found < reach:
                return float(found) if found >= LEAST_PX else 0.0
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
    part = bounding_window(share > 0, margin=AROUND * reach)
    away = distance_from_outline(inside[part])
    _, behind = both_sides(depth_m[part], inside[part], away, reach)
    behind = nearest_fill(behind, np.isfinite(behind))  # in narrow gaps too
    background = 1 - cv2.GaussianBlur(share[part].astype(np.float64), (0, 0), blur)
    with np.errstate(invalid="ignore", divide="ignore"):
        off = background / (1 - background) * (behind - depth_m[part]) / sigma_m[part]
    measured = (share[part] > 0) & np.isfinite(off)
    if measured.any():
        most = max(SIGMAS, float(np.quantile(off[measured], LEAST_KEPT)))
        found[part] = measured & (off > most)
    return found


def both_sides(depth_m: Floats, inside: Mask, away: Floats, reach: int) -> tuple[Floats, Floats]:
    """The depth (h, w) of the object and of what lies behind it, metres, around each pixel.

    Each is a plane through what is measured `reach` pixels or more from the outline, of a narrow
    object less.  `away` is `distance_from_outline`.  NaN where nothing is.
    """
    measured = np.isfinite(depth_m) & (depth_m > 0)
    core = inside & (away >= min(reach, DEEP * float(away[inside].max())))
    front, behind = (
        local_plane(depth_m, measured & there, AROUND * reach)
        for there in (core, ~inside & (away >= reach))
    )
    return front, behind


def local_plane(depth_m: Floats, there: Mask, half: int) -> Floats:
    """The depth (h, w) of the plane of least squares within `half` pixels of each, metres.

    Of a plane the inverse depth is linear in the image.  `there` marks the pixels that count; NaN
    where there is none, or the plane is not before the camera.

    >>> rows, columns = np.mgrid[:9, :9]
    >>> slanted = 1 / (1 + 0.03 * rows + 0.06 * columns)
    >>> plane = local_plane(slanted, columns < 5, 6)
    >>> bool(abs(plane - slanted).max() < 0.02)
    True
    """
    y, x = np.mgrid[tuple(slice(-side / 2, side / 2) for side in depth_m.shape)]
    with np.errstate(invalid="ignore", divide="ignore"):
        z = np.where(there, 1 / depth_m, 0.0)
        count = local_sum(there, half)

        def mean(image: Floats) -> Floats:
            return local_sum(np.where(there, image, 0.0), half) / count

        mx, my, mz = mean(x), mean(y), mean(z)
        # The twelfth is what a pixel extends by itself: one row of them has no slope across.
        xx, yy = mean(x * x) - mx * mx + 1 / 12, mean(y * y) - my * my + 1 / 12
        xy, xz, yz = mean(x * y) - mx * my, mean(x * z) - mx * mz, mean(y * z) - my * mz
        slope_x, slope_y = yy * xz - xy * yz, xx * yz - xy * xz
        inverse = mz + (slope_x * (x - mx) + slope_y * (y - my)) / (xx * yy - xy * xy)
        return np.where((count > HALF) & (inverse > 0), 1 / inverse, np.nan)


def local_sum(image: Floats | Mask, half: int) -> Floats:
    """(h, w) the sum of an image within `half` pixels of each, in a square."""
    square = (2 * half + 1,) * 2
    image = image.astype(np.float64)
    return np.asarray(
        cv2.boxFilter(image, -1, square, normalize=False, borderType=cv2.BORDER_CONSTANT)
    )


def distance_from_outline(inside: Mask) -> Floats:
    """(h, w) how far each pixel is from the nearest one on the other side of a mask's outline."""
    both = (cv2.distanceTransform(s.astype(np.uint8), cv2.DIST_L2, 5) for s in (inside, ~inside))
    return np.asarray(sum(both))
