"""The sparse matrix of a stencil, and factors of sparse matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rakelight.model import Floats, Mask

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# Where east, south, south-east and south-west lie, as (rows, columns).
DIRECTIONS = ((0, 1), (1, 0), (1, 1), (1, -1))


def factorised(matrix: Any, panel_size: int | None = None) -> Any:
    """Factors, with a method `solve`, of a sparse symmetric positive definite (P, P) matrix.

    panel_size : columns that are eliminated at once; SuperLU's own number unless given
    Raises RuntimeError where the matrix is singular.
    """
    from scipy.sparse.linalg import splu

    return splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        panel_size=panel_size,
        options={"SymmetricMode": True},
    )


def stencil_matrix(stencil: Floats, inside: Mask) -> csr_array[Any]:
    """The 9-point stencil (5, h, w) over the pixels of `inside` (h, w), in row order."""
    from scipy import sparse

    number = np.full(inside.shape, -1)
    number[inside] = np.arange(np.count_nonzero(inside))
    own = number[inside]
    rows, columns, values = [own], [own], [stencil[0][inside]]
    for entries, (down, right) in zip(stencil[1:], DIRECTIONS, strict=True):
        r, c = np.nonzero(entries)
        here, there = number[r, c], number[r + down, c + right]
        rows += [here, there]
        columns += [there, here]
        values += [entries[r, c]] * 2
    ijv = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array(ijv, shape=(len(own), len(own)))
