"""One Gauss-Newton step in a depth field and a few global numbers together.

The field has a sparse system A; the numbers (lights, say) a small matrix H; C couples them:

    | A    C | | step_field   |     | residual_field   |
    | C^T  H | | step_numbers |  =  | residual_numbers |

The numbers are few, so A is factored once and the field eliminated: the Schur complement
S = H - C^T A^-1 C is as small as H.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rakelight.model import Floats
from rakelight.solve.sparse import factorised


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
    if not determined.any():
        return solution
    try:
        solution[determined] = cho_solve(cho_factor(damped), wanted)
    except LinAlgError:  # by rounding
        solution[determined] = np.linalg.lstsq(damped, wanted, rcond=1e-12)[0]
    return solution


def bordered_step(
    matrix: Any, residual: Floats, columns: Floats, hessian: Floats, slope: Floats, damping: float
) -> tuple[Floats, Floats] | None:
    """(P,) step of the field and (K,) step of the numbers; None where the field's A is singular.

    matrix : sparse (P, P) A, symmetric positive definite; residual : (P,) of the field
    columns : (P, K) C; hessian, slope : (K, K) and (K,) second and first derivatives with the
        numbers, whose step is damped as in `damped_solution`

    >>> from scipy.sparse import eye_array
    >>> field, numbers = bordered_step(
    ...     eye_array(9), np.zeros(9), np.zeros((9, 1)), np.eye(1), np.array([-2.0]), 0.0)
    >>> round(float(numbers[0]), 6), float(np.abs(field).max())
    (2.0, 0.0)
    >>> bordered_step(
    ...     0 * eye_array(9), np.zeros(9), np.zeros((9, 1)), np.eye(1), np.zeros(1), 0.0) is None
    True
    """
    from rakelight.solve._kernels import solve_lower

    try:
        factor = factorised(matrix.tocsc(), panel_size=1)  # a tenth faster for so few unknowns
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
    schur, reduced = hessian - half.T @ half, -slope - columns.T @ field
    numbers = damped_solution(schur, reduced, np.diag(hessian), damping)
    return field - factor.solve(columns @ numbers), numbers
