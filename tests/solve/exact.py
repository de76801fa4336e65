"""The plain reference: the matrix of a system, its solution by factorisation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array

from rakelight.solve import DepthSystem
from rakelight.solve.sparse import factorised
from rakelight.solve.stencil import Laplacian


def solution(system: DepthSystem) -> np.ndarray:
    """(H, W), the target outside the mask."""
    value = system.target.copy()
    value[system.mask] = factorised(csc_array(matrix(system))).solve(system.rhs[system.mask])
    return value


def matrix(system: DepthSystem) -> csr_array:
    """A over the mask pixels, row by row, with the term of the Laplacian."""
    stencil = replace(system, laplacian=None).to_sparse()
    if system.laplacian is None:
        return stencil
    return stencil + laplacian_matrix(system.laplacian, system.mask)


def laplacian_matrix(laplacian: Laplacian, mask: np.ndarray) -> csr_array:
    """Lᵀ lambda L over the pixels of the mask (H, W)."""
    inside, count = np.pad(mask, 1), np.count_nonzero(mask)
    number = np.full(inside.shape, -1)
    number[inside] = np.arange(count)
    L = csr_array((count, count))
    for there, (down, right) in ((laplacian.along_u, (0, 1)), (laplacian.along_v, (1, 0))):
        r, c = np.nonzero(there)
        columns = number[r, c], number[r + down, c + right], number[r - down, c - right]
        values = np.repeat([-2.0, 1.0, 1.0], len(r))
        ij = np.tile(number[r, c], 3), np.concatenate(columns)
        L = L + csr_array((values, ij), shape=(count, count))
    return L.T @ diags_array(laplacian.weight[inside]) @ L
