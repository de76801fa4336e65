"""Differences of whole images by compiled loops, for what takes them again and again."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import Grid, Links
from rakelight.jit import in_parts
from rakelight.model import Floats


def gradient_image(values: Floats, grid: Grid) -> Floats:
    """`grid.mean_gradient` as one image (H, W, 2), by a compiled loop.

    >>> gradient_image(np.arange(6.0).reshape(2, 3), np.ones((2, 3), bool))[1, 2].tolist()
    [1.0, 3.0]
    """
    from rakelight.geometry import _kernels

    links, out = Links.of(grid), np.empty((*values.shape, 2))
    given = (np.ascontiguousarray(values), links.right, links.down, out)
    in_parts(_kernels.gradient_image, 0, len(values), values.size, *given)
    return out


def fourth_differences(values: Floats, grid: Grid) -> Floats:
    """(2, H, W) fourth differences of `values` (H, W) along u and v; 0 where there are none.

    >>> board = (-1.0) ** np.indices((5, 5)).sum(axis=0)
    >>> fourth_differences(board, np.ones((5, 5), bool))[:, 2, 2].tolist()
    [16.0, 16.0]
    """
    from rakelight.geometry import _kernels

    links, out = Links.of(grid), np.empty((2, *values.shape))
    given = (np.ascontiguousarray(values), *links.fives, out)
    in_parts(_kernels.fourth_differences, 0, len(values), values.size, *given)
    return out
