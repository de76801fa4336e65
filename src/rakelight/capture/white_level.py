"""Values of 9 to 15 bits that were stored in 16 as they are: their white becomes that of 16 bits.

A camera of 10 bits ends at 1023.  Where that stays as it is in a file of 16 bits, saturation is not
seen, and all that is darker than a quarter of its white counts as black.
"""

from __future__ import annotations

import numpy as np

from rakelight.model import Array, Finding

WHITE_16_BIT = 65535
# Largest values of 9 to 15 bits; how many values are white at the least.
_WHITE_LEVELS = {2**bits - 1: bits for bits in range(9, 16)}
_LEAST_WHITE = 3
# Of every so many pixels along each side one is looked at first.
_STRIDE = 8


def stretched(photographs: Array, *pictures: Array | None) -> tuple[Finding, ...]:
    """Multiply values of fewer bits so that white is 65535, in place; the note that says so.

    photographs : (N, H, W, 3); nothing is done to other than uint16, nor where their largest value
        is no white, or may be none
    pictures : (H, W, 3) of the same camera, changed alike; where one is brighter, nothing is done

    >>> ten_bits = np.array([[[[1023, 1023, 1023], [0, 1, 512]]]], np.uint16)
    >>> stretched(ten_bits)[0].message
    'the largest value is 1023, white of 10 bit: the values were multiplied by 64.1'
    >>> ten_bits[0, 0].tolist()
    [[65535, 65535, 65535], [0, 64, 32800]]
    """
    top = white_of(photographs)
    if top is None or not is_saturated(photographs, top):
        return ()
    beside = [p for p in pictures if p is not None and p.dtype == np.uint16]
    if any(int(picture.max(initial=0)) > top for picture in beside):
        return ()
    table = np.rint(np.arange(top + 1) * (WHITE_16_BIT / top)).astype(np.uint16)
    for picture in (*photographs, *beside):
        picture[...] = table[picture]
    message = (
        f"the largest value is {top}, white of {_WHITE_LEVELS[top]} bit: "
        f"the values were multiplied by {WHITE_16_BIT / top:.1f}"
    )
    return (Finding("note", "range-stretched", message),)


def white_of(photographs: Array) -> int | None:
    """The largest value where that is white of 9 to 15 bits, and several have it; else None.

    photographs : (N, H, W, 3)
    """
    few = photographs[:, ::_STRIDE, ::_STRIDE]
    if photographs.dtype != np.uint16 or int(few.max(initial=0)) > max(_WHITE_LEVELS):
        return None
    top = int(photographs.max(initial=0))
    enough = top in _WHITE_LEVELS and np.count_nonzero(photographs == top) >= _LEAST_WHITE
    return top if enough else None


def is_saturated(photographs: Array, top: int) -> bool:
    """Whether more values are `top` than one below: what is brighter than white ends there.

    >>> is_saturated(np.array([9, 9, 9, 8, 8]), 9), is_saturated(np.array([9, 9, 9, 8, 8, 8]), 9)
    (True, False)
    """
    return bool(np.count_nonzero(photographs == top) > np.count_nonzero(photographs == top - 1))


def narrow_range(photographs: Array) -> tuple[Finding, ...]:
    """A warning where photographs (N, H, W, 3) may hold values of fewer bits in 16."""
    top = white_of(photographs)
    if top is None:
        return ()
    message = (
        f"the largest value is {top}, white of {_WHITE_LEVELS[top]} bit: in 16 bit saturated "
        "values are not known for it, and dark ones count as black"
    )
    remedy = f"multiply the photographs by {round(WHITE_16_BIT / top)}"
    return (Finding("warning", "narrow-range", message, remedy),)
