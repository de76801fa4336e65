"""Geometric multigrid as the preconditioner of conjugate gradients.

Stencils that jump by orders of magnitude from pixel to pixel, in any direction, on masks with
holes and thin parts: the interpolation follows the matrix (Dendy 1982), the coarse matrices are
Galerkin products, and the relaxation solves whole lines, rows then columns, every other one at a
time.  After the coarse correction it runs backwards, so that the cycle is symmetric.

The cycle works in single precision; conjugate gradients around it in double, and the coarse
matrices are computed in double too: data may weigh 1e-8 of the diagonal, which is all that holds
what is not linked to the rest, and single precision would lose it among the couplings.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rakelight.errors import InputError
from rakelight.jit import in_parts
from rakelight.model import Floats, Mask
from rakelight.solve.cg import conjugate_gradients
from rakelight.solve.sparse import stencil_matrix
from rakelight.solve.stencil import DepthSystem, Laplacian

# Most unknowns of a level that is solved by a dense factorisation.
COARSEST = 300
# Least diagonal, over its mean: its inverse fits in single precision.
SMALLEST_DIAGONAL = 1e-20
# Ridge of the coarsest matrix, over its diagonal: larger than the rounding error.
RIDGE = 1e-12
# Least number of columns that a core relaxes at once: fewer would not fill vector instructions.
LEAST_COLUMNS = 64


@dataclass(frozen=True)
class Level:
    """One grid of the hierarchy, all float32 with a border of zeros, (h, w) counting it.

    stencil (5, h, w); reciprocal pivots of its lines (h, w); north and south: the weights by
    which a row between two coarse rows follows the one above and below (coarse h, w).
    rhs and x are the level's scratch space.
    """

    stencil: Floats
    row_pivots: Floats
    column_pivots: Floats
    north: Floats
    south: Floats
    rhs: Floats
    x: Floats


@dataclass(frozen=True)
class Hierarchy:
    """All levels of a multigrid cycle, from fine to coarse, for the mask they were built on.

    top, left : where the window of the finest level begins on the grid with its border
    scale : mean diagonal of the system; the levels hold the matrix divided by it
    coarsest, coarsest_pixels : the Cholesky factor and the pixels of the last level
    Not for use by two threads at once: the levels carry their scratch space.
    """

    mask: Mask
    top: int
    left: int
    scale: float
    levels: tuple[Level, ...]
    coarsest: Any
    coarsest_pixels: Mask

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns of the grid (without border) that the finest level covers."""
        h, w = self.levels[0].x.shape
        return slice(self.top, self.top + h - 2), slice(self.left, self.left + w - 2)

    def precondition(self, residual: Floats, norm: float) -> Floats:
        """About A⁻¹ residual by one symmetric cycle, (h, w) float32, valid until the next call.

        residual : (h, w) of the finest level; norm : its norm, to bring it into the range of
        single precision.
        """
        finest = self.levels[0]
        rows = (0, len(finest.x), finest.x.size)
        in_parts(_kernels().scaled, *rows, 1 / norm, residual, finest.rhs)
        self._cycle(0)
        in_parts(_kernels().scaled, *rows, norm / self.scale, finest.x, finest.x)
        return finest.x

    def _cycle(self, depth: int) -> None:
        level = self.levels[depth]
        if depth == len(self.levels) - 1:
            self._solve_coarsest(level)
            return
        coarser = self.levels[depth + 1]
        coarse_rows = (1, len(coarser.x) - 1, level.x.size)
        between = (level.north, level.south)
        _relax(level)
        in_parts(
            _kernels().restrict, *coarse_rows, level.stencil, level.rhs, level.x, *between,
            coarser.rhs,
        )  # fmt: skip
        self._cycle(depth + 1)
        in_parts(_kernels().prolong, *coarse_rows, *between, coarser.x, level.x)
        _relax_back(level)

    def _solve_coarsest(self, level: Level) -> None:
        from scipy.linalg import cho_solve

        pixels = self.coarsest_pixels
        level.x[pixels] = cho_solve(self.coarsest, level.rhs[pixels])


def _relax(level: Level) -> None:
    """Solve the rows, every other one at a time, then the columns; x needs no start."""
    _relax_rows(level, 0, alone=True)
    _relax_rows(level, 1)
    _relax_columns(level, 0)
    _relax_columns(level, 1)


def _relax_back(level: Level) -> None:
    """The same lines in the opposite order: the transpose of `_relax`."""
    _relax_columns(level, 1)
    _relax_columns(level, 0)
    _relax_rows(level, 1)
    _relax_rows(level, 0)


def _relax_rows(level: Level, parity: int, alone: bool = False) -> None:
    rows, x = (len(level.x) - 1 - parity) // 2, level.x
    given = (level.stencil, level.row_pivots, level.rhs, x, parity, alone)
    in_parts(_kernels().relax_rows, 0, rows, x.size, *given)


def _relax_columns(level: Level, parity: int) -> None:
    x, last = level.x, level.x.shape[1] - 1
    given = (level.stencil, level.column_pivots, level.rhs, x, parity)
    in_parts(_kernels().relax_columns, 1, last, x.size, *given, least=LEAST_COLUMNS)


