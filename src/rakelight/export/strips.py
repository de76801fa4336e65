"""Images converted a strip of rows at a time: what a step needs in between is a strip's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rakelight.geometry.grid import row_strips
from rakelight.model import Array


def in_strips(convert: Callable[[Array], Array], image: Array) -> Array:
    """convert(image), pixel by pixel, of an image (H, W[, C]).

    >>> in_strips(lambda strip: 2 * strip, np.ones((600, 1))).sum()
    np.float64(1200.0)
    """
    strips = row_strips(len(image))
    rows = next(strips)
    first = convert(image[rows])
    out = np.empty((len(image), *first.shape[1:]), first.dtype)
    out[rows] = first
    for rows in strips:
        out[rows] = convert(image[rows])
    return out
