"""The masked pixel grid: links between pixels, one-sided differences, area averages, windows.

Differences live on an (H, W) grid with a bool mask.  A forward difference at a pixel needs the
pixel and its right (lower) neighbour inside the mask; a backward one its left (upper) neighbour.
Where the surface ends at a depth jump, two neighbours are both inside and yet not linked: every
function here takes a mask, which links all its neighbours, or `Links`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import radians, tan
from typing import Any

import numpy as np

from rakelight.model import Array, Camera, Floats, Mask

# Steepest surface that is still a surface: depth change over lateral distance, at 85 degrees
# from facing the camera.  A real surface as steep as that covers less than a tenth of its area
# in pixels and carries no usable photometric signal; what looks like one is an occlusion edge.
STEEPEST = tan(radians(85.0))


def outline(mask: Mask) -> Mask:
    """(H, W) the pixels of a mask that miss one of their four neighbours in it.

    >>> outline(np.ones((3, 4), bool)).astype(int).tolist()
    [[1, 1, 1, 1], [1, 0, 0, 1], [1, 1, 1, 1]]
    """
    return np.asarray(mask & ~Links.of(mask).inner)


@dataclass(frozen=True, eq=False)
class Links:
    """Which neighbours on a pixel grid lie on one surface.

    mask : (H, W) the pixels
    right, down : (H, W) whether a pixel is linked to its right, to its lower neighbour
    """

    mask: Mask
    right: Mask
    down: Mask

    @classmethod
    def of(cls, grid: Grid) -> Links:
        """The links of a mask, all there are; links as they are."""
        if isinstance(grid, Links):
            return grid
        sides = []
        for axis in (1, 0):
            here, there = pair_slices(axis)
            linked = np.zeros_like(grid)
            linked[here] = grid[here] & grid[there]
            sides.append(linked)
        return cls(grid, *sides)

    @cached_property
    def cut(self) -> bool:
        """Whether any two neighbours in the mask are not linked."""
        whole = Links.of(self.mask)
        return bool((whole.right != self.right).any() or (whole.down != self.down).any())

    def halved(self) -> Links:
        """The links of cells of 2 x 2 pixels: a cell is whole, and nothing is cut on the way."""
        height, width = (-(-side // 2) for side in self.mask.shape)

        def cells(image: Mask) -> Array:
            """(height, width, 2, 2): the pixels of each cell, row and column last."""
            padded = np.zeros((2 * height, 2 * width), dtype=bool)
            padded[: image.shape[0], : image.shape[1]] = image
            return padded.reshape(height, 2, width, 2).swapaxes(1, 2)

        mask: Mask = np.asarray(cells(self.mask).all(axis=(2, 3)))
        sides = []
        for axis, linked in (
            (1, np.asarray(cells(self.right).all(axis=2))),
            (0, np.asarray(cells(self.down).all(axis=3))),
        ):
            # A cell's own links along the axis, those to the next cell, the next cell's own.
            here, there = pair_slices(axis)
            side = np.zeros(mask.shape, dtype=bool)
            side[here] = linked[here].all(axis=-1) & linked[there][..., 0]
            sides.append(side)
        return Links(mask, *sides)

    @cached_property
    def sides(self) -> dict[int, tuple[Mask, Mask]]:
        """Axis -> where the forward and where the backward difference along it exist, (H, W)."""
        sides = {}
        for axis, forward in ((0, self.down), (1, self.right)):
            here, there = pair_slices(axis)
            backward = np.zeros_like(forward)
            backward[there] = forward[here]
            sides[axis] = (forward, backward)
        return sides

    @cached_property
    def active(self) -> Mask:
        """(H, W) True where a pixel has a neighbour along both axes, so that it has a normal."""
        along = [forward | backward for forward, backward in self.sides.values()]
        return np.asarray(along[0] & along[1])

    @cached_property
    def inner(self) -> Mask:
        """(H, W) the pixels that are linked to all four neighbours."""
        return np.asarray(np.logical_and(*self.sides[0]) & np.logical_and(*self.sides[1]))

    @cached_property
    def fives(self) -> tuple[Mask, Mask]:
        """Where fourth differences along u and along v exist, each (H, W).

        In the middle of five linked pixels that have a normal each, but for the two outer ones.
        """
        masks = []
        for axis in (1, 0):
            near = np.logical_and(*self.sides[axis]) & self.active
            here, there = pair_slices(axis)
            wide = near.copy()
            wide[here] &= near[there]
            wide[there] &= near[here]
            masks.append(wide)
        return masks[0], masks[1]

    @cached_property
    def gradient(self) -> Any:
        """Sparse (2 P, P): `gradient_matrices` of the mask's P pixels, u and v of each in turn."""
        from scipy.sparse import vstack

        size = int(np.count_nonzero(self.mask))
        in_turn = np.arange(2 * size).reshape(2, size).T.ravel()
        return vstack(gradient_matrices(self), "csr")[in_turn]

    @property
    def pairs(self) -> Floats | None:
        """`pair_weights` as `solve.assemble` takes them: None without a cut."""
        return self.pair_weights if self.cut else None

    @cached_property
    def pair_weights(self) -> Floats:
        """(H, W, 4) what makes the mean over a mask's difference pairs that over the linked ones.

        Pairs (+u,+v), (+u,-v), (-u,+v), (-u,-v).
        """
        weights = []
        for grid in (self, Links.of(self.mask)):
            sides = [neighbours(grid, axis) for axis in (1, 0)]
            weights.append(np.stack([u & v for u in sides[0] for v in sides[1]], axis=-1))
        linked, inside = weights
        count = np.maximum(linked.sum(axis=-1, keepdims=True), 1)
        return np.asarray(linked * (inside.sum(axis=-1, keepdims=True) / count))


