"""Preconditioned conjugate gradients over a window of the pixel grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rakelight.jit import in_parts
from rakelight.model import Floats

# Restarts from the true residual, where the updated one has converged and the true one has not.
RESTARTS = 3


def conjugate_gradients(
    apply: Callable[[Floats, Floats], None],
    precondition: Callable[[Floats, float], Floats],
    rhs: Floats,
    x: Floats,
    tolerance: float,
    max_iterations: int,
) -> int:
    """Improve x in place until |rhs - A x| <= tolerance |rhs|; returns the iterations.

    rhs : (h, w) float64; x : (h+2, w+2) float64 with a border of zeros, as all vectors here
    apply(x, out) writes A x; precondition(residual, norm) returns an approximation of
    A⁻¹ residual in an array of its own, valid until the next call.  Stops early where A or the
    preconditioner is not positive definite, or where rounding leaves nothing to gain.
    """
    from rakelight.solve import _kernels

    rows = np.empty(len(x))
    whole = (0, len(x), x.size)

    def dot(first: Floats, second: Floats) -> float:
        in_parts(_kernels.dot, *whole, first, second, rows)
        return float(rows.sum())

    image, residual, direction = (np.zeros_like(x) for _ in range(3))
    inner = np.s_[1:-1, 1:-1]
    residual[inner] = rhs
    iterations, last, size = 0, np.inf, np.sqrt(dot(residual, residual))
    for _ in range(1 + RESTARTS):
        apply(x, image)
        np.subtract(rhs, image[inner], out=residual[inner])
        norm = np.sqrt(dot(residual, residual))
        largest = tolerance * (size or norm)
        if iterations >= max_iterations or not largest < norm < 0.5 * last:
            break
        last, slope = norm, 0.0
        while norm > largest and iterations < max_iterations:
            z = precondition(residual, norm)
            slope, before = dot(residual, z), slope
            beta = slope / before if before else 0.0
            in_parts(_kernels.update_direction, *whole, beta, z, direction)
            apply(direction, image)
            curvature = dot(direction, image)
            if not (slope > 0 and curvature > 0 and np.isfinite(slope / curvature)):
                return iterations
            alpha = slope / curvature
            in_parts(_kernels.step, *whole, alpha, direction, image, x, residual, rows)
            norm = np.sqrt(rows.sum())
            iterations += 1
    return iterations