def iterate(
    system: DepthSystem,
    start: Floats,
    tolerance: float,
    max_iterations: int,
    hierarchy: Hierarchy | None,
) -> tuple[Floats, int]:
    """The solution (H, W) of conjugate gradients from `start`, and the iterations it took."""
    if hierarchy is None:
        hierarchy = build_hierarchy(system)
    elif not np.array_equal(hierarchy.mask, system.mask):
        raise InputError("built for another mask", source="hierarchy")
    top, left, window = hierarchy.top, hierarchy.left, hierarchy.window
    x = np.pad(np.where(system.mask, start, 0.0)[window], 1)
    iterations = conjugate_gradients(
        lambda p, out: system.apply_window(p, out, top, left),
        hierarchy.precondition,
        system.rhs[window],
        x,
        tolerance,
        max_iterations,
    )
    value = start.copy()
    value[window] = x[1:-1, 1:-1]
    return value, iterations


def build_hierarchy(system: DepthSystem) -> Hierarchy:
    """The multigrid levels of a system; they serve for any system that is close to it.

    What does not fit a 9-point stencil enters by its surrogate: the laplacian by the second
    order operator that bounds it, the extra term by its lumped diagonal.

    Raises InputError for a matrix that is not positive definite, as far as this shows.

    >>> from rakelight.solve import assemble, solve
    >>> tensor, none = np.broadcast_to([1.0, 0.0, 1.0], (40, 40, 3)), np.zeros((40, 40))
    >>> system = assemble(none == 0, tensor, np.zeros((40, 40, 2)), none + 0.1, none + 2)
    >>> hierarchy = build_hierarchy(system)
    >>> [level.x.shape for level in hierarchy.levels]
    [(42, 42), (22, 22), (12, 12)]
    >>> solve(system, start=none, hierarchy=hierarchy).status
    'converged'
    """
    from scipy.linalg import LinAlgError, cho_factor

    rows, columns = (np.flatnonzero(system.mask.any(axis=axis)) for axis in (1, 0))
    top, left = int(rows[0]), int(columns[0])
    h, w = int(rows[-1]) - top + 3, int(columns[-1]) - left + 3
    window = np.s_[top : top + h, left : left + w]
    diagonal = system.centre[system.mask]
    if diagonal.min() <= 0:
        raise _indefinite()
    scale = float(diagonal.mean())
    stencil = system.stencil[:, *window] / scale
    if system.laplacian is not None:
        stencil += laplacian_surrogate(system.laplacian)[:, *window] / scale
    if system.extra is not None:
        lumped = np.pad(np.where(system.mask, system.extra.diagonal(), 0.0), 1)
        stencil[0] += lumped[window] / scale
    inside = np.pad(system.mask, 1)[window]
    np.maximum(stencil[0], SMALLEST_DIAGONAL, out=stencil[0], where=inside)

    levels = []
    while True:
        level, coarse = _level(stencil)
        levels.append(level)
        if coarse is None:
            break
        stencil = coarse
    pixels = stencil[0] > 0
    dense = stencil_matrix(stencil, pixels).toarray()
    dense[np.diag_indices_from(dense)] *= 1 + RIDGE
    try:
        factor = cho_factor(dense)
    except LinAlgError as error:
        raise _indefinite() from error
    return Hierarchy(system.mask, top, left, scale, tuple(levels), factor, pixels)


def _indefinite() -> InputError:
    needed = "a positive definite matrix, as from assemble()"
    return InputError("the matrix is not positive definite", source="system", needed=needed)


def _level(exact: Floats) -> tuple[Level, Floats | None]:
    """The level of the stencil `exact` (5, h, w) float64, and the next coarser stencil."""
    _, h, w = exact.shape
    stencil = np.zeros(exact.shape, np.float32)
    k, rows, columns = _kernels(), (1, h - 1, h * w), (1, w - 1, h * w)
    in_parts(k.rounded_up, *rows, exact, stencil)
    row_pivots, column_pivots = np.zeros((2, h, w), np.float32)
    in_parts(k.factor_rows, *rows, stencil, row_pivots)
    in_parts(k.factor_columns, *columns, stencil, column_pivots, least=LEAST_COLUMNS)
    ch, cw = (h + 1) // 2 + 1, (w + 1) // 2 + 1
    north, south = np.zeros((2, ch, cw), np.float32)
    scratch = np.zeros((2, h, w), np.float32)
    level = Level(stencil, row_pivots, column_pivots, north, south, *scratch)
    if np.count_nonzero(exact[0]) <= COARSEST or max(h, w) <= 4:
        return level, None
    P = np.zeros((h, w, 4), np.float32)
    in_parts(k.interpolation, *rows, exact, P)
    in_parts(k.interpolation_amid_four, 0, h // 2 - 1, h * w, exact, P)
    coarse = np.zeros((5, ch, cw))
    in_parts(k.galerkin, 1, ch - 1, h * w, exact, P, coarse)
    between = P[2:-1:2, 1::2]
    rows, columns = between.shape[:2]
    north[1 : 1 + rows, 1 : 1 + columns] = between[..., 0]
    south[1 : 1 + rows, 1 : 1 + columns] = between[..., 2]
    return level, coarse


def _kernels() -> Any:
    """The compiled loops, loaded on first use: numba is slow to import."""
    from rakelight.solve import _kernels

    return _kernels


def laplacian_surrogate(laplacian: Laplacian) -> Floats:
    """A stencil (5, H+2, W+2) of first differences that bounds Lᵀ lambda L from above.

    (p_e - 2 p + p_w)² <= 2 (p_e - p)² + 2 (p - p_w)², and twice that for two axes together.
    """
    out = np.zeros((5, *laplacian.weight.shape))
    for k, there in ((1, laplacian.along_u), (2, laplacian.along_v)):
        strength = 4 * np.where(there, laplacian.weight, 0.0)
        edge = strength + np.roll(strength, -1, axis=2 - k)  # with the pixel to the east, south
        out[k] = -edge
        out[0] += edge + np.roll(edge, 1, axis=2 - k)
    return out