Grid = Mask | Links


def surface_links(depth_m: Floats, mask: Mask, camera: Camera) -> Links:
    """The links of a mask (H, W), cut where the depth (H, W), metres, jumps.

    A jump is a depth difference of more than `STEEPEST` times the lateral distance z / f.

    >>> camera = Camera(3, 2, fx=100.0, fy=100.0, cx=1.0, cy=0.5)
    >>> step = np.array([[1.0, 1.0, 1.5], [1.0, 1.0, 1.5]])
    >>> surface_links(step, np.ones((2, 3), bool), camera).right.tolist()
    [[True, False, False], [True, False, False]]
    """
    whole = Links.of(mask)
    sides = []
    for axis, linked, focal in ((1, whole.right, camera.fx), (0, whole.down, camera.fy)):
        here, there = pair_slices(axis)
        with np.errstate(invalid="ignore"):
            near = np.minimum(depth_m[here], depth_m[there])
            smooth = np.abs(depth_m[here] - depth_m[there]) <= STEEPEST / focal * near
        side = np.zeros_like(linked)
        side[here] = linked[here] & smooth
        sides.append(side)
    return Links(mask, *sides)


def neighbours(grid: Grid, axis: int) -> tuple[Mask, Mask]:
    """Where the forward and the backward difference along `axis` exist, each (H, W) bool.

    >>> forward, backward = neighbours(np.array([[True, True, False]]), axis=1)
    >>> forward.tolist(), backward.tolist()
    ([[True, False, False]], [[False, True, False]])
    """
    return Links.of(grid).sides[axis]


