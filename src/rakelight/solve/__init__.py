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

from dataclasses import replace
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
    origin: Floats | None = None,
    tolerance: float = 1e-6,
    max_iterations: int = 100,
    hierarchy: Hierarchy | None = None,
) -> Solution:
    """Solve `system` by multigrid until |rhs - A value| <= tolerance |rhs - A origin|.

    start : (H, W), the target unless given
    origin : (H, W), 0 unless given.  What is sought is the change from there: a depth of a metre
        that changes by a millimetre is within a tolerance of 1e-3 of 0 from the beginning.
    hierarchy : from `build_hierarchy`, of this or a close system on the same mask; built anew
        unless given.  It changes the time, not the answer.

    A solve that does not converge raises nothing: `Solution.status` says how it ended, and
    every caller has to read it; `Solution.required` is the value, and raises if it is no solution.
    Raises InputError for a start, an origin or a hierarchy that does not fit, or a limit out of
    range.
    """
    began = perf_counter()
    if not 0 < tolerance < 1:
        raise InputError("bad tolerance", source="tolerance", seen=str(tolerance), needed="(0, 1)")
    if max_iterations < 1:
        raise InputError("too few", source="max_iterations", seen=str(max_iterations), needed="1")
    first = _finite(system, system.target if start is None else start, "start")
    zero = np.zeros(system.mask.shape)
    change = system
    if origin is not None:
        zero = np.where(system.mask, _finite(system, origin, "origin"), 0.0)
        change = replace(system, rhs=system.rhs - system.apply(zero))
    value, iterations = iterate(change, first - zero, tolerance, max_iterations, hierarchy)
    relative = relative_residual(change, value)
    status: Status = "stalled"
    if relative <= tolerance:
        status = "converged"
    elif iterations >= max_iterations:
        status = "iteration limit"
    value = np.where(system.mask, zero + value, system.target)
    return Solution(value, status, iterations, relative, perf_counter() - began)


def _finite(system: DepthSystem, image: Floats, name: str) -> Floats:
    """A depth (H, W) as float64; raises InputError where it does not fit the unknowns."""
    image = np.asarray(image, dtype=np.float64)
    if image.shape != system.mask.shape or not np.isfinite(image[system.mask]).all():
        raise InputError("not a depth", source=name, needed="(H, W), finite inside the mask")
    return image


def relative_residual(system: DepthSystem, value: Floats) -> float:
    """|rhs - A value| / |rhs| over the unknowns; the plain |A value| where rhs is zero."""
    residual = float(np.linalg.norm(system.rhs - system.apply(value)))
    return residual / (float(np.linalg.norm(system.rhs)) or 1.0)
