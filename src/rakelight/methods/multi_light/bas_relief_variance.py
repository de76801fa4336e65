"""The uncertainty of the whole surface's shape: of its bas-relief transform.

Photographs under distant lights leave open the g of  1/z' = a/z + g . r,  r being a viewing ray at
depth 1 metre.  Two things determine it: the sensor's depth, and the lights' intensities where they
are equal.  Each may err, and they may contradict each other; both add to the variance of every
normal, though no pixel's own values show it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rakelight.geometry.cells import cell_sums
from rakelight.geometry.derivatives import gradient_image
from rakelight.geometry.normals import normal_derivatives
from rakelight.methods.base import DARK, scatter
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.bas_relief import sensed_columns
from rakelight.methods.multi_light.equal_intensity import (
    GAUGE_FREEDOM,
    LEAST_LOG_SIGMA,
    intensities,
)
from rakelight.methods.multi_light.noise import FEWEST_BLOCKS
from rakelight.model import Floats, Mask
from rakelight.photometry.images import LightParameters
from rakelight.solve.robust import BY_CHANCE

# Least number of lights.  Four numbers are fitted to their intensities, the mean and g; a variance
# from fewer than two more would be chance.
LIGHTS_NEEDED = GAUGE_FREEDOM + 2
# Least spread of the lights along a component of g, metres, that is not rounding.
LEAST_SPREAD_M = 1e-12


def shape_errors(
    level: Level, log_depth: Floats, lights: LightParameters | None
) -> tuple[Floats, Floats]:
    """What the bas-relief transform alone makes uncertain at a refined log depth (h, w).

    The `sensor_moment` (4, 4), and the normals' expected squared error (h, w), radians^2.
    lights : None where their directions are given, which leave nothing but the scale open
    """
    moment = sensor_moment(level, log_depth, scale_only=lights is None)
    of_g = moment[1:, 1:] + (0.0 if lights is None else lights_moment(level, lights))
    normals, length = level.normals(log_depth)
    dn_dg = np.stack(normal_derivatives(normals, length, level.camera), axis=-1)
    # 1/z' = 1/z + g . ray  changes log depth by  -z g . ray.
    changes = np.moveaxis(-np.exp(log_depth)[..., None] * level.rays, -1, 0)
    slopes = np.stack([gradient_image(each, level.grid) for each in changes], axis=-1)
    return moment, quadratic_form(dn_dg @ slopes, of_g)


def quadratic_form(derivatives: Floats, moment: Floats) -> Floats:
    """(h, w) the sum over i of  d_i^T moment d_i,  d_i being derivatives (h, w, I, K).

    moment : (K, K) second moment of what the I numbers depend on; the sum is of their variances

    Where the moment is large and the products cancel, rounding may leave less than 0: that is 0.

    >>> quadratic_form(np.array([[[[3.0, 4.0]]]]), np.eye(2)).tolist()
    [[25.0]]
    """
    variance = np.einsum("hwik,kl,hwil->hw", derivatives, moment, derivatives)
    return np.asarray(np.maximum(variance, 0.0))


def sensor_moment(level: Level, log_depth: Floats, scale_only: bool = False) -> Floats:
    """(4, 4) second moment of a and g, 1/metre, from the sensor, at a log depth (h, w).

    Of their best correction by least squares, with its covariance.  The sensor's errors are
    correlated over an unknown area: the covariance is taken with blocks of pixels as clusters
    (Liang and Zeger 1986), of the size that makes it largest.
    scale_only : g is known, as under lights in given directions, which leave but a open
    """
    columns, measured = sensed_columns(level, log_depth)
    free = slice(0, 1 if scale_only else 4)
    design = columns[:, free] / measured[:, None]
    weight = level.sensor_weight / level.sensor_weight.max()
    error = 1 - design[:, 0]
    inverse = np.linalg.pinv((design * weight[:, None]).T @ design)
    correction = inverse @ ((weight * error) @ design)
    scores = design * (weight * (error - design @ correction))[:, None]
    # As step^T step it is symmetric and nowhere negative, also where the inverse is inaccurate.
    steps = (sums @ inverse for sums in _clustered(scatter(scores, level.seen), level.seen))
    largest = max(
        (step.T @ step for step in steps),
        key=lambda covariance: float(np.trace(covariance[-3:, -3:])),
        default=0.0,
    )
    moment = np.zeros((4, 4))
    moment[free, free] = largest + np.outer(correction, correction)
    return moment


def lights_moment(level: Level, lights: LightParameters) -> Floats:
    """(3, 3) second moment of g, 1/metre, by which the lights' intensities contradict the surface.

    The g that would make the intensities most equal, squared, less what chance makes of that.  Of
    its principal components only those that are not by chance: lights at one tilt say nothing of g
    along the view, which changes all of them alike.  0 for fewer than six lights.
    """
    vector = lights.vector.mean(axis=1)
    size = intensities(lights.vector, level.photographs.exposures)
    reaching = size > DARK * np.median(size)
    if np.count_nonzero(reaching) < LIGHTS_NEEDED:
        return np.zeros((3, 3))
    toward = vector[reaching] / np.linalg.norm(vector[reaching], axis=1, keepdims=True)
    # A transform multiplies lights by (1 + X g^T)^-1, their size by about 1 - (l . X) (g . l).
    design = -(toward @ level.middle_m)[:, None] * toward
    logs = -np.log(size[reaching])
    # Of each principal component of g: what it explains of the intensities, and what chance would.
    left, spread, components = np.linalg.svd(design - design.mean(axis=0), full_matrices=False)
    along = (logs - logs.mean()) @ left
    rest = float(np.square(logs - logs.mean() - left @ along).sum())
    variance = rest / (len(logs) - GAUGE_FREEDOM) + LEAST_LOG_SIGMA**2
    square = along**2
    sure = (square > BY_CHANCE**2 * variance) & (spread > LEAST_SPREAD_M)
    length = np.sqrt(np.where(sure, square - variance, 0.0)) / np.maximum(spread, LEAST_SPREAD_M)
    g = (np.sign(along) * length) @ components
    return np.outer(g, g)


def _clustered(scores: Floats, where: Mask) -> Iterator[Floats]:
    """(K, C) sums of scores (h, w, C) over the K blocks of each size, times root of n / (n - 4).

    n blocks have pixels `where`.  Their sums, of which four numbers are fitted, give a covariance
    without bias so; where only the scale is (C = 1) it is a little too large.
    """
    side = 1
    while (count := np.count_nonzero(cell_sums(where.astype(float), side))) >= FEWEST_BLOCKS:
        sums = cell_sums(scores, side).reshape(-1, scores.shape[-1])
        yield np.sqrt(count / (count - 4)) * sums
        side *= 2
