"""Images converted a strip of rows at a time: what a step needs in between is a strip's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rakelight.model import Array

ROWS = 256


def in_strips(convert: Callable[[Array], Array], image: Array) -> Array:
    """convert(image), pixel by pixel, of an image (H, W[, C]).

    >>> in_strips(lambda strip: 2 * strip, np.ones((600, 1))).sum()
    np.float64(1200.0)
    """
    first = convert(image[:ROWS])
    if len(image) <= ROWS:
        return first
    out = np.empty((len(image), *first.shape[1:]), first.dtype)
    out[:ROWS] = first
    for row in range(ROWS, len(image), ROWS):
        out[row : row + ROWS] = convert(image[row : row + ROWS])
    return out
