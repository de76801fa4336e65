"""A quantile of more values than memory holds, exact to the last digit."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from rakelight.model import Array, Floats


def count_values(light: Floats, mask: Array, upper: int) -> Array:
    """(65536,) how many values of an image (h, W, 3) have each upper half, within a mask (h, W).

    light : float32, not negative: its bits rise with its values
    upper : -1, or an upper half: how many of its values have each lower half

    >>> ones = np.ones((1, 1, 3), np.float32)
    >>> np.flatnonzero(count_values(ones, np.ones((1, 1), bool), -1)).tolist(), hex(16256)
    ([16256], '0x3f80')
    """
    from rakelight.synthetic import _kernels

    counts = np.zeros(1 << 16, np.int64)
    _kernels.count_bits(np.abs(light).view(np.uint32), mask, upper, counts)
    return counts


def quantile(counts: Callable[[int], Array], share: float) -> float:
    """What np.quantile says of the float32 values whose `count_values` are handed over.

    counts : of `upper`, the sum over all values; called two or three times

    >>> values = np.random.default_rng(0).random((5, 7, 3), np.float32)
    >>> found = quantile(lambda upper: count_values(values, np.ones((5, 7), bool), upper), 0.9)
    >>> found == float(np.quantile(values, 0.9))
    True
    """
    high = np.cumsum(counts(-1))
    lower = cache(counts)

    def at(rank: int) -> np.float32:
        """The value of that rank, from 0."""
        upper = int(np.searchsorted(high, rank, side="right"))
        before = high[upper - 1] if upper else 0
        low = int(np.searchsorted(np.cumsum(lower(upper)), rank - before, side="right"))
        return np.uint32(upper << 16 | low).view(np.float32)

    last = int(high[-1]) - 1
    place = last * share
    rank = min(int(place), last)
    pair = np.array([at(rank), at(min(rank + 1, last))])
    return float(np.quantile(pair, place - rank))  # interpolates as it does between neighbours
