"""A surface and lamps to start from: the photographs' rank three, and the sensor's shape.

Where noise hides the object's relief from the sensor, lamps fitted to the sensor's normals are far
off, and descent ends in a wrong valley.  Under distant lamps the photographs are products of lamps
and scaled normals b (ldr_ps.py), known up to a 3 x 3 matrix A: normals along m = A b.  Of all A
the one is taken whose normals are those of one surface p that also lies where the sensor says:

    N_g log sum w f^2 |G p - g|^2  +  N_s log(M + sum (K p - z)^2 / sigma^2)
                                   -  (N_g / P) sum log(|det A| / c^3),     c = -m . ray,

g = (m_1 / f_x, m_2 / f_y) / c being the gradient of log depth, w weights of a Student-t.  The last
sum is the change of variables from b to slopes: without it a flatter surface would always fit
better.  For given A and weights p is a linear least-squares solution, its matrix factored once; A
has eight numbers that count and is found by BFGS from several starts, the mirrored ones too:
convex and concave fit the photographs alike, and only the sensor tells them apart.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import diags_array, eye_array

from rakelight.geometry.grid import Links, has_gradient
from rakelight.methods.base import scatter
from rakelight.methods.ldr_ps import Factors, LdrPs, factorise, integrable_basis
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.bas_relief import rays_of
from rakelight.methods.multi_light.initial_lights import prior_normals, relief_of_slopes
from rakelight.model import Floats, Mask
from rakelight.photometry.images import Lamps
from rakelight.solve.direct import factorised

# A value below this part of its pixel's brightest is in shadow, which rank three does not hold.
SHADOW = 0.2
# Area, pixels, over which errors of slopes and of the sensor's depth are taken to be correlated.
CORRELATED_PX = 25.0
# Standard deviation of slopes, radians: before it is estimated, and the least.  And that of the
# sensor's depth before it is estimated, as a multiple of what the sensor states.
FIRST_SLOPE_RAD, LEAST_SLOPE_RAD, FIRST_SENSOR = np.radians(3.0), np.radians(0.3), 10.0**0.5
# Degrees of freedom of the slopes' Student-t: jumps and shadows are far off.
FREEDOM = 4.0
# Rounds of reweighting, and at most so many iterations of BFGS in each.
ROUNDS, STEPS = 3, 15
# Least c, as a part of its median: of normals that face away it is negative.
LEAST_TOWARD = 0.05


@dataclass(frozen=True, eq=False)
class Problem:
    """What a matrix A is judged by, on the P pixels of a level's mask.

    directions (P, 3) of b, unit length; known (P,) where there is one; rays (P, 3) at depth 1
    gradient : sparse (2 P, P), u and v in turn; focal (2,) pixels; sensor : sparse (M, P) K
    target, precision : (M,) log depth, and 1 / variance of it
    """

    directions: Floats
    known: Mask
    rays: Floats
    gradient: Any
    focal: Floats
    sensor: Any
    target: Floats
    precision: Floats

    @classmethod
    def of(cls, level: Level, normals: Floats, known: Mask) -> Problem:
        """normals (h, w, 3) scaled, known : (h, w)."""
        mask, camera = level.mask, level.photographs.camera
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        unit = normals / np.maximum(length, np.finfo(float).tiny)
        count = np.count_nonzero(mask)
        sensor = eye_array(count).tocsr()
        if level.averaging is not None:
            sensor = level.averaging.matrix(mask)
        return cls(
            unit[mask], known[mask], rays_of(level)[mask], Links.of(level.grid).gradient.tocsr(),
            np.array([camera.fx, camera.fy]), sensor,
            sensor @ level.aim[mask], level.sensor_weight,
        )  # fmt: skip

    @cached_property
    def counts(self) -> tuple[float, float]:
        """N_g and N_s: how many independent slopes, and depths, there are."""
        return 2 * np.count_nonzero(self.known) / CORRELATED_PX, len(self.known) / CORRELATED_PX

    def misfit(self, log_depth: Floats) -> float:
        """sum (K p - z)^2 / sigma^2 of log depth (P,)."""
        return float(self.precision @ (self.sensor @ log_depth - self.target) ** 2)

    def slopes(self, A: Floats) -> tuple[Floats, Floats]:
        """(P, 2) gradients g of log depth under A, and c (P,)."""
        normals = self.directions @ A.T
        toward = -np.sum(normals * self.rays, axis=1)
        toward = np.maximum(toward, LEAST_TOWARD * float(np.median(np.abs(toward))))
        return normals[:, :2] / self.focal / toward[:, None], toward


@dataclass(frozen=True, eq=False)
class Weighted:
    """A problem with weights under which the surface is a linear function of slopes.

    slope : (P,) weight of f^2 |G p - g|^2; sensor : of (K p - z)^2 / sigma^2
    """

    problem: Problem
    slope: Floats
    sensor: float

    @cached_property
    def _factor(self) -> Any:
        given, along = self.problem, diags_array(self._along)
        data = diags_array(self.sensor * given.precision)
        matrix = given.gradient.T @ along @ given.gradient
        matrix = matrix + given.sensor.T @ data @ given.sensor
        # a part that neither slopes nor sensor reach leaves the matrix singular
        matrix = matrix + 1e-9 * float(matrix.diagonal().mean()) * eye_array(len(given.known))
        return factorised(matrix.tocsc())

    @cached_property
    def _along(self) -> Floats:
        return (self.slope[:, None] * self.problem.focal**2).ravel()

    def surface(self, slopes: Floats) -> tuple[Floats, Floats]:
        """(P,) log depth p with slopes (P, 2) nearest to those, and G p - g (P, 2)."""
        given = self.problem
        right = given.gradient.T @ (self._along * slopes.ravel())
        right += given.sensor.T @ (self.sensor * given.precision * given.target)
        log_depth = self._factor.solve(right)
        return log_depth, (given.gradient @ log_depth).reshape(-1, 2) - slopes

    def cost(self, flat: Floats) -> tuple[float, Floats]:
        """The sums under these weights for A, flat (9,), and their derivatives (9,).

        p is the best for every A: its own change does not count (the envelope theorem).
        """
        given, A = self.problem, flat.reshape(3, 3)
        slopes, toward = given.slopes(A)
        log_depth, off = self.surface(slopes)
        share = given.counts[0] / np.count_nonzero(given.known) * given.known
        volume = np.linalg.slogdet(A)[1] - 3 * np.log(toward)
        value = float(self._along @ off.ravel() ** 2 + self.sensor * given.misfit(log_depth))
        by_slopes = -2 * self.slope[:, None] * given.focal**2 * off
        by_toward = (3 * share - np.sum(by_slopes * slopes, axis=1)) / toward
        by_normals = -by_toward[:, None] * given.rays
        by_normals[:, :2] += by_slopes / given.focal / toward[:, None]
        derivative = by_normals.T @ given.directions - share.sum() * np.linalg.inv(A).T
        return value - float(share @ volume), derivative.ravel()


@dataclass(frozen=True, eq=False)
class Candidate:
    """A matrix A with its surface (P,) of log depth, and what it costs."""

    A: Floats
    log_depth: Floats
    cost: float


def factored_start(level: Level) -> tuple[Floats, Lamps] | None:
    """(h, w) log depth and white distant lamps that explain the photographs and fit the sensor.

    None where the photographs have no rank three, as under lamps in one plane.
    """
    mask = level.photographs.active
    light = level.photographs.light(mask)
    usable = (light >= 0).all(axis=-1)
    values = np.where(usable, light.mean(axis=-1), 0.0)
    lit = usable & (values > SHADOW * values.max(axis=0))
    known = scatter(lit.sum(axis=0) >= 3, mask) > 0
    if not has_gradient(known).any():
        return None
    try:
        factors = factorise(values, lit, LdrPs())
        problem = Problem.of(level, scatter(factors.normals, mask), known)
        found = [descended(problem, A) for A in matrices(level, factors, known)]
        best = min((each for each in found if np.isfinite(each.cost)), key=lambda each: each.cost)
        vector = factors.lamps @ np.linalg.inv(best.A)
    except (np.linalg.LinAlgError, RuntimeError, ValueError):  # singular
        return None
    vector /= max(float(np.median(np.linalg.norm(vector, axis=1))), np.finfo(float).tiny)
    if not (np.isfinite(vector).all() and np.isfinite(best.log_depth).all()):
        return None
    log_depth = level.prior.copy()
    log_depth[level.mask] = best.log_depth
    return log_depth, Lamps.distant(vector[:, None], np.zeros((len(vector), 1)))


def matrices(level: Level, factors: Factors, known: Mask) -> Iterator[Floats]:
    """Matrices A to begin with, and each mirrored.

    By regression of the prior's normals on b: errors of the prior's average out.  And the one that
    makes the field integrable, its bas-relief by regression of slopes.
    """
    mask, camera = level.photographs.active, level.photographs.camera
    inside = known[mask]
    scaled, normals = factors.normals[inside], prior_normals(level)[known]
    unit = scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-30)
    starts = [np.linalg.lstsq(unit, normals, rcond=None)[0].T]
    basis = integrable_basis(factors.normals, mask, known, camera)
    with suppress(np.linalg.LinAlgError):  # no slope
        starts.append(relief_of_slopes(scaled @ basis.T, normals).T @ basis)
    for A in starts:
        if not abs(np.linalg.det(A)) > 1e-12 * np.linalg.norm(A) ** 3:
            continue
        m = unit @ A.T
        facing = A if np.median(m[:, 2]) < 0 else -A
        mean = (unit @ facing.T).mean(axis=0)
        u, v = 2 * mean[:2] / mean[2]
        yield facing
        yield np.array([[-1.0, 0.0, u], [0.0, -1.0, v], [0.0, 0.0, 1.0]]) @ facing


def descended(problem: Problem, A: Floats) -> Candidate:
    """The local minimum that BFGS finds from A, the weights estimated again after each round."""
    from scipy.optimize import minimize

    count = np.count_nonzero(problem.known)
    A = A / np.cbrt(abs(np.linalg.det(A)))
    slopes, sensor = problem.counts
    weighted = Weighted(
        problem, slopes / (2 * count * FIRST_SLOPE_RAD**2) * problem.known,
        sensor / (FIRST_SENSOR**2 * len(problem.target)),
    )  # fmt: skip
    for _ in range(ROUNDS):
        A = minimize(
            weighted.cost, A.ravel(), jac=True, method="BFGS", options={"maxiter": STEPS}
        ).x.reshape(3, 3)
        A /= np.cbrt(abs(np.linalg.det(A)))
        weighted = reweighted(weighted, A)
    log_depth, off = weighted.surface(problem.slopes(A)[0])
    return Candidate(A, log_depth, comparable_cost(problem, A, log_depth, off))


def reweighted(weighted: Weighted, A: Floats) -> Weighted:
    """The weights, estimated again from the residuals at A."""
    problem = weighted.problem
    log_depth, off = weighted.surface(problem.slopes(A)[0])
    square = ((off * problem.focal) ** 2).sum(axis=1)
    middle = float(np.median(square[problem.known])) / (2 * np.log(2))
    weight = problem.known / (1 + square / (FREEDOM * max(middle, LEAST_SLOPE_RAD**2)))
    least = 2 * np.count_nonzero(problem.known) * LEAST_SLOPE_RAD**2
    slopes, sensor = problem.counts
    return Weighted(
        problem, slopes / (float(weight @ square) + least) * weight,
        sensor / (problem.misfit(log_depth) + len(problem.target)),
    )  # fmt: skip


def comparable_cost(problem: Problem, A: Floats, log_depth: Floats, off: Floats) -> float:
    """The cost of A with both standard deviations estimated at A, so that matrices compare.

    log_depth (P,), off (P, 2) : the surface of A, and what its slopes are off those of A
    """
    square = ((off * problem.focal) ** 2).sum(axis=1)[problem.known]
    scale = max(float(np.median(square)) / (2 * np.log(2)), LEAST_SLOPE_RAD**2)
    tails = np.mean(0.5 * (FREEDOM + 2) * np.log1p(square / (FREEDOM * scale))) + np.log(scale)
    _, toward = problem.slopes(A)
    volume = np.linalg.slogdet(A)[1] - 3 * float(np.mean(np.log(toward[problem.known])))
    slopes, sensor = problem.counts
    misfit = np.log1p(problem.misfit(log_depth) / len(problem.target))
    return float(slopes * (tails - volume) + sensor * misfit)
