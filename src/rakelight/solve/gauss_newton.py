"""One Gauss-Newton step in a depth field and a few global numbers together.

The field has a sparse system A; the numbers (lights, say) a small matrix H; C couples them:

    | A    C | | step_field   |     | residual_field   |
    | C^T  H | | step_numbers |  =  | residual_numbers |

The numbers are few, so A is factored once and the field eliminated: the Schur complement
S = H - C^T A^-1 C is as small as H.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rakelight.model import Floats


@dataclass(frozen=True)
class BorderedSystem:
    """A eliminated: what is needed for steps of any damping.

    schur : (K, K) S; reduced : (K,) residual_numbers - C^T A^-1 residual_field
    field : (P,) A^-1 residual_field on the mask's P pixels
    columns : (P, K) C; factor : of A, with a method `solve`; diagonal : (K,) of H
    """

    schur: Floats
    reduced: Floats
    field: Floats
    columns: Floats
    factor: Any
    diagonal: Floats

    def step(self, damping: float) -> tuple[Floats, Floats]:
        """(P,) step of the field and (K,) step of the numbers, damped as in `damped_solution`."""
        numbers = damped_solution(self.schur, self.reduced, self.diagonal, damping)
        return self.field - self.factor.solve(self.columns @ numbers), numbers


def damped_solution(matrix: Floats, right: Floats, diagonal: Floats, damping: float) -> Floats:
    """(K,) solution of a semidefinite system (K, K), Levenberg-damped by `damping` x diagonal.

    Directions that nothing determines do not move.

    >>> matrix = np.diag([2.0, 0.0])
    >>> damped_solution(matrix, np.array([6.0, 1.0]), np.diag(matrix), 0.5).round(6).tolist()
    [2.0, 0.0]
    """
    from scipy.linalg import LinAlgError, cho_factor, cho_solve

    # Rounding must not move what nothing depends on.
    determined = diagonal > 1e-12 * float(diagonal.max(initial=0.0))
    ridge = damping * diagonal + 1e-9 * float(diagonal.mean())
    damped, wanted = (matrix + np.diag(ridge))[np.ix_(determined, determined)], right[determined]
    solution = np.zeros(determined.size)
    try:
        solution[determined] = cho_solve(cho_factor(damped), wanted)
    except LinAlgError:  # by rounding
        solution[determined] = np.linalg.lstsq(damped, wanted, rcond=1e-12)[0]
    return solution


def border(
    matrix: Any, residual: Floats, columns: Floats, hessian: Floats, slope: Floats
) -> BorderedSystem | None:
    """Eliminate the field from a joint step; None where the field's matrix is singular.

    matrix : sparse (P, P) A, symmetric positive definite; residual : (P,) of the field
    columns : (P, K) C; hessian, slope : (K, K) and (K,) second and first derivatives with the
        numbers

    >>> from scipy.sparse import eye_array
    >>> free = border(eye_array(9), np.zeros(9), np.zeros((9, 1)), np.eye(1), np.array([-2.0]))
    >>> field, numbers = free.step(0.0)
    >>> round(float(numbers[0]), 6), float(np.abs(field).max())
    (2.0, 0.0)
    >>> border(0 * eye_array(9), np.zeros(9), np.zeros((9, 1)), np.eye(1), np.zeros(1)) is None
    True
    """
    from scipy.sparse.linalg import splu

    from rakelight.solve._kernels import solve_lower

    try:
        factor: Any = splu(
            matrix.tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            panel_size=1,  # a tenth faster for so few unknowns
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # "Factor is exactly singular": by rounding, of wild values
        return None
    field = factor.solve(residual)
    # A = L D L^T, its pixels in the factors' order: C^T A^-1 C needs L^-1 C alone, half of the
    # solve, with the columns of C side by side.
    lower, pivots = factor.L, factor.U.diagonal()
    half = np.empty(columns.shape)
    half[factor.perm_r] = columns
    solve_lower(lower.indptr, lower.indices, lower.data, half)
    half /= np.sqrt(pivots)[:, None]
    return BorderedSystem(
        schur=hessian - half.T @ half,
        reduced=-slope - columns.T @ field,
        field=field,
        columns=columns,
        factor=factor,
        diagonal=np.diag(hessian),
    )
