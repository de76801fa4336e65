"""The masked pixel grid: one-sided differences, area averages, windows.

Differences live on an (H, W) grid with a bool mask.  A forward difference at a pixel needs the
pixel and its right (lower) neighbour inside the mask; a backward one its left (upper) neighbour.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rakelight.model import Array, Floats, Mask


def neighbours(mask: Mask, axis: int) -> tuple[Mask, Mask]:
    """Where the forward and the backward difference along `axis` exist, each (H, W) bool.

    >>> forward, backward = neighbours(np.array([[True, True, False]]), axis=1)
    >>> forward.tolist(), backward.tolist()
    ([[True, False, False]], [[False, True, False]])
    """
    forward = np.zeros_like(mask)
    here, there = pair_slices(axis)
    forward[here] = mask[here] & mask[there]
    backward = np.zeros_like(mask)
    backward[there] = forward[here]
    return forward, backward


def pair_slices(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of every pixel with a next one along `axis`, and of those next ones."""
    here = [slice(None), slice(None)]
    there = [slice(None), slice(None)]
    here[axis], there[axis] = slice(None, -1), slice(1, None)
    return tuple(here), tuple(there)


def differences(values: Floats, mask: Mask, axis: int) -> tuple[Floats, Floats]:
    """Forward and backward difference of `values` (H, W) along `axis`; 0 where there is none.

    >>> f, b = differences(np.array([[1.0, 3.0, 7.0]]), np.ones((1, 3), bool), axis=1)
    >>> f.tolist(), b.tolist()
    ([[2.0, 4.0, 0.0]], [[0.0, 2.0, 4.0]])
    """
    exists, _ = neighbours(mask, axis)
    here, there = pair_slices(axis)
    step = np.zeros(values.shape, dtype=np.result_type(values, np.float32))
    step[here] = np.where(exists[here], values[there] - values[here], 0)
    back = np.zeros_like(step)
    back[there] = step[here]
    return step, back


def mean_gradient(values: Floats, mask: Mask) -> tuple[Floats, Floats]:
    """d/du and d/dv of `values` (H, W): the mean of the one-sided differences that exist.

    Second order inside the mask, one-sided at its border, 0 where a pixel has no neighbour.

    >>> u, v = mean_gradient(np.arange(6.0).reshape(2, 3), np.ones((2, 3), bool))
    >>> u.tolist(), v.tolist()
    ([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]], [[3.0, 3.0, 3.0], [3.0, 3.0, 3.0]])
    """
    gradients = []
    for axis in (1, 0):
        forward, backward = differences(values, mask, axis)
        has_forward, has_backward = neighbours(mask, axis)
        count = has_forward.astype(np.float64) + has_backward
        gradients.append((forward + backward) / np.maximum(count, 1))
    return gradients[0], gradients[1]


def has_gradient(mask: Mask) -> Mask:
    """(H, W) True where a pixel has a neighbour along both axes, so that it has a normal."""
    along = [np.logical_or(*neighbours(mask, axis)) for axis in (0, 1)]
    return np.asarray(along[0] & along[1])


def bounding_window(mask: Mask, margin: int = 0) -> tuple[slice, slice]:
    """Rows and columns of the smallest window that holds the mask, `margin` pixels wider.

    >>> bounding_window(np.eye(4, dtype=bool)[1:])
    (slice(0, 3, None), slice(1, 4, None))
    """
    slices = []
    for axis, size in ((1, mask.shape[0]), (0, mask.shape[1])):
        index = np.flatnonzero(mask.any(axis=axis))
        slices.append(slice(max(0, int(index[0]) - margin), min(size, int(index[-1]) + 1 + margin)))
    return slices[0], slices[1]


def area_mean(image: Array, factor: int) -> Floats:
    """Mean over `factor` x `factor` blocks of an image (H, W[, C]); H and W must be divisible.

    >>> area_mean(np.arange(8.0).reshape(2, 4), 2).tolist()
    [[2.5, 4.5]]
    """
    height, width = image.shape[0] // factor, image.shape[1] // factor
    blocks = image.reshape(height, factor, width, factor, *image.shape[2:])
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float64))


def gradient_matrices(mask: Mask) -> tuple[Any, Any]:
    """`mean_gradient` as two sparse (P, P) matrices on the mask's P pixels in row order.

    Rows of pixels that lack a neighbour along one of the axes are empty: no normal, no gradient.

    >>> u, v = gradient_matrices(np.ones((2, 3), bool))
    >>> (u @ np.arange(6.0)).tolist(), (v @ np.arange(6.0)).tolist()
    ([1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [3.0, 3.0, 3.0, 3.0, 3.0, 3.0])
    """
    from scipy.sparse import csr_array

    number = np.full(mask.shape, -1)
    number[mask] = np.arange(np.count_nonzero(mask))
    active = has_gradient(mask)
    matrices = []
    for axis, stride in ((1, 1), (0, mask.shape[1])):
        forward, backward = (side & active for side in neighbours(mask, axis))
        count = (forward.astype(np.float64) + backward).ravel()
        rows, columns, entries = [], [], []
        for side, sign in ((forward, 1), (backward, -1)):
            here = np.flatnonzero(side)
            share = sign / count[here]
            rows += [number.ravel()[here]] * 2
            columns += [number.ravel()[here + sign * stride], number.ravel()[here]]
            entries += [share, -share]
        place = (np.concatenate(rows), np.concatenate(columns))
        size = int(np.count_nonzero(mask))
        matrices.append(csr_array((np.concatenate(entries), place), shape=(size, size)))
    return matrices[0], matrices[1]
