"""Sparse factorisation: the reference, and the plain choice for small systems."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rakelight.errors import InputError
from rakelight.model import Floats, Mask
from rakelight.solve.reference import DIRECTIONS
from rakelight.solve.stencil import DepthSystem, Laplacian

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from rakelight.solve.multigrid import Hierarchy


@dataclass(frozen=True, slots=True)
class Direct:
    """SciPy's SuperLU in symmetric mode: exact, but ten seconds and 1.4 GB a million unknowns.

    It cannot take a system with an `extra` operator, and has no use for a hierarchy.
    """

    def run(
        self,
        system: DepthSystem,
        start: Floats,
        tolerance: float,
        max_iterations: int,
        hierarchy: Hierarchy | None,
    ) -> tuple[Floats, int]:
        """The solution (H, W), in one iteration."""
        from scipy.sparse import csc_array

        if hierarchy is not None:
            raise InputError("Direct() uses no hierarchy", source="hierarchy", needed="None")
        factors = factorised(csc_array(system.to_sparse()))
        value = start.copy()
        value[system.mask] = factors.solve(system.rhs[system.mask])
        return value, 1


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

    number = _numbered(inside)
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


def laplacian_matrix(laplacian: Laplacian, inside: Mask) -> csr_array[Any]:
    """Lᵀ lambda L over the pixels of `inside` (h, w)."""
    from scipy import sparse

    number = _numbered(inside)
    count = int(np.count_nonzero(inside))
    L = sparse.csr_array((count, count))
    for there, (down, right) in ((laplacian.along_u, (0, 1)), (laplacian.along_v, (1, 0))):
        r, c = np.nonzero(there)
        columns = number[r, c], number[r + down, c + right], number[r - down, c - right]
        values = np.repeat([-2.0, 1.0, 1.0], len(r))
        ij = np.tile(number[r, c], 3), np.concatenate(columns)
        L = L + sparse.csr_array((values, ij), shape=(count, count))
    return sparse.csr_array(L.T @ sparse.diags_array(laplacian.weight[inside]) @ L)


def _numbered(inside: Mask) -> Any:
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(np.count_nonzero(inside))
    return number
