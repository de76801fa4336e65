"""Square cells of pixels: sums over them, and smooth fields that are given by one number each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.model import Array, Floats, Mask


def cell_sums(image: Floats, cell: int) -> Floats:
    """Sums over cells of cell x cell pixels of an image (h, w[, C]), the last ones cut short.

    >>> cell_sums(np.ones((3, 4)), 2).tolist()
    [[4.0, 4.0], [2.0, 2.0]]
    """
    for axis in (0, 1):
        starts = np.arange(0, image.shape[axis], cell)
        image = np.add.reduceat(image, starts, axis=axis)
    return image


def interpolate(coarse: Floats, cell: int, shape: tuple[int, ...]) -> Floats:
    """An image of cells interpolated linearly between their centres, cut to `shape`."""
    for axis in (0, 1):
        along = _interpolation(coarse.shape[axis], cell)[: shape[axis]]
        image = np.tensordot(along, coarse, axes=(1, axis))
        coarse = np.moveaxis(image, 0, axis)
    return coarse


@dataclass(frozen=True)
class Cells:
    """Fields on a mask (h, w) that are linear between the centres of cells.

    cell : side of a cell, pixels; inside : (ch, cw) cells that hold a pixel of the mask
    """

    mask: Mask
    cell: int
    inside: Mask
    _nearest: tuple[Array, Array]

    @classmethod
    def on(cls, mask: Mask, cell: int) -> Cells:
        """Cells of cell x cell pixels on a mask."""
        from scipy.ndimage import distance_transform_edt

        inside = cell_sums(mask.astype(np.float64), cell) > 0
        nearest = distance_transform_edt(~inside, return_distances=False, return_indices=True)
        return cls(mask, cell, inside, (nearest[0], nearest[1]))

    def interpolate(self, values: Floats) -> Floats:
        """(h, w) the field of `values` (ch, cw); cells outside continue the nearest one inside.

        >>> cells = Cells.on(np.ones((4, 4), bool), 2)
        >>> cells.interpolate(np.array([[0.0, 4.0], [0.0, 4.0]]))[0].tolist()
        [0.0, 1.0, 3.0, 4.0]
        """
        return interpolate(values[self._nearest], self.cell, self.mask.shape)

    def gather(self, image: Floats) -> Floats:
        """(ch, cw) the transpose of `interpolate`: what derivatives (h, w) mean for the cells."""
        image = np.where(self.mask, image, 0.0)
        for axis in (0, 1):
            along = _interpolation(self.inside.shape[axis], self.cell)[: image.shape[axis]]
            image = np.moveaxis(np.tensordot(along, image, axes=(0, axis)), 0, axis)
        total = np.zeros(self.inside.shape)
        np.add.at(total, self._nearest, image)
        return total


def _interpolation(cells: int, cell: int) -> Floats:
    """(cells * cell, cells) linear interpolation between the centres of cells along a line."""
    place = np.clip((np.arange(cells * cell) + 0.5) / cell - 0.5, 0, cells - 1)
    first = np.minimum(place.astype(int), max(cells - 2, 0))
    matrix = np.zeros((place.size, cells))
    rows = np.arange(place.size)
    matrix[rows, first] = 1 - (place - first)
    if cells > 1:
        matrix[rows, first + 1] += place - first
    return matrix
