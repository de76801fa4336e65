"""The three lamps of one photograph: their lights, and how far away they are.

LEDs stand around the camera, at about one distance d from the object's middle.  Each channel's lamp
is brighter on the side of the object that is nearer to it, which a distant light takes for a slope.
With X from the middle, and l the direction of a light s, the light that arrives at X is

    s(X) = (d / |d l - X|)^3 (s - X |s| / d)

A distance that is given leaves s . n linear in s but for l, which is that of the round before.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import has_gradient
from rakelight.methods.levels import Level
from rakelight.model import MAD_TO_SIGMA, Floats, Lights
from rakelight.photometry.forward import arriving
from rakelight.photometry.lighting import estimate_light
from rakelight.solve.robust import CAUCHY, ROUNDS

# Step of the inverse distance times the object's radius, by which shadings are differentiated.
STEP = 1e-3


def arriving_lights(level: Level, light: Floats, inverse_distance: float) -> Floats:
    """(h, w, 3, 4) lights that arrive at each pixel, of those (3, 4) at the object's middle.

    Outside the mask the ambient part alone.
    inverse_distance : of the lamps from the middle, 1/metre; 0 for distant ones
    """
    there = np.zeros((*level.mask.shape, 3, 4))
    points_m = level.points[level.mask] + level.middle_m
    there[level.mask, :, :3] = arriving(as_lights(level, light, inverse_distance), points_m)[0]
    there[..., 3] = light[:, 3]
    return there


def as_lights(level: Level, light: Floats, inverse_distance: float) -> Lights:
    """The lights (3, 4) as a result has them, one photograph's."""
    vector, ambient = light[None, :, :3], light[None, :, 3]
    if inverse_distance == 0:
        return Lights(vector, ambient)
    toward = np.array([direction(each) for each in light[:, :3]])
    position_m = level.middle_m + toward[None] / inverse_distance
    return Lights(vector, ambient, position_m, level.middle_m)


def direction(vector: Floats) -> Floats:
    """(3,) unit vector of a light; towards the camera where it is 0."""
    size = float(np.linalg.norm(vector))
    return vector / size if size > 0 else np.array([0.0, 0.0, -1.0])


def shading_by(there: Floats, normals: Floats) -> Floats:
    """(h, w, 3) shading of normals (h, w, 3) by lights that arrive (h, w, 3, 4)."""
    cosine = np.einsum("hwck,hwk->hwc", there[..., :3], normals)
    return np.asarray(np.maximum(cosine, 0) + there[..., 3])


def lights_step(
    level: Level, normals: Floats, albedo: Floats, before: Floats, inverse_distance: float
) -> Floats:
    """1. Each channel's light (3, 4), rho and n fixed."""
    seen = has_gradient(level.links)
    image, rho = level.image[seen], albedo[seen]
    weight = level.shaded[seen].astype(np.float64)
    points, normals = level.points[seen], normals[seen]
    return np.array(
        [
            estimate_light(
                image[:, c, None], weight[:, c, None], rho[:, c, None],
                effective_normals(normals, points, light, inverse_distance), light[:3],
            )
            for c, light in enumerate(before)
        ]
    )  # fmt: skip


def effective_normals(
    normals: Floats, points: Floats, light: Floats, inverse_distance: float
) -> Floats:
    """(P, 3) vectors whose products with a light (4,) are its shading s(X) . n at P points."""
    away, toward = inverse_distance * points, direction(light[:3])
    falloff = np.linalg.norm(toward - away, axis=1, keepdims=True) ** -3
    across = np.sum(away * normals, axis=1, keepdims=True)
    return np.asarray(falloff * (normals - across * toward))


def distance_step(
    level: Level, normals: Floats, albedo: Floats, light: Floats, inverse_distance: float
) -> float:
    """The lamps' inverse distance after one robust step, rho and n fixed, lights (3, 4) free.

    From 0 to that of a lamp at the object's outline.  By the logarithms of the values over what is
    predicted, less what a change of their channel's light explains of them.
    """
    radius_m = level.radius_m
    step = STEP / radius_m
    now, then = (
        shading_by(arriving_lights(level, light, each), normals)
        for each in (inverse_distance, inverse_distance + step)
    )
    good = level.shaded & (now > light[:, 3]) & (then > light[:, 3]) & (level.image > 0)
    slopes, errors = [np.zeros(0)], [np.zeros(0)]
    for c in range(3):
        here = good[..., c]
        seen = now[here, c]
        own = effective_normals(normals[here], level.points[here], light[c], inverse_distance)
        basis = np.column_stack([own, np.ones(len(own))]) / seen[:, None]
        error = np.log(level.image[here, c] / (albedo[here, c] * seen))
        slope = np.log(then[here, c] / seen) / step
        for found, each in ((errors, error), (slopes, slope)):
            found.append(each - basis @ np.linalg.lstsq(basis, each, rcond=None)[0])
    slope, error = np.concatenate(slopes), np.concatenate(errors)
    if not slope.any():
        return inverse_distance
    change, weight = 0.0, np.ones(error.size)
    for _ in range(ROUNDS):
        change = float((weight * slope) @ error / ((weight * slope) @ slope))
        residual = error - change * slope
        scale = CAUCHY * max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), 1e-6)
        weight = 1 / (1 + (residual / scale) ** 2)
    return float(np.clip(inverse_distance + change, 0.0, 1 / radius_m))
