"""Lamps to start from, of the prior's normals, and the bas-relief that its slopes tell.

Descent needs lamps that are roughly right.  Normals of the prior give them where it shows the
object's relief; where noise hides that, the photographs do (factored_start.py).
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.levels import Level
from rakelight.model import Floats
from rakelight.photometry.images import Lamps
from rakelight.photometry.lighting import estimate_light
from rakelight.solve.robust import CAUCHY

# Pixels with normals nearer to the picture plane than this say nothing of their slope.
LEAST_FACING = 0.1
ROBUST_ROUNDS = 12


def lamps_of_prior(level: Level) -> Lamps:
    """White distant lamps that fit the prior's normals and a plain object of mean colour.

    No ambient light: of what is the same on all normals, nobody knows what is the lamp's.
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
    # What noise of the normals makes look like ambient light comes from the camera's side.
    vector = lights[:, None, :3] + lights[:, None, 3:] * frontal
    return Lamps.distant(vector, np.zeros((len(lights), 1)))


def relief_of_slopes(scaled: Floats, normals: Floats) -> Floats:
    """G (3, 3), a bas-relief transform with G^T b the nearest to the normals, up to lengths.

    scaled : b (P, 3); normals : (P, 3)

    Of G = [[1, 0, 0], [0, 1, 0], [mu, nu, lambda]] the slopes n_1/n_3 and n_2/n_3 are those of b
    over lambda, and an offset: a regression, in which noise of the normals averages out.  Raises
    LinAlgError where there is none.

    >>> normals = np.array([[0.1, 0.0, -1.0], [0.0, 0.2, -1.0], [-0.3, 0.1, -1.0]])
    >>> G = np.array([[1, 0, 0], [0, 1, 0], [0.2, -0.1, 0.5]])
    >>> relief_of_slopes(normals @ np.linalg.inv(G), normals).round(6).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.2, -0.1, 0.5]]
    """
    facing = np.abs(scaled[:, 2]) > LEAST_FACING * np.linalg.norm(scaled, axis=1)
    if not facing.any():
        raise np.linalg.LinAlgError("no slopes")
    slopes, aims = (each[facing, :2] / each[facing, 2:] for each in (scaled, normals))
    weight = np.ones(len(slopes))
    for _ in range(ROBUST_ROUNDS):
        middle, aim = (weight @ each / weight.sum() for each in (slopes, aims))
        moved, wanted = slopes - middle, aims - aim
        square = float(weight @ (moved**2).sum(axis=1))
        steepness = float(weight @ (moved * wanted).sum(axis=1)) / max(square, 1e-30)
        off = np.linalg.norm(wanted - steepness * moved, axis=1)
        weight = 1 / (1 + (off / (CAUCHY * np.median(off) + 1e-12)) ** 2)
    if not abs(steepness) > 1e-9:
        raise np.linalg.LinAlgError("no slope")
    mu, nu = (aim - steepness * middle) / steepness
    return np.array([[1, 0, 0], [0, 1, 0], [mu, nu, 1 / steepness]])


def prior_normals(level: Level) -> Floats:
    """(h, w, 3) normals of the prior."""
    gradient = level.surface(level.prior).gradient
    camera = level.photographs.camera
    return normals_from_gradient(gradient[..., 0], gradient[..., 1], camera)[0]
