"""Flying pixels, between two surfaces that one depth pixel saw, and stray ones."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import STEEPEST
from rakelight.model import Camera, Floats, Mask

# Largest step to a neighbour, pixel widths, that may be a crease.
CREASE = 3.0
# Steps in a row that make a slope: a jump that the optics blur has fewer.
SLOPE_STEPS = 3
# The same where the first is steeper than a visible surface: the middle of a blurred jump.
STEEP_STEPS = 4
# Largest ratio of a step to the slope before it on a round surface.
STEEPENING = 3.0
# Noise widths that are allowed for.
SIGMAS = 3.0
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))
# Largest step to a neighbour, over the depth, that may belong to a limb or to something narrow.
ASTRAY = 0.05
# Least number of measured neighbours, of eight: with fewer a pixel may be the end of a wire.
NEIGHBOURS = 4


def stray(depth_m: Floats, sigma_m: Floats, camera: Camera) -> Mask:
    """Which measurements (h, w) none of the eight pixels around them shares.

    Arguments as of `flying`.  What is a pixel wide, such as a wire, has neighbours of its own depth
    along it; shared is what a surface that is just not too steep to be seen, and noise, can do, and
    what differs by less than a twentieth.

    >>> camera = Camera(3, 3, fx=500.0, fy=500.0, cx=1.0, cy=1.0)
    >>> depth = np.array([[1.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 1.0]])
    >>> stray(depth, 0.001 * depth, camera).sum(), stray(depth, 0.001 * depth, camera)[1, 1]
    (np.int64(1), np.True_)
    """
    height, width = depth_m.shape
    padded = np.pad(depth_m, 1, constant_values=np.nan)
    shared, measured = np.zeros(depth_m.shape, dtype=bool), np.zeros(depth_m.shape, dtype=int)
    for dy, dx in (*DIRECTIONS, *((-dy, -dx) for dy, dx in DIRECTIONS)):
        there = padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        nearer = np.fmin(depth_m, there)
        allowed = np.maximum(STEEPEST * np.hypot(dx / camera.fx, dy / camera.fy), ASTRAY) * nearer
        shared |= np.abs(there - depth_m) <= allowed + SIGMAS * np.sqrt(2) * sigma_m
        measured += np.isfinite(there)
    return np.isfinite(depth_m) & ~shared & (measured >= NEIGHBOURS)


def flying(depth_m: Floats, sigma_m: Floats, camera: Camera) -> Mask:
    """Which measurements (h, w) lie between a near and a far surface and belong to neither.

    depth_m : (h, w) metres along the optical axis, NaN = no measurement
    sigma_m : (h, w) its noise, metres
    camera : of the depth map

    Along one of the four directions a flying pixel is much deeper than its one neighbour and much
    less deep than the other, and neither side's surface goes on to it.  A step belongs to a
    surface when it is no larger than a crease, or than thrice the slope that the surface has had
    over three pixels, four where it is steeper than `STEEPEST`: slopes that are seven pixels
    wide stay, nine where they are as steep as that, and so does what is nearer, or farther, than
    both its neighbours, however thin it is.

    >>> camera = Camera(6, 1, fx=500.0, fy=500.0, cx=2.5, cy=0.0)
    >>> depth = np.array([[1.0, 1.0, 1.0, 1.2, 1.3, 1.3]])
    >>> flying(depth, 0.001 * depth, camera).tolist()
    [[False, False, False, True, False, False]]
    """
    margin = STEEP_STEPS + 1
    height, width = depth_m.shape
    padded = np.pad(depth_m, margin, constant_values=np.nan)
    sigma = np.pad(sigma_m, margin, constant_values=np.nan)
    found = np.zeros(padded.shape, dtype=bool)
    here = tuple(slice(margin, margin + side) for side in (height, width))
    for dy, dx in DIRECTIONS:
        ahead, behind = (
            tuple(
                slice(margin + sign * step, margin + sign * step + side)
                for step, side in ((dy, height), (dx, width))
            )
            for sign in (1, -1)
        )
        step = padded[ahead] - padded[here], padded[here] - padded[behind]
        pixel_m = padded[here] * np.hypot(dx / camera.fx, dy / camera.fy)
        noise = SIGMAS * np.sqrt(2) * sigma[here]
        allowed, steepest = CREASE * pixel_m + noise, STEEPEST * pixel_m + noise
        between = (np.abs(step[0]) > allowed) & (np.abs(step[1]) > allowed)
        between &= np.sign(step[0]) == np.sign(step[1])
        rows, columns = np.nonzero(between)
        at = rows + margin, columns + margin
        for side in (1, -1):
            # Steps away from the pixel: the one to it, then those of the surface that leads there.
            line = [padded[at[0] + side * k * dy, at[1] + side * k * dx] for k in range(margin + 1)]
            rise = np.diff(line, axis=0) * np.sign(line[1] - line[0])
            # Where the map ends sooner fewer steps have to do; what ends at once may be anything.
            steep = rise[1] > steepest[rows, columns]
            slope, long_slope = (
                np.fmin.reduce(rise[1 : 1 + steps], axis=0) for steps in (SLOPE_STEPS, STEEP_STEPS)
            )
            slope = np.maximum(np.where(steep, long_slope, slope), 0)
            apart = rise[0] > allowed[rows, columns] + STEEPENING * slope
            at = at[0][apart], at[1][apart]
            rows, columns = rows[apart], columns[apart]
        found[at] = True
    return found[here]
