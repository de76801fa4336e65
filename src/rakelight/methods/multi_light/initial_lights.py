"""Lights to start from, fitted to the prior's normals, and the bas-relief transform of its slopes.

The descent needs lights that are roughly right.  The prior's normals give them where they show the
object's relief; where noise hides it, the photographs do (factored_start.py).
"""

from __future__ import annotations

import numpy as np

from rakelight.methods.base import DARK
from rakelight.methods.levels import Level
from rakelight.model import TINY, Floats, GivenLights
from rakelight.photometry.images import LightParameters
from rakelight.photometry.lighting import estimate_light
from rakelight.solve.robust import CAUCHY, NOTABLE, ROUNDS


def lights_of_prior(level: Level) -> LightParameters:
    """White distant lights that fit the prior's normals and an albedo of the median colour.

    Without ambient light: the part that is the same on all normals may belong to either.
    """
    values, colour, normals = _seen(level)
    albedo, facing = np.broadcast_to(colour, values[0].shape), normals.mean(axis=0)
    facing /= np.linalg.norm(facing)
    lights = np.array(
        [
            estimate_light(np.maximum(value, 0.0), value >= 0, albedo, normals, facing)
            for value in values
        ]
    )
    # Noise of the normals makes light along their mean look like ambient light.
    vector = lights[:, None, :3] + lights[:, None, 3:] * facing
    return LightParameters.distant(vector, np.zeros((len(lights), 1)))


def lights_of_given(level: Level, given: GivenLights) -> LightParameters:
    """White lights at the given places, or coloured ones where the given intensities differ so.

    Intensities that are not given fit the prior's normals and an albedo of the median colour.
    """
    directions, scale = np.asarray(given.directions), np.ones(len(given))
    if given.positions_m is not None:
        away = given.positions_m - level.middle_m
        scale = 1 / np.maximum(np.linalg.norm(away, axis=1), np.finfo(float).tiny)
        directions = away * scale[:, None]
    if given.intensities is None:
        intensity = _intensities(level, directions)[:, None]
    else:
        intensity = given.intensities.reshape(len(given), -1)
        intensity = intensity * scale[:, None] ** 2
        intensity = intensity / np.median(intensity, axis=0)
        if level.photographs.exposures is not None:
            intensity = intensity * level.photographs.exposures[:, None]
        if np.allclose(intensity, intensity[:, :1]):
            intensity = intensity.mean(axis=1, keepdims=True)
    vector, nothing = directions[:, None] * intensity[..., None], np.zeros_like(intensity)
    if given.positions_m is None:
        return LightParameters.distant(vector, nothing)
    return LightParameters(vector, nothing, nothing + scale[:, None])


def _intensities(level: Level, directions: Floats) -> Floats:
    """(N,) least-squares intensities of lights in given directions (N, 3), their median 1."""
    values, colour, normals = _seen(level)
    shading = np.maximum(normals @ directions.T, 0.0).T[..., None] * colour
    good = values >= 0
    products, squares = ((good * shading * each).sum(axis=(1, 2)) for each in (values, shading))
    found = products / np.maximum(squares, np.finfo(float).tiny)
    middle = max(float(np.median(found)), np.finfo(float).tiny)
    # Without any intensity a light would have no direction.
    return np.asarray(np.maximum(found / middle, DARK))


def _seen(level: Level) -> tuple[Floats, Floats, Floats]:
    """Light (N, P, 3) of pixels that have any, its median colour (3,), the prior's normals (P, 3).

    All pixels with a normal where none has a usable value.
    """
    active = level.photographs.active
    values, normals = level.photographs.light(active), level.normals(level.prior)[0][active]
    some = (values >= 0).any(axis=(0, 2))
    if some.any():
        values, normals = values[:, some], normals[some]
    colour = np.median(np.maximum(values, 0.0).mean(axis=0), axis=0)
    return values, colour, normals


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
    # The slope of a normal at right angles to the view is unbounded.
    facing = np.abs(scaled[:, 2]) > NOTABLE * np.linalg.norm(scaled, axis=1)
    if not facing.any():
        raise np.linalg.LinAlgError("no slopes")
    slopes, targets = (each[facing, :2] / each[facing, 2:] for each in (scaled, normals))
    weight = np.ones(len(slopes))
    for _ in range(ROUNDS):
        middle, target_middle = (weight @ each / weight.sum() for each in (slopes, targets))
        centred, target = slopes - middle, targets - target_middle
        square = float(weight @ (centred**2).sum(axis=1))
        slope_ratio = float(weight @ (centred * target).sum(axis=1)) / max(square, TINY)
        residual = np.linalg.norm(target - slope_ratio * centred, axis=1)
        weight = 1 / (1 + (residual / (CAUCHY * np.median(residual) + 1e-12)) ** 2)
    if not abs(slope_ratio) > 1e-9:
        raise np.linalg.LinAlgError("no slope")
    mu, nu = (target_middle - slope_ratio * middle) / slope_ratio
    return np.array([[1, 0, 0], [0, 1, 0], [mu, nu, 1 / slope_ratio]])
