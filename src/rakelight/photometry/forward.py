"""The forward model, equation (3): what light a surface sends to the camera, and its albedo.

    I_ic = rho_c (max(0, s_i . n) + phi_i (1 + d . n))

for photograph i and channel c: a surface with normal n under light s_i and ambient light phi_i; d,
the side that more of it comes from, is 0 in the paper.
Where the light is below the surface's own horizon (attached shadow), only phi_i is left.  This is
the plain form; `photometry.images` has the fast one, with derivatives, of whole photographs.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from rakelight.model import Floats, Lights, Mask

# Sum of squared shadings below which a pixel has no light: keeps the albedo there 0.
LEAST_SQUARES = 1e-12


def lit(normals: Floats, vector: Floats) -> Mask:
    """Where the light is above the horizon: normals (P, 3), light vector (3,) -> (P,) bool.

    >>> lit(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]), np.array([0.0, 0.0, -2.0])).tolist()
    [True, False]
    """
    return np.asarray(normals @ vector > 0)


def shading(normals: Floats, vector: Floats, ambient: float | Floats) -> Floats:
    """Shading (P,) of unit normals (P, 3) under the light `vector` (3,) and `ambient`.

    >>> shading(np.array([[0.0, 0.0, -1.0]]), np.array([0.0, 0.0, -2.0]), 0.5).tolist()
    [2.5]
    """
    return np.asarray(np.maximum(normals @ vector, 0) + ambient)


def arriving(lights: Lights, points_m: Floats) -> Floats:
    """(N, P, C, 3) light vectors s at P points, with distance and beam as in `Lights`.

    points_m : (P, 3) camera frame

    >>> points = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
    >>> toward, none, place = np.array([[[0.0, 0.0, -1.0]]]), np.zeros((1, 1)), np.zeros((1, 1, 3))
    >>> arriving(Lights(toward, none, place, middle_m=points[0]), points)[0, :, 0].tolist()
    [[0.0, 0.0, -1.0], [0.0, 0.0, -0.25]]
    """
    if lights.beam is not None and lights.middle_m is not None:
        off, toward = points_m - lights.middle_m, lights.direction
        beam = np.einsum("nck,pk->npc", lights.beam[..., :2], off[:, :2])
        beam += lights.beam[:, None, :, 2] * np.einsum("nck,pk->npc", toward, off) ** 2
        middle_m = None if lights.position_m is None else lights.middle_m
        wide = replace(lights, beam=None, middle_m=middle_m)
        return np.asarray(arriving(wide, points_m) * np.exp(beam)[..., None])
    if lights.position_m is None or lights.middle_m is None:
        shape = (len(lights), len(points_m), *lights.vector.shape[1:])
        return np.broadcast_to(lights.vector[:, None], shape)
    away = lights.position_m[:, None] - points_m[:, None]
    distance = np.linalg.norm(away, axis=-1)
    lamp_distance = np.linalg.norm(lights.position_m - lights.middle_m, axis=-1)
    strength = lights.intensity[:, None] * (lamp_distance[:, None] / distance) ** 2
    return np.asarray(away * (strength / distance)[..., None])


def shadings(normals: Floats, points_m: Floats, lights: Lights) -> Floats:
    """Shading (N, P, C) of P points under every light; near lights fall off from their positions.

    >>> near, far = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 2.0])
    >>> toward, none, place = np.array([[[0.0, 0.0, -1.0]]]), np.zeros((1, 1)), np.zeros((1, 1, 3))
    >>> facing, lights = np.array([[0.0, 0.0, -1.0]] * 2), Lights(toward, none, place, near)
    >>> shadings(facing, np.stack([near, far]), lights)[0, :, 0].tolist()
    [1.0, 0.25]
    """
    cosine = np.einsum("npck,pk->npc", arriving(lights, points_m), normals)
    return np.asarray(np.maximum(cosine, 0) + lights.ambient_on(normals))


def least_squares_albedo(
    photographs: Iterable[tuple[Floats, Mask, Floats]],
) -> tuple[Floats, Floats]:
    """Albedo (P, 3) that explains P pixels' values best, and the squared shadings it rests on.

    photographs : of each the linear light (P, 3), the values that count (P, 3), and the shading
        (P, C), C = 1 for white light

    rho = sum a I / sum a^2 with the shading a, the minimiser of sum (rho a - I)^2; 0 where no value
    counts.

    >>> ones = np.ones((1, 3), bool)
    >>> albedo, squares = least_squares_albedo([(np.full((1, 3), 0.2), ones, np.array([[0.4]])),
    ...                                         (np.full((1, 3), 0.4), ones, np.array([[0.8]]))])
    >>> albedo.round(9).tolist(), squares.round(9).tolist()
    ([[0.5, 0.5, 0.5]], [[0.8, 0.8, 0.8]])
    """
    squares: Floats = np.zeros(())
    products: Floats = np.zeros(())
    for light, counted, shade in photographs:
        squares = squares + counted * shade**2
        products = products + counted * shade * light
    squares = np.maximum(squares, LEAST_SQUARES)
    return products / squares, squares
