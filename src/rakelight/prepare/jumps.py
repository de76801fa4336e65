"""Jumps that the sensor's depth shows, though they are no steeper than a surface may be.

A step of four pixel sizes is a slope of 76 degrees to one difference.  Those beside it on the same
line tell the two apart: on a surface they go on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rakelight.geometry.fill import nearest_fill
from rakelight.geometry.grid import Links, pair_slices
from rakelight.geometry.masks import dilate
from rakelight.model import MAD_TO_SIGMA, Camera, Floats, Mask
from rakelight.prepare.average import nan_median
from rakelight.solve.robust import BY_CHANCE

# Least height of a jump, pixel sizes on the object; creases and curved sides are lower.  Over 50
# captures the angle is 0.96 times that without such cuts; with 2 it is 0.99, with 1 1.03
# (docs/results/changes.md, "Jumps that the sensor shows").
LEAST_PIXELS = 4.0
# The same along the edge of a higher jump, which ends in the surface or grows lower between; Canny
# takes a half or a third (docs/results/changes.md).
LOWEST_PIXELS = LEAST_PIXELS / 2
# Differences on each side of a link that say which one to expect there.
BESIDE = 2


def without_measured_jumps(links: Links, depth_m: Floats, camera: Camera) -> Links:
    """The links less those across which a measured depth jumps.

    depth_m : (h, w) measurements at the resolution of the links, metres, not smoothed; NaN = none

    A jump is higher than `LEAST_PIXELS`, and than the sensor's noise and rounding: of tens of
    thousands of links none is off by twice `BY_CHANCE` deviations by chance.  Along its edge it
    goes on down to `LOWEST_PIXELS`.  A blurred jump is several differences in a row; it is cut at
    the largest.

    >>> row, column = np.mgrid[:8, :12]
    >>> depth_m = 1 + 0.003 * column + 0.0001 * row + 0.05 * (column > 5)
    >>> camera = Camera(12, 8, fx=100.0, fy=100.0, cx=5.5, cy=3.5)
    >>> cut = without_measured_jumps(Links.of(np.ones((8, 12), bool)), depth_m, camera)
    >>> np.flatnonzero(~cut.right[0]).tolist(), bool(cut.down[:-1].all())  # the last has no link
    ([5, 11], True)
    """
    depth_m = without_narrow_gaps(depth_m)
    sides = ((1, camera.fx), (0, camera.fy))
    excess = [unexpected_differences(depth_m, axis) for axis, _ in sides]
    both = np.concatenate([each[each >= 0] for each in excess])
    deviation = MAD_TO_SIGMA * float(np.median(both)) if both.size else np.inf
    surely = BY_CHANCE * max(2 * deviation, rounding(depth_m))
    high, low = [], []
    for (axis, focal), step in zip(sides, excess, strict=True):
        here, there = pair_slices(axis)
        size = np.fmin(depth_m[here], depth_m[there]) / focal
        largest = is_largest(step, axis) & (step >= surely)
        high.append(largest & (step >= LEAST_PIXELS * size))
        low.append(largest & (step >= LOWEST_PIXELS * size))
    right, down = along_edges(low, high)
    kept = links.right.copy(), links.down.copy()
    kept[0][:, :-1] &= ~right
    kept[1][:-1] &= ~down
    return Links(links.mask, *kept)


def without_narrow_gaps(depth_m: Floats) -> Floats:
    """`depth_m` with gaps of up to two pixels filled, each pixel as the nearest measured one.

    A pixel that saw both sides of a jump has been left out (`flying`); the jump is still there.
    """
    measured = np.isfinite(depth_m)
    if not measured.any():
        return depth_m
    closed = ~dilate(~dilate(measured, 1), 1)
    return np.where(measured | closed, nearest_fill(depth_m, measured), np.nan)


def along_edges(low: Sequence[Mask], high: Sequence[Mask]) -> list[Mask]:
    """Of low cuts those that lead to a high one, from end to end (hysteresis; Canny 1986).

    low, high : cuts of links to the right (h, w - 1) and down (h - 1, w)

    A cut of a link lies between two corners of pixels; cuts that share one go on.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    height, width = low[1].shape[0] + 1, low[1].shape[1]
    corner = np.arange((height + 1) * (width + 1)).reshape(height + 1, width + 1)
    begins = corner[:-1, 1:-1], corner[1:-1, :-1]
    ends = corner[1:, 1:-1], corner[1:-1, 1:]
    begin, end = (
        np.concatenate([each[cut] for each, cut in zip(corners, low, strict=True)])
        for corners in (begins, ends)
    )
    joined = coo_array((np.ones(begin.size), (begin, end)), shape=(corner.size, corner.size))
    edge = connected_components(joined, directed=False)[1]
    wanted = np.zeros(corner.size, dtype=bool)
    for corners, cut in zip(begins, high, strict=True):
        wanted[edge[corners[cut]]] = True
    return [cut & wanted[edge[corners]] for corners, cut in zip(begins, low, strict=True)]


def unexpected_differences(depth_m: Floats, axis: int) -> Floats:
    """By how much each difference to the next pixel is off the median of those beside it, metres.

    One fewer along `axis`; -1 where one of both pixels, or all on one side, have no depth: the
    outline of a round surface, which grows steeper there, would look like a jump.
    """
    step = np.moveaxis(np.diff(depth_m, axis=axis), axis, -1)
    count = step.shape[-1]
    wide = np.pad(step, ((0, 0), (BESIDE, BESIDE)), constant_values=np.nan)
    others = [wide[:, k : k + count] for k in range(2 * BESIDE + 1) if k != BESIDE]
    off = np.abs(step - nan_median(np.stack(others)))
    before, after = (np.isfinite(each).any(axis=0) for each in (others[:BESIDE], others[BESIDE:]))
    off[~(before & after)] = np.nan
    return np.moveaxis(np.where(np.isfinite(off), off, -1.0), -1, axis)


def is_largest(step: Floats, axis: int) -> Mask:
    """Where a value is above the one before along `axis`, and not below the one after."""
    wide = np.pad(np.moveaxis(step, axis, -1), ((0, 0), (1, 1)), constant_values=-1.0)
    largest = (wide[:, 1:-1] > wide[:, :-2]) & (wide[:, 1:-1] >= wide[:, 2:])
    return np.asarray(np.moveaxis(largest, -1, axis))


def rounding(depth_m: Floats) -> float:
    """The step to which a sensor rounds its depth, metres; 0 where it does not.

    The median distance of the values that occur, where each occurs four times or more on average.
    """
    measured = depth_m[np.isfinite(depth_m)]
    values = np.unique(np.round(measured, 7))  # a tenth of a micrometre: sums are not exact
    few = 1 < values.size <= measured.size / 4
    return float(np.median(np.diff(values))) if few else 0.0