def pair_slices(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of every pixel with a next one along `axis`, and of those next ones."""
    here = [slice(None), slice(None)]
    there = [slice(None), slice(None)]
    here[axis], there[axis] = slice(None, -1), slice(1, None)
    return tuple(here), tuple(there)


def differences(values: Floats, grid: Grid, axis: int) -> tuple[Floats, Floats]:
    """Forward and backward difference of `values` (H, W) along `axis`; 0 where there is none.

    >>> f, b = differences(np.array([[1.0, 3.0, 7.0]]), np.ones((1, 3), bool), axis=1)
    >>> f.tolist(), b.tolist()
    ([[2.0, 4.0, 0.0]], [[0.0, 2.0, 4.0]])
    """
    exists, _ = neighbours(grid, axis)
    here, there = pair_slices(axis)
    step = np.zeros(values.shape, dtype=np.result_type(values, np.float32))
    step[here] = np.where(exists[here], values[there] - values[here], 0)
    back = np.zeros_like(step)
    back[there] = step[here]
    return step, back


def mean_gradient(values: Floats, grid: Grid) -> tuple[Floats, Floats]:
    """d/du and d/dv of `values` (H, W): the mean of the one-sided differences that exist.

    Second order inside the mask, one-sided at its border, 0 where a pixel has no neighbour.

    >>> u, v = mean_gradient(np.arange(6.0).reshape(2, 3), np.ones((2, 3), bool))
    >>> u.tolist(), v.tolist()
    ([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]], [[3.0, 3.0, 3.0], [3.0, 3.0, 3.0]])
    """
    gradients, links = [], Links.of(grid)
    for axis in (1, 0):
        mean = np.add(*differences(values, links, axis), dtype=np.float64)
        both = np.logical_and(*neighbours(links, axis))
        gradients.append(np.multiply(mean, 0.5, out=mean, where=both))
    return gradients[0], gradients[1]


def mean_gradient_transposed(along_u: Floats, along_v: Floats, grid: Grid) -> Floats:
    """(H, W) the transpose of `mean_gradient`: what derivatives with the gradient mean for values.

    >>> mask = np.ones((1, 3), bool)
    >>> mean_gradient_transposed(np.array([[0.0, 1.0, 0.0]]), np.zeros((1, 3)), mask).tolist()
    [[-0.5, 0.0, 0.5]]
    """
    links = Links.of(grid)
    total = np.zeros(links.mask.shape)
    for axis, image in ((1, along_u), (0, along_v)):
        here, there = pair_slices(axis)
        forward, backward = neighbours(links, axis)
        share = np.where(forward & backward, 0.5, 1.0) * image
        flow = np.where(forward[here], share[here] + share[there], 0.0)
        total[there] += flow
        total[here] -= flow
    return total


def has_gradient(grid: Grid) -> Mask:
    """(H, W) True where a pixel has a neighbour along both axes, so that it has a normal."""
    return Links.of(grid).active


def connected(grid: Grid) -> tuple[Array, int]:
    """(H, W) number from 0 of each pixel's connected component, -1 outside; how many there are.

    >>> connected(np.array([[True, True, False, True]]))[0].tolist()
    [[0, 0, -1, 1]]
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = Links.of(grid)
    size = int(np.count_nonzero(links.mask))
    labels = np.full(links.mask.shape, -1)
    labels[links.mask] = np.arange(size)
    first = np.concatenate([labels[links.right], labels[links.down]])
    second = np.concatenate(
        [np.roll(labels, -1, axis=1)[links.right], np.roll(labels, -1, axis=0)[links.down]]
    )
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(size, size))
    count, label = connected_components(graph, directed=False)
    labels[links.mask] = label
    return labels, int(count) if size else 0


def reached(start: Mask, links: Links, steps: int) -> Mask:
    """(H, W) the pixels to which at most so many links lead from those of `start`, and these.

    >>> links = Links.of(np.array([[1, 1, 1, 0, 1]], bool))
    >>> reached(np.array([[1, 0, 0, 0, 0]], bool), links, 1).tolist()
    [[True, True, False, False, False]]
    """
    found = start & links.mask
    for _ in range(steps):
        before = found.copy()
        for axis, linked in ((1, links.right), (0, links.down)):
            here, there = pair_slices(axis)
            found[there] |= before[here] & linked[here]
            found[here] |= before[there] & linked[here]
    return found


def row_strips(height: int, most: int = 256) -> Iterator[slice]:
    """Rows of an image from the first to the last, at most so many at a time.

    Work that needs memory for each pixel needs it for a strip's alone then; 256 rows of a large
    photograph are megabytes.

    >>> list(row_strips(5, 2))
    [slice(0, 2, None), slice(2, 4, None), slice(4, 5, None)]
    """
    for first in range(0, height, most):
        yield slice(first, min(first + most, height))


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
    # A slice for each place in a block: means over short axes take much longer.
    total = np.zeros((height, width, *image.shape[2:]))
    for row, column in np.ndindex(factor, factor):
        total += image[row::factor, column::factor]
    return total / factor**2


def gradient_matrices(grid: Grid) -> tuple[Any, Any]:
    """`mean_gradient` as two sparse (P, P) matrices on the mask's P pixels in row order.

    Rows of pixels that lack a neighbour along one of the axes are empty: no normal, no gradient.

    >>> u, v = gradient_matrices(np.ones((2, 3), bool))
    >>> (u @ np.arange(6.0)).tolist(), (v @ np.arange(6.0)).tolist()
    ([1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [3.0, 3.0, 3.0, 3.0, 3.0, 3.0])
    """
    from scipy.sparse import csr_array

    links = Links.of(grid)
    mask = links.mask
    number = np.full(mask.shape, -1)
    number[mask] = np.arange(np.count_nonzero(mask))
    active = has_gradient(links)
    matrices = []
    for axis, stride in ((1, 1), (0, mask.shape[1])):
        forward, backward = (side & active for side in neighbours(links, axis))
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


def all_finite(image: Floats) -> Mask:
    """(H, W) where all three channels of an image (H, W, 3) are finite.

    >>> all_finite(np.array([[[0.0, 1.0, 2.0], [0.0, np.nan, 2.0]]])).tolist()
    [[True, False]]
    """
    # Six times as fast as `all` over an axis of three.
    first, second, third = np.moveaxis(np.isfinite(image), -1, 0)
    return np.asarray(first & second & third)
