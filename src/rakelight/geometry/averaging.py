"""Means over the pixels of a coarser sensor: the operator K of depth super-resolution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from rakelight.model import Floats, Mask

# Less of a pixel than this is rounding.
LEAST_SHARE = 1e-9


@dataclass(frozen=True, eq=False)
class Averaging:
    """K: means of an image (h, w) over the object's part of every sensor pixel (hs, ws).

    K x = (R (m x) C^T) / (R m C^T), m the mask (h, w), R (hs, h) and C (ws, w) the shares of rows
    and columns that sensor pixels cover; 0 for sensor pixels without a part of the object.

    row_edges, column_edges : (hs + 1,), (ws + 1,) where sensor pixels begin and end, in pixels
    """

    mask: Mask
    row_edges: Floats
    column_edges: Floats
    _rows: Any
    _columns: Any
    _area: Floats

    @classmethod
    def on(cls, mask: Mask, row_edges: Floats, column_edges: Floats) -> Averaging:
        """K on a mask (h, w).

        >>> edges = np.array([0.0, 1.5, 3.0])
        >>> K = Averaging.on(np.ones((3, 3), bool), edges, edges)
        >>> K.down(np.arange(9.0).reshape(3, 3)).round(3).tolist()
        [[1.333, 2.667], [5.333, 6.667]]
        """
        rows = overlaps(row_edges, mask.shape[0])
        columns = overlaps(column_edges, mask.shape[1])
        area = rows @ mask.astype(np.float64) @ columns.T
        return cls(mask, row_edges, column_edges, rows, columns, area)

    @property
    def factor(self) -> float:
        """Pixels per sensor pixel, along the side where there are fewest."""
        return float(min(np.diff(edges).min() for edges in (self.row_edges, self.column_edges)))

    def halved(self, mask: Mask) -> Averaging:
        """K on a mask of pixels twice as wide."""
        return Averaging.on(mask, self.row_edges / 2, self.column_edges / 2)

    def total(self, image: Floats) -> Floats:
        """(hs, ws) sums over the object's part of every sensor pixel."""
        return np.asarray((self._shares @ image.ravel()).reshape(self._area.shape))

    def down(self, image: Floats) -> Floats:
        """K image, (hs, ws)."""
        return self.total(image) * self._by_area

    def up(self, image: Floats) -> Floats:
        """K^T image, (h, w)."""
        shared = (image * self._by_area).ravel()
        return np.asarray((self._shares.T @ shared).reshape(self.mask.shape))

    def upsampled(self, image: Floats) -> Floats:
        """(h, w) the mean of the sensor pixels (hs, ws) that cover a pixel; 0 beside the object."""
        shared = self._shares.T
        share = shared @ np.ones(image.size)
        means = (shared @ image.ravel()) / np.where(share > 0, share, 1.0)
        return np.asarray(means.reshape(self.mask.shape))

    @property
    def covered(self) -> Mask:
        """(hs, ws) sensor pixels with a part of the object."""
        return np.asarray(self._area > LEAST_SHARE)

    def matrix(self, mask: Mask) -> Any:
        """Sparse (M, P): K of the P pixels of a mask, to the M sensor pixels that are covered."""
        from scipy.sparse import diags_array

        covered = self.covered.ravel()
        by_area = diags_array(self._by_area.ravel()[covered])
        return (by_area @ self._shares[covered][:, mask.ravel()]).tocsr()

    @cached_property
    def _shares(self) -> Any:
        """Sparse (hs ws, h w): how much of each of the object's pixels a sensor pixel covers."""
        from scipy.sparse import kron

        shares = kron(self._rows, self._columns, format="csr")
        shares.data *= self.mask.ravel()[shares.indices]
        shares.eliminate_zeros()
        return shares

    @cached_property
    def _by_area(self) -> Floats:
        return np.where(self.covered, 1 / np.where(self.covered, self._area, 1.0), 0.0)


@dataclass(frozen=True, eq=False)
class AveragedData:
    """K^T W K, the matrix of data (hs, ws) with weights W that a sensor averaged; see `solve`."""

    averaging: Averaging
    weight: Floats

    def apply(self, x: Floats) -> Floats:
        """K^T W K x, (h, w)."""
        return self.averaging.up(self.weight * self.averaging.down(x))

    def diagonal(self) -> Floats:
        """(h, w) row sums: what each pixel would weigh if it were measured alone."""
        return self.apply(np.ones(self.averaging.mask.shape))


def overlaps(edges: Floats, size: int) -> Any:
    """Sparse (n, size): how much of each of `size` unit cells the n cells between edges cover.

    >>> overlaps(np.array([0.0, 1.5, 3.0]), 3).toarray().tolist()
    [[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]]
    """
    from scipy.sparse import csr_array

    cell = np.arange(size)
    first = np.clip(np.floor(edges[:-1] + LEAST_SHARE).astype(int), 0, size)
    last = np.clip(np.ceil(edges[1:] - LEAST_SHARE).astype(int), 0, size)
    reach = int((last - first).max(initial=0))
    columns = first[:, None] + np.arange(reach)
    inside = columns < last[:, None]
    columns = np.minimum(columns, size - 1)
    shares = np.minimum(edges[1:, None], cell[columns] + 1) - np.maximum(
        edges[:-1, None], cell[columns]
    )
    rows = np.broadcast_to(np.arange(len(first))[:, None], columns.shape)
    return csr_array(
        (shares[inside], (rows[inside], columns[inside])), shape=(len(edges) - 1, size)
    )


def data_terms(averaging: Averaging | None, weight: Floats, target: Floats) -> dict[str, Any]:
    """sum w (K (p - t))^2 of an image p (h, w), as `solve.assemble` takes it.

    averaging : K; None where the sensor's pixels are the image's
    weight, target : (h, w) w, each pixel's share in its sensor pixel's, and t
    """
    if averaging is None:
        return {"data_weight": weight, "data_target": target}
    data = AveragedData(averaging, averaging.total(weight))
    return {
        "data_weight": np.zeros(weight.shape), "data_target": target, "extra": data,
        "extra_rhs": data.apply(target),
    }  # fmt: skip


def data_sum_of_squares(
    averaging: Averaging | None, weight: Floats, miss: Floats, mask: Mask
) -> float:
    """sum w (K d)^2 of an image d (h, w) on a mask, as `data_terms` has it."""
    if averaging is None:
        return float((weight * miss**2)[mask].sum())
    return float((averaging.total(weight) * averaging.down(miss) ** 2).sum())
