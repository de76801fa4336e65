"""Depth values that say "too far" or "nothing" instead of a distance."""

from __future__ import annotations

import numpy as np

from rakelight.capture.validate import HOLES, PLAUSIBLE_M
from rakelight.model import Array, Floats

# Values that are exactly the largest one, from which on it is no distance but what a sensor or
# program writes for "too far": of noisy distances few are the same.
MANY = 10
# Times the median distance beyond which it may be one: a wall behind the object is nearer, and a
# plane without noise behind it loses nothing but itself.
FAR = 2.0
# Values that a median is taken of: it is right to a percent.
_SAMPLE = 100_000


def least_far_value(known_m: Floats) -> tuple[float, str] | None:
    """The least of the values that can be no distance, and their kind of hole; None without any.

    known_m : (V,) the measured values of a capture, metres

    Of the farthest alone: without them others may be too far.

    >>> known_m = np.full(64, 0.6)
    >>> least_far_value(known_m)
    >>> known_m[:8] = 65.535
    >>> least_far_value(known_m)
    (65.535, 'beyond 20 m')
    """
    largest = float(known_m.max(initial=0))
    others = known_m[known_m < largest]
    if not others.size:
        return None
    middle = float(np.median(others[:: 1 + others.size // _SAMPLE]))
    if middle > PLAUSIBLE_M[1]:
        return None
    if largest > PLAUSIBLE_M[1]:
        return float(known_m[known_m > PLAUSIBLE_M[1]].min()), f"beyond {PLAUSIBLE_M[1]:g} m"
    if largest > FAR * middle and known_m.size - others.size >= MANY:
        return largest, "at one far value"
    return None


def has_far(depth_m: Floats) -> bool:
    """Whether depth (K, h, w), metres, NaN = no measurement, has values that can be no distance."""
    return least_far_value(depth_m[np.isfinite(depth_m)]) is not None


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
    known_m = depth_m[np.isfinite(depth_m)]
    while (found := least_far_value(known_m)) is not None:
        least, why = found
        far = depth_m >= least
        depth_m[far], holes[far] = np.nan, HOLES.index(why)
        known_m = known_m[known_m < least]
