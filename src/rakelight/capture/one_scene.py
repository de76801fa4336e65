"""Whether several depth maps repeat one view: else their average is depth of nothing."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rakelight.errors import CaptureError, listed
from rakelight.model import Array, Floats, Mask
from rakelight.prepare.average import nan_median

# Ratio of a map's depth to the others', at most.  Noise of stereo at its farthest and the drift of
# a sensor that warms up stay below 4 %; of the units in use the nearest two are 25 % apart.
ALIKE = 1.10
# A map that measures fewer pixels, or a smaller share, of what most maps do is not compared.  In
# 450 random draws noise looks turned on 8 pixels at most; on 40 and more it is never near `TURNED`.
LEAST_PX, LEAST_COMMON = 50, 0.01
# The relief of a turned map is so many times nearer to the others' when it is turned back; looked
# for where it is off by this share of the depth.  From noise turning takes nothing away.
TURNED, LEAST_OFF = 3.0, 0.005
# Values that are compared, of all maps: medians of 100 pixels' would do.
_SAMPLE = 1_000_000

# How a map of the same size may lie: pixels (row, column), the last row, the last column.
_TURNS: dict[str, Callable[[Array, Array, int, int], tuple[Array, Array]]] = {
    "turned by 180 degrees": lambda row, column, last, end: (last - row, end - column),
    "mirrored left to right": lambda row, column, last, end: (row, end - column),
    "mirrored top to bottom": lambda row, column, last, end: (last - row, column),
}


def check_one_scene(
    depth_m: Floats, looked_at: Mask, source: str, names: Sequence[str] = ()
) -> None:
    """Raise CaptureError where depth maps are not repeats of one view.

    depth_m : (K, h, w) metres, NaN = no measurement; looked_at : (h, w) True where they count
    names : of the maps, for messages; numbers from 0 when empty

    The logarithm of each map is compared with the maps' median where most of them measure; the
    median deviation tells whether it is of their scene.

    >>> maps = np.stack([np.full((8, 8), 0.6), np.full((8, 8), 1.2), np.full((8, 8), 0.6)])
    >>> check_one_scene(maps, np.ones((8, 8), bool), "depth", ["0.png", "raw.png", "1.png"])
    Traceback (most recent call last):
    rakelight.errors.CaptureError: depth: depth maps that contradict each other (seen median 1.2 m
    in raw.png, 0.6 m in the others, needed repeats of one view, ...). Fix: remove raw.png: ...
    """
    count = len(depth_m)
    if count < 2:
        return
    names = names or [f"map {k}" for k in range(count)]
    pixels = np.flatnonzero(looked_at)
    pixels = pixels[:: 1 + count * pixels.size // _SAMPLE]
    row, column = np.unravel_index(pixels, looked_at.shape)
    logs = np.log(depth_m[:, row, column].astype(np.float64))
    # Two are half as far from their median as from each other.
    middle = nan_median(logs) if count > 2 else logs[0]
    middle = np.where(2 * np.isfinite(logs).sum(axis=0) > count, middle, np.nan)
    last, end = (side - 1 for side in depth_m.shape[1:])
    for name, one, each in zip(names, depth_m, logs, strict=True):
        off = _spread(each - middle)
        if not off > LEAST_OFF:
            continue
        for turn, place in _TURNS.items():
            back = np.log(one[place(row, column, last, end)].astype(np.float64))
            if TURNED * _spread(back - middle) < off:
                raise CaptureError(
                    "depth maps that lie differently",
                    source=source,
                    seen=f"{name} {turn} against {names[0] if count == 2 else 'the others'}",
                    needed="repeats of one view",
                    remedy="turn it back, or remove it",
                )
    odd = [_middle(np.abs(each - middle)) > np.log(ALIKE) for each in logs]
    if any(odd):
        raise _contradict(logs, odd, source, names)


def _middle(values: Floats) -> float:
    """The median of the values that are not NaN; NaN where they are too few."""
    known = values[np.isfinite(values)]
    enough = known.size >= max(LEAST_PX, LEAST_COMMON * values.size)
    return float(np.median(known)) if enough else np.nan


def _spread(values: Floats) -> float:
    """The median deviation from the median; NaN where there are too few values."""
    return _middle(np.abs(values - _middle(values)))


def _contradict(
    logs: Floats, odd: Sequence[bool], source: str, names: Sequence[str]
) -> CaptureError:
    """The error for maps of which some are `odd`; where half are, none is blamed."""
    medians_m = np.exp([_middle(each) for each in logs])
    shown = [f"{m:.3g} m in {name}" for m, name in zip(medians_m, names, strict=True)]
    if 2 * sum(odd) < len(logs):
        rest_m = np.nanmedian(medians_m[~np.array(odd)])
        seen = f"{listed(shown, odd)}, {rest_m:.3g} m in the others"
        remedy = f"remove {listed(names, odd)}: in another unit, of another view, or no depth"
    else:
        seen = listed(shown, np.isfinite(medians_m))
        remedy = "remove what is in another unit, of another view, or no depth"
    return CaptureError(
        "depth maps that contradict each other",
        source=source,
        seen=f"median {seen}",
        needed=f"repeats of one view, alike to {ALIKE - 1:.0%} at half of the pixels",
        remedy=remedy,
    )
