"""Lamps to start from: those of the prior's normals, or of the photographs' rank.

Descent needs lamps that are roughly right.  Normals of the prior give them where it shows the
object's relief.  Where noise hides that, the photographs do: under distant lamps their values have
rank three, and that the normals are those of one surface leaves the bas-relief of its factors open
(ldr_ps.py), which even a rough prior tells.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import has_gradient
from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.estimate import scatter
from rakelight.methods.ldr_ps import Options, factorise, integrable_basis
from rakelight.methods.levels import Level
from rakelight.model import Floats
from rakelight.shading.lighting import estimate_light
from rakelight.shading.photographs import Lamps
from rakelight.solve.robust import CAUCHY

# A value below this part of its pixel's brightest is in shadow, which rank three does not hold.
SHADOW = 0.2
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


def lamps_of_factors(level: Level) -> Lamps | None:
    """White distant lamps from the photographs alone, their bas-relief from the prior's slopes.

    None where the photographs have no rank three, as under lamps in one plane.
    """
    mask, camera = level.photographs.active, level.photographs.camera
    light = level.photographs.light(mask)
    usable = (light >= 0).all(axis=-1)
    values = np.where(usable, light.mean(axis=-1), 0.0)
    lit = usable & (values > SHADOW * values.max(axis=0))
    known = scatter(lit.sum(axis=0) >= 3, mask) > 0
    if not has_gradient(known).any():
        return None
    try:
        factors = factorise(values, lit, Options())
        factors = factors.changed(integrable_basis(factors.normals, mask, known, camera))
        G = relief_of_slopes(factors.normals[known[mask]], prior_normals(level)[known])
        factors = factors.changed(G.T)
    except np.linalg.LinAlgError:
        return None
    # As bright as a plain object of the photographs' mean colour needs.
    bright = np.median(np.linalg.norm(factors.normals[known[mask]], axis=1))
    vector = factors.lamps * bright / np.median(values.mean(axis=0)[known[mask]])
    if np.median(factors.normals[:, 2]) > 0:
        vector = -vector
    if not np.isfinite(vector).all():
        return None
    return Lamps.distant(vector[:, None], np.zeros((len(vector), 1)))


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
