"""A surface and lights to start from: the photographs' factorisation, and the sensor's shape.

Where noise hides the object's relief from the sensor, lights fitted to the sensor's normals are far
off, and the descent ends in a wrong local minimum.  Under distant lights the photographs have rank
three: they are products of lights and scaled normals b (ldr_ps.py), known up to a 3 x 3 matrix A,
with normals along m = A b.  Of all A the one is taken whose normals are those of one surface that
also fits the sensor's depth, p being log depth and p_0 that of the sensor term:

    N_g log sum w f^2 |G p - g|^2  +  N_s log(M + sum (K (p - p_0))^2 / sigma^2)
        -  (N_g / P_g) sum log(|det A| / c^3)  +  (N - 4) log(variance of log |s_i|),

c = -m . ray, g = (m_1 / f_x, m_2 / f_y) / c being the gradient of log depth, w weights of a Cauchy
loss, P_g the number of pixels that have a b, M that of the sensor's pixels.  The third term is the
change of variables from b to slopes: without it a flatter surface would always fit better.  The
last is the equal-intensity term of the lights s_i = A^-T l_i, l_i being the factors: equal
intensities determine A but for a rotation (Hayakawa 1994).  For given A and weights p is a linear
least-squares solution, its matrix factored once; A is found by L-BFGS from several starts, each
also mirrored: convex and concave fit the photographs alike, and only the sensor distinguishes them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import diags_array, eye_array

from rakelight.geometry.grid import Links, has_gradient
from rakelight.methods.base import scatter
from rakelight.methods.ldr_ps import Factors, LdrPs, factorise, integrable_basis
from rakelight.methods.levels import CORRELATION_PX, Level
from rakelight.methods.multi_light.equal_intensity import equal_intensity_slope
from rakelight.methods.multi_light.initial_lights import bas_relief_of_slopes
from rakelight.model import TINY, Floats, Mask
from rakelight.photometry.images import LightParameters
from rakelight.solve.robust import CAUCHY, NOTABLE, ROUNDS
from rakelight.solve.sparse import factorised

# Standard deviation of slopes, radians: at first (ablation.md: halved 1.04, doubled 1.03), and the
# least (halved 1.01, doubled 0.99).
FIRST_SLOPE_RAD, LEAST_SLOPE_RAD = np.radians(3.0), np.radians(0.3)


@dataclass(frozen=True, eq=False)
class Problem:
    """The data that a matrix A is fitted to, on the P pixels of a level's mask, and their weights.

    directions (P, 3) of b, unit length; determined (P,) where b is; rays (P, 3) at depth 1
    gradient : sparse (2 P, P), u and v in turn; focal (2,) pixels; sensor : sparse (M, P) K
    target, precision : (M,) K p_0, and 1 / variance of it
    lights : (N, 3) the factors l; exposures : (N,) of the photographs, None where they are alike
    slope_weight : (P,) of f^2 |G p - g|^2; sensor_weight : of (K (p - p_0))^2 / sigma^2.  Under
        given weights the surface is a linear function of slopes
    """

    directions: Floats
    determined: Mask
    rays: Floats
    gradient: Any
    focal: Floats
    sensor: Any
    target: Floats
    precision: Floats
    lights: Floats
    exposures: Floats | None
    slope_weight: Floats
    sensor_weight: float

    @classmethod
    def of(cls, level: Level, factors: Factors, determined: Mask) -> Problem:
        """Of a level's factors; determined : (h, w) where there is a scaled normal."""
        mask, camera = level.mask, level.camera
        normals = scatter(factors.normals, level.photographs.active)
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        unit = normals / np.maximum(length, np.finfo(float).tiny)
        sensor = eye_array(np.count_nonzero(mask)).tocsr()
        if level.averaging is not None:
            sensor = level.averaging.matrix(mask)
        problem = cls(
            unit[mask], determined[mask], level.rays[mask],
            Links.of(level.grid).gradient.tocsr(), np.array([camera.fx, camera.fy]), sensor,
            sensor @ level.unbiased_prior[mask], level.sensor_weight, factors.lights,
            level.photographs.exposures, np.ones(len(unit[mask])), 1.0,
        )  # fmt: skip
        slopes = 2 * np.count_nonzero(determined[mask])
        return problem.weighted(
            problem.determined, slopes * FIRST_SLOPE_RAD**2, len(problem.target)
        )

    def weighted(self, relative: Floats | Mask, slope_sum: float, sensor_sum: float) -> Problem:
        """The problem with the weights of independent errors that have these sums of squares.

        relative : (P,) weights of slopes, in proportion
        """
        slopes, sensor = self.counts
        weight = slopes / slope_sum * relative
        return replace(self, slope_weight=weight, sensor_weight=sensor / sensor_sum)

    @cached_property
    def counts(self) -> tuple[float, float]:
        """N_g and N_s: numbers of independent slopes and depths."""
        slopes, depths = 2 * np.count_nonzero(self.determined), len(self.determined)
        return slopes / CORRELATION_PX**2, depths / CORRELATION_PX**2

    def sum_of_squares(self, log_depth: Floats) -> float:
        """sum (K (p - p_0))^2 / sigma^2 of log depth (P,)."""
        return float(self.precision @ (self.sensor @ log_depth - self.target) ** 2)

    def slope_errors(self, residual: Floats) -> tuple[Floats, float]:
        """(P,) f^2 |G p - g|^2 of residuals (P, 2), and the variance of each slope, robustly."""
        square = ((residual * self.focal) ** 2).sum(axis=1)
        middle = float(np.median(square[self.determined])) / (2 * np.log(2))
        return square, max(middle, LEAST_SLOPE_RAD**2)

    def slopes(self, A: Floats) -> tuple[Floats, Floats]:
        """(P, 2) gradients g of log depth under A, and c (P,)."""
        normals = self.directions @ A.T
        toward = -np.sum(normals * self.rays, axis=1)
        typical = float(np.median(np.abs(toward[self.determined])))
        toward = np.maximum(toward, NOTABLE * typical)
        return normals[:, :2] / self.focal / toward[:, None], toward

    @cached_property
    def _along(self) -> Floats:
        return (self.slope_weight[:, None] * self.focal**2).ravel()

    @cached_property
    def _equations(self) -> tuple[Any, Any, Floats]:
        """The surface's: factors, a matrix (P, 2 P) for slopes, the sensor's right side (P,)."""
        precision = self.sensor_weight * self.precision
        by_slopes = self.gradient.T @ diags_array(self._along)
        matrix = by_slopes @ self.gradient + self.sensor.T @ diags_array(precision) @ self.sensor
        # pixels without slope and sensor would leave the matrix singular
        matrix = matrix + 1e-9 * float(matrix.diagonal().mean()) * eye_array(len(self.determined))
        sensed = self.sensor.T @ (precision * self.target)
        return factorised(matrix.tocsc()), by_slopes.tocsr(), sensed

    def surface(self, slopes: Floats) -> tuple[Floats, Floats]:
        """(P,) log depth p with slopes (P, 2) nearest to those, and G p - g (P, 2)."""
        factor, by_slopes, sensed = self._equations
        log_depth = factor.solve(by_slopes @ slopes.ravel() + sensed)
        return log_depth, (self.gradient @ log_depth).reshape(-1, 2) - slopes

    def intensity_cost(self, A: Floats) -> tuple[float, Floats]:
        """`equal_intensity_energy` of the lights under A, and its derivatives with A (3, 3)."""
        inverse = np.linalg.inv(A)
        lights = self.lights @ inverse
        energy, slope = equal_intensity_slope(lights[:, None], self.exposures)
        return energy, -lights.T @ slope @ inverse.T

    def cost(self, flat: Floats) -> tuple[float, Floats]:
        """The terms under these weights for A, flat (9,), and their derivatives (9,).

        p minimises the sums for every A, so its derivative drops out (envelope theorem).
        """
        A = flat.reshape(3, 3)
        slopes, toward = self.slopes(A)
        log_depth, residual = self.surface(slopes)
        share = self.counts[0] / np.count_nonzero(self.determined) * self.determined
        volume = np.linalg.slogdet(A)[1] - 3 * np.log(toward)
        sensor = self.sensor_weight * self.sum_of_squares(log_depth)
        value = float(self._along @ residual.ravel() ** 2 + sensor)
        by_slopes = -2 * self.slope_weight[:, None] * self.focal**2 * residual
        by_toward = (3 * share - np.sum(by_slopes * slopes, axis=1)) / toward
        by_normals = -by_toward[:, None] * self.rays
        by_normals[:, :2] += by_slopes / self.focal / toward[:, None]
        derivative = by_normals.T @ self.directions - share.sum() * np.linalg.inv(A).T
        intensities, by_lights = self.intensity_cost(A)
        return value - float(share @ volume) + intensities, (derivative + by_lights).ravel()


