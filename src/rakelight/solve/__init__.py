"""Depth as the minimiser of a quadratic energy on a masked pixel grid.  Knows no photometry.

>>> import numpy as np
>>> mask = np.ones((8, 8), bool)
>>> tensor = np.broadcast_to([1.0, 0.0, 1.0], (8, 8, 3))
>>> slope = np.broadcast_to([0.5, 0.0], (8, 8, 2))
>>> ramp = np.broadcast_to(0.5 * np.arange(8.0), (8, 8))
>>> system = assemble(mask, tensor, slope, np.full((8, 8), 0.01), ramp)
>>> solution = solve(system)
>>> solution.status, bool(np.allclose(solution.value, ramp))
('converged', True)
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from rakelight.errors import InputError
from rakelight.model import Floats
from rakelight.solve.multigrid import Hierarchy, build_hierarchy, iterate
from rakelight.solve.solution import Solution, Status
from rakelight.solve.stencil import DepthSystem, SymmetricOperator, assemble

__all__ = [
    "DepthSystem",
    "Hierarchy",
    "Solution",
    "SymmetricOperator",
    "assemble",
    "build_hierarchy",
    "solve",
]


def solve(
    system: DepthSystem,
    *,
    start: Floats | None = None,
    tolerance: float = 1e-6,
    max_iterations: int = 100,
    hierarchy: Hierarchy | None = None,
) -> Solution:
    """Solve `system` by multigrid until |rhs - A value| <= tolerance |rhs|.

    start : (H, W), the target unless given
    hierarchy : from `build_hierarchy`, of this or a close system on the same mask; built anew
        unless given.  It changes the time, not the answer.

    A solve that does not converge raises nothing: `Solution.status` says how it ended, and
    every caller has to read it; `Solution.required` is the value, and raises if it is no solution.
    Raises InputError for a start or a hierarchy that does not fit, or a limit out of range.
    """
    began = perf_counter()
    if not 0 < tolerance < 1:
        raise InputError("bad tolerance", source="tolerance", seen=str(tolerance), needed="(0, 1)")
    if max_iterations < 1:
        raise InputError("too few", source="max_iterations", seen=str(max_iterations), needed="1")
    first = np.asarray(system.target if start is None else start, dtype=np.float64)
    if first.shape != system.mask.shape or not np.isfinite(first[system.mask]).all():
        raise InputError("not a start", source="start", needed="(H, W), finite inside the mask")

    value, iterations = iterate(system, first, tolerance, max_iterations, hierarchy)
    relative = relative_residual(system, value)
    status: Status = "stalled"
    if relative <= tolerance:
        status = "converged"
    elif iterations >= max_iterations:
        status = "iteration limit"
    value = np.where(system.mask, value, system.target)
    return Solution(value, status, iterations, relative, perf_counter() - began)


def relative_residual(system: DepthSystem, value: Floats) -> float:
    """|rhs - A value| / |rhs| over the unknowns; the plain |A value| where rhs is zero."""
    residual = float(np.linalg.norm(system.rhs - system.apply(value)))
    return residual / (float(np.linalg.norm(system.rhs)) or 1.0)
