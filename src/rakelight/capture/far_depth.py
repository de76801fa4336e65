"""Depth values that say "too far" or "nothing" instead of a distance."""

from __future__ import annotations

import numpy as np

from rakelight.capture.validate import HOLES, PLAUSIBLE_M
from rakelight.model import Array, Floats, Mask

# Values that are exactly the largest one, from which on it is no distance but what a sensor or
# program writes for "too far": of noisy distances few are the same.
MANY = 10
# Times the median distance beyond which it may be one: a wall behind the object is nearer, and a
# plane without noise behind it loses nothing but itself.
FAR = 2.0
# Values that a median is taken of: it is right to a percent.
_SAMPLE = 100_000


def far_values(depth_m: Floats) -> tuple[Mask, str] | None:
    """(K, h, w) values that can be no distance, and the kind of hole that they are; None without.

    depth_m : (K, h, w) metres, NaN = no measurement

    The farthest alone: without them others may be too far.

    >>> depth_m = np.full((1, 8, 8), 0.6)
    >>> far_values(depth_m)
    >>> depth_m[0, 0] = 65.535
    >>> far, why = far_values(depth_m)
    >>> far.sum(), why
    (np.int64(8), 'beyond 20 m')
    """
    known = depth_m[np.isfinite(depth_m)]
    largest = known.max(initial=0)
    others = known[known < largest]
    if not others.size:
        return None
    middle = float(np.median(others[:: 1 + others.size // _SAMPLE]))
    if middle > PLAUSIBLE_M[1]:
        return None
    if largest > PLAUSIBLE_M[1]:
        return depth_m > PLAUSIBLE_M[1], f"beyond {PLAUSIBLE_M[1]:g} m"
    if largest > FAR * middle and known.size - others.size >= MANY:
        return depth_m == largest, "at one far value"
    return None


def mark_far(depth_m: Floats, holes: Array) -> None:
    """Make holes, in place, of values that can be no distance.

    depth_m : (K, h, w) metres, NaN = no measurement; holes : (K, h, w) indices into
    rakelight.capture.validate.HOLES

    Values beyond 20 m, and those that many pixels share where they are the largest and more than
    twice the median: 16-bit "too far" divided by 1000 is 65.535 m.  Where the median of the others
    is beyond 20 m the values are not metres, and all stay.

    >>> depth_m = np.full((1, 8, 8), 0.6, np.float32)
    >>> depth_m[0, 0], depth_m[0, 1, :4] = 65.535, 10.0
    >>> holes = np.zeros(depth_m.shape, np.uint8)
    >>> mark_far(depth_m, holes)
    >>> [int((holes == HOLES.index(f"beyond {PLAUSIBLE_M[1]:g} m")).sum()), np.nanmax(depth_m)]
    [8, np.float32(10.0)]
    """
    while (found := far_values(depth_m)) is not None:
        far, why = found
        depth_m[far], holes[far] = np.nan, HOLES.index(why)