def factored_start(level: Level) -> tuple[Floats, LightParameters] | None:
    """(h, w) log depth and white distant lights that explain the photographs and fit the sensor.

    None where the photographs do not have rank three, as under lights in one plane.
    """
    mask = level.photographs.active
    light = level.photographs.light(mask)
    usable = np.asarray((light >= 0).all(axis=-1))
    values = np.where(usable, light.mean(axis=-1), 0.0)
    determined = scatter(usable.sum(axis=0) >= 3, mask) > 0
    if not has_gradient(determined).any():
        return None
    try:
        factors = factorise(values, usable, LdrPs())
        problem = Problem.of(level, factors, determined)
        _, A, log_depth_inside = best_surface(problem, matrices(level, factors, determined))
        vector = factors.lights @ np.linalg.inv(A)
    except (np.linalg.LinAlgError, RuntimeError, ValueError):  # singular
        return None
    vector /= max(float(np.median(np.linalg.norm(vector, axis=1))), np.finfo(float).tiny)
    if not (np.isfinite(vector).all() and np.isfinite(log_depth_inside).all()):
        return None
    log_depth = level.prior.copy()
    log_depth[level.mask] = log_depth_inside
    return log_depth, LightParameters.distant(vector[:, None], np.zeros((len(vector), 1)))


