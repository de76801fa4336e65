"""Depth values that say "too far", "too near" or "nothing" instead of a distance."""

from __future__ import annotations

import numpy as np

from rakelight.capture.validate import HOLES, PLAUSIBLE_M, POSSIBLE_M
from rakelight.model import Array, Floats

# Values that are exactly the largest one, from which on it is no distance but what a sensor or
# program writes for "too far": of noisy distances few are the same.
MANY = 10
# Times the median distance beyond which it may be one: a wall behind the object is nearer, and a
# plane without noise behind it loses nothing but itself.
FAR = 2.0
# Values that a median is taken of: it is right to a percent.
_SAMPLE = 100_000


def no_distances(known_m: Floats) -> tuple[float, float, str] | None:
    """The least and the largest of the values that can be no distance, and the kind of hole.

    known_m : (V,) the measured values of a capture, metres

    Those of one kind, and of far values that many pixels share those that are twice as far as the
    median with all others: without them more may be too far.  None without any.

    >>> known_m = np.full(64, 0.6)
    >>> no_distances(known_m)
    >>> known_m[:8] = 65.535
    >>> no_distances(known_m)
    (65.535, 65.535, 'beyond 20 m')
    >>> known_m[:8] = 19.0
    >>> known_m[8:20], known_m[20:30] = 8.0, 5.0
    >>> no_distances(np.append(known_m, [7.0, 19.0, 19.0]))
    (8.0, 19.0, 'at one far value')
    """
    least = float(known_m.min(initial=np.inf, where=known_m > 0))
    largest = float(known_m.max(initial=0))
    if least < POSSIBLE_M[0] <= largest:
        return least, float(np.nextafter(POSSIBLE_M[0], 0)), f"nearer than {POSSIBLE_M[0]:g} m"
    others = known_m[known_m < largest]
    if not others.size:
        return None
    middle = float(np.median(others[:: 1 + others.size // _SAMPLE]))
    if middle > PLAUSIBLE_M[1]:
        return None
    if largest > PLAUSIBLE_M[1]:
        beyond = known_m[known_m > PLAUSIBLE_M[1]]
        return float(beyond.min()), largest, f"beyond {PLAUSIBLE_M[1]:g} m"
    if largest > FAR * middle and known_m.size - others.size >= MANY:
        far, pixels = np.unique(known_m[known_m > FAR * middle], return_counts=True)
        shared = far[np.append(0, np.flatnonzero(pixels < MANY) + 1)[-1] :]
        return float(shared[0]), largest, "at one far value"
    return None


def has_no_distances(depth_m: Floats) -> bool:
    """Whether depth (K, h, w), metres, NaN = no measurement, has values that can be no distance."""
    return no_distances(depth_m[np.isfinite(depth_m)]) is not None


def mark_no_distances(depth_m: Floats, holes: Array) -> None:
    """Make holes, in place, of values that can be no distance.

    depth_m : (K, h, w) metres, NaN = no measurement; holes : (K, h, w) indices into
    rakelight.capture.validate.HOLES

    Values nearer than 0.1 mm, which programs write for nothing: 1e-6, the smallest step of floats.
    Where all are they are not metres, and stay.
    Values beyond 20 m, and those that many pixels share where they are the largest and more than
    twice the median: 16-bit "too far" divided by 1000 is 65.535 m.  Where the median of the others
    is beyond 20 m the values are not metres, and all stay.

    >>> depth_m = np.full((1, 8, 8), 0.6, np.float32)
    >>> depth_m[0, 0], depth_m[0, 1, :4] = 65.535, 10.0
    >>> holes = np.zeros(depth_m.shape, np.uint8)
    >>> mark_no_distances(depth_m, holes)
    >>> [int((holes == HOLES.index(f"beyond {PLAUSIBLE_M[1]:g} m")).sum()), np.nanmax(depth_m)]
    [8, np.float32(10.0)]
    """
    known_m = depth_m[np.isfinite(depth_m)]
    while (found := no_distances(known_m)) is not None:
        least, largest, why = found
        these = (depth_m >= least) & (depth_m <= largest)
        depth_m[these], holes[these] = np.nan, HOLES.index(why)
        known_m = known_m[(known_m < least) | (known_m > largest)]
