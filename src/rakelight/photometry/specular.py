"""Highlights, which a glossy surface adds to equation (3): white on every paint.

A lamp that arrives at a point as s adds

    |s| sum_e k_e max(0, n . h)^e

(Blinn 1977), h being halfway between the lamp and the camera.  A few lobes of fixed exponents e
make up most materials' highlight; how high each is, the photographs tell.
"""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats

# Each lobe is half as wide as the one before: 24, 12 and 6 degrees at half its height.
EXPONENTS = (8, 32, 128)
# Pixels with residuals beyond so many times the median count less.
ORDINARY = 2.0
ROUNDS = 4
TINY = 1e-12


def lobes(normals: Floats, points_m: Floats, arriving: Floats) -> Floats:
    """(E, N, P, C) the highlights of unit height: |s| max(0, n . h)^e for every exponent.

    normals, points_m : (P, 3) camera frame; arriving : (N, P, C, 3) light vectors s at the points

    >>> mirror = np.array([[0.0, 0.0, -1.0]])
    >>> lobes(mirror, -mirror, np.array([0.0, 0.0, -2.0]).reshape(1, 1, 1, 3)).ravel().tolist()
    [2.0, 2.0, 2.0]
    """
    strength = np.linalg.norm(arriving, axis=-1)
    toward = arriving / np.maximum(strength, TINY)[..., None]
    camera = -points_m / np.linalg.norm(points_m, axis=-1, keepdims=True)
    halfway = toward + camera[:, None]
    along, facing = (
        np.maximum(np.einsum("npck,pk->npc", way, normals), 0) for way in (halfway, toward)
    )
    cosine = along / np.maximum(np.linalg.norm(halfway, axis=-1), TINY)
    # `EXPONENTS` by squaring: the eighth power, then fourth powers of the one before.
    power = np.square(np.square(np.square(cosine))) * (facing > 0)
    found = [strength * power]
    for _ in EXPONENTS[1:]:
        power = np.square(np.square(power))
        found.append(strength * power)
    return np.stack(found)


def lobe_coefficients(
    values: Floats, normals: Floats, arriving: Floats, ambient: Floats, unit: Floats
) -> tuple[Floats, float]:
    """(E,) the lobes' heights, none below 0, and the part of squared residuals that they explain.

    values : (N, P, 3) linear light, negative where it does not count
    normals : (P, 3); arriving : (N, P, C, 3); ambient : (N, C); unit : (E, N, P, C) `lobes`

    Each pixel's albedo and normal are free (to first order): what they explain of a lobe says
    nothing of its height.  Least squares; pixels that nothing explains count less.
    """
    usable, (count, pixels) = values >= 0, values.shape[:2]
    dot = np.einsum("npck,pk->npc", arriving, normals)
    shading = np.maximum(dot, 0) + ambient[:, None]
    tangents = np.linalg.svd(normals[:, None])[2][:, 1:]
    shading_by_normal = np.einsum("npck,ptk->tnpc", arriving, tangents) * (dot > 0)

    def of_pixels(each: Floats) -> Floats:
        """(P, N 3) of (N, P, C or 3), 0 where no value counts."""
        whole = np.where(usable, np.broadcast_to(each, values.shape), 0.0)
        return whole.transpose(1, 0, 2).reshape(pixels, count * 3)

    albedo = (usable * shading * values).sum(axis=0)
    albedo /= np.maximum((usable * shading**2).sum(axis=0), TINY)
    # What is free at each pixel: three channels' albedo, and two turns of the normal.
    channels = np.eye(3)[:, None, None, :]
    own = [of_pixels(shading * channel) for channel in channels]
    own += [of_pixels(albedo * by_tangent) for by_tangent in shading_by_normal]
    free = np.stack(own, axis=-1)
    observed = np.stack([of_pixels(each) for each in (*unit, values)], axis=-1)
    # Lobes and values less what these explain.
    matrix = free.swapaxes(1, 2) @ free
    trace = np.trace(matrix, axis1=1, axis2=2)[:, None, None]
    matrix += (1e-9 * trace + TINY) * np.eye(free.shape[-1])
    observed -= free @ np.linalg.solve(matrix, free.swapaxes(1, 2) @ observed)
    lobe, left = observed[..., :-1], observed[..., -1]
    weight = np.ones(pixels)
    for _ in range(ROUNDS):
        coefficients = _least_squares(lobe, left, weight)
        residual = np.square(left - lobe @ coefficients).mean(axis=1)
        weight = 1 / (1 + residual / max(ORDINARY**2 * float(np.median(residual)), TINY))
    before, after = float(weight @ np.square(left).mean(axis=1)), float(weight @ residual)
    return coefficients, (before - after) / max(before, TINY)


def _least_squares(lobe: Floats, left: Floats, weight: Floats) -> Floats:
    """(E,) non-negative heights of lobes (P, V, E) that explain `left` (P, V) best."""
    from scipy.optimize import nnls

    root = np.sqrt(weight)[:, None]
    columns = (lobe * root[..., None]).reshape(-1, lobe.shape[-1])
    matrix, rhs = columns.T @ columns, columns.T @ (left * root).ravel()
    matrix += (1e-9 * np.trace(matrix) + TINY) * np.eye(len(matrix))
    lower = np.linalg.cholesky(matrix)
    return np.asarray(nnls(lower.T, np.linalg.solve(lower, rhs))[0])