def matrices(level: Level, factors: Factors, determined: Mask) -> Iterator[Floats]:
    """Matrices A to begin with, and each mirrored.

    One by regression of the prior's normals on b, which averages the prior's errors out.  One that
    makes the field integrable, its bas-relief transform by regression of slopes.
    """
    mask, camera = level.photographs.active, level.camera
    inside = determined[mask]
    scaled, normals = factors.normals[inside], level.normals(level.prior)[0][determined]
    unit = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), TINY)
    starts = [np.linalg.lstsq(unit, normals, rcond=None)[0].T]
    basis = integrable_basis(factors.normals, mask, determined, camera)
    with suppress(np.linalg.LinAlgError):  # no slope
        starts.append(bas_relief_of_slopes(scaled @ basis.T, normals).T @ basis)
    for A in starts:
        if not abs(np.linalg.det(A)) > 1e-12 * np.linalg.norm(A) ** 3:
            continue
        m = unit @ A.T
        facing = A if np.median(m[:, 2]) < 0 else -A
        # Mirrored: the slopes m_1 / m_3 and m_2 / m_3 become twice their mean less themselves.
        mean = (unit @ facing.T).mean(axis=0)
        u, v = 2 * mean[:2] / mean[2]
        yield facing
        yield np.array([[-1.0, 0.0, u], [0.0, -1.0, v], [0.0, 0.0, 1.0]]) @ facing


def best_surface(problem: Problem, begins: Iterable[Floats]) -> tuple[float, Floats, Floats]:
    """Of the local minima found from these A, the best: `comparable_cost`, A, (P,) log depth.

    The weights are estimated again after each round.  Many begins come to the same minimum in the
    first round; the other rounds are made once for each.

    Raises ValueError where none has a finite cost.
    """
    fits = [(problem, A / np.cbrt(abs(np.linalg.det(A)))) for A in begins]
    for _ in range(ROUNDS):
        fits = without_repeats(descended(*fit) for fit in fits)
    found = []
    for weighted, A in fits:
        log_depth, residual = weighted.surface(weighted.slopes(A)[0])
        found.append((comparable_cost(weighted, A, log_depth, residual), A, log_depth))
    return min((each for each in found if np.isfinite(each[0])), key=lambda each: each[0])


def descended(problem: Problem, A: Floats) -> tuple[Problem, Floats]:
    """The local minimum that L-BFGS finds from A, and the problem with the weights of that.

    A quadratic cost takes as many steps as A has numbers; this one is given `ROUNDS` times as many.
    """
    from scipy.optimize import minimize

    # SciPy's "BFGS" changes the filter of warnings, which other threads share, while it runs.
    A = minimize(
        problem.cost, A.ravel(), jac=True, method="L-BFGS-B",
        options={"maxiter": ROUNDS * A.size, "maxcor": A.size},
    ).x.reshape(3, 3)  # fmt: skip
    A /= np.cbrt(abs(np.linalg.det(A)))
    return reweighted(problem, A), A


def without_repeats(fits: Iterable[tuple[Problem, Floats]]) -> list[tuple[Problem, Floats]]:
    """The fits whose matrix differs notably from that of all before.

    On 14 draws L-BFGS came to one minimum within 4 % of a matrix, to others 15 % and more apart.
    """
    different: list[tuple[Problem, Floats]] = []
    for problem, A in fits:
        apart = (np.linalg.norm(A - other) for _, other in different)
        if not any(each < NOTABLE * np.linalg.norm(A) for each in apart):
            different.append((problem, A))
    return different


def reweighted(problem: Problem, A: Floats) -> Problem:
    """The problem with its weights estimated again, from the residuals at A."""
    log_depth, residual = problem.surface(problem.slopes(A)[0])
    square, variance = problem.slope_errors(residual)
    relative = problem.determined / (1 + square / (CAUCHY**2 * variance))
    least = 2 * np.count_nonzero(problem.determined) * LEAST_SLOPE_RAD**2
    sensor_sum = problem.sum_of_squares(log_depth) + len(problem.target)
    return problem.weighted(relative, float(relative @ square) + least, sensor_sum)


def comparable_cost(problem: Problem, A: Floats, log_depth: Floats, residual: Floats) -> float:
    """The cost of A with both standard deviations estimated at A, so that matrices compare.

    log_depth (P,), residual (P, 2) : the surface of A, and its slopes minus those of A
    """
    determined = problem.determined
    square, variance = problem.slope_errors(residual)
    outside = np.log1p(square[determined] / (CAUCHY**2 * variance))
    tails = np.mean(0.5 * CAUCHY**2 * outside) + np.log(variance)
    _, toward = problem.slopes(A)
    volume = np.linalg.slogdet(A)[1] - 3 * float(np.mean(np.log(toward[determined])))
    slopes, sensor = problem.counts
    sum_of_squares = np.log1p(problem.sum_of_squares(log_depth) / len(problem.target))
    intensities = problem.intensity_cost(A)[0]
    return float(slopes * (tails - volume) + sensor * sum_of_squares + intensities)
