"""Lights to start from, fitted to the prior's normals, and the bas-relief transform of its slopes.

The descent needs lights that are roughly right.  The prior's normals give them where they show the
object's relief; where noise hides it, the photographs do (factored_start.py).
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.levels import Level
from rakelight.model import Floats
from rakelight.photometry.images import LightParameters
from rakelight.photometry.lighting import estimate_light
from rakelight.solve.robust import CAUCHY

# Least |n_3| of a normal whose slope is used: near 0 the slope is unbounded (ablation.md: halved
# 1.02, doubled 1.00).
LEAST_FACING = 0.1
# Iterations of reweighted least squares (ablation.md: halved 0.99, doubled 1.00).
ROBUST_ROUNDS = 12


def lights_of_prior(level: Level) -> LightParameters:
    """White distant lights that fit the prior's normals and an albedo of the median colour.

    Without ambient light: the part that is the same on all normals may belong to either.
    """
    photographs = level.photographs
    active = photographs.active
    values = photographs.light(active)
    good = values >= 0
    images = np.maximum(values, 0.0)
    albedo = np.broadcast_to(np.median(images.mean(axis=0), axis=0), images[0].shape)
    normals, frontal = prior_normals(level)[active], np.array([0.0, 0.0, -1.0])
    lights = np.array(
        [
            estimate_light(image, weight, albedo, normals, frontal)
            for image, weight in zip(images, good, strict=True)
        ]
    )
    # Noise of the normals makes light from the camera's side look like ambient light.
    vector = lights[:, None, :3] + lights[:, None, 3:] * frontal
    return LightParameters.distant(vector, np.zeros((len(lights), 1)))


def bas_relief_of_slopes(scaled: Floats, normals: Floats) -> Floats:
    """G (3, 3), a bas-relief transform with G^T b the nearest to the normals, up to lengths.

    scaled : b (P, 3); normals : (P, 3)

    Of G = [[1, 0, 0], [0, 1, 0], [mu, nu, lambda]] the slopes n_1/n_3 and n_2/n_3 are those of b
    over lambda, and an offset: a regression, in which noise of the normals averages out.  Raises
    LinAlgError where there is none.

    >>> normals = np.array([[0.1, 0.0, -1.0], [0.0, 0.2, -1.0], [-0.3, 0.1, -1.0]])
    >>> G = np.array([[1, 0, 0], [0, 1, 0], [0.2, -0.1, 0.5]])
    >>> bas_relief_of_slopes(normals @ np.linalg.inv(G), normals).round(6).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.2, -0.1, 0.5]]
    """
    facing = np.abs(scaled[:, 2]) > LEAST_FACING * np.linalg.norm(scaled, axis=1)
    if not facing.any():
        raise np.linalg.LinAlgError("no slopes")
    slopes, targets = (each[facing, :2] / each[facing, 2:] for each in (scaled, normals))
    weight = np.ones(len(slopes))
    for _ in range(ROBUST_ROUNDS):
        middle, target_middle = (weight @ each / weight.sum() for each in (slopes, targets))
        centred, target = slopes - middle, targets - target_middle
        square = float(weight @ (centred**2).sum(axis=1))
        slope_ratio = float(weight @ (centred * target).sum(axis=1)) / max(square, 1e-30)
        residual = np.linalg.norm(target - slope_ratio * centred, axis=1)
        weight = 1 / (1 + (residual / (CAUCHY * np.median(residual) + 1e-12)) ** 2)
    if not abs(slope_ratio) > 1e-9:
        raise np.linalg.LinAlgError("no slope")
    mu, nu = (target_middle - slope_ratio * middle) / slope_ratio
    return np.array([[1, 0, 0], [0, 1, 0], [mu, nu, 1 / slope_ratio]])


def prior_normals(level: Level) -> Floats:
    """(h, w, 3) normals of the prior."""
    gradient = level.surface(level.prior).gradient
    camera = level.photographs.camera
    return normals_from_gradient(gradient[..., 0], gradient[..., 1], camera)[0]
