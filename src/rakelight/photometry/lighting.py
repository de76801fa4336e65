"""The lights of the photographs from normals and albedo, by least squares."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats, Lights, Mask
from rakelight.photometry.forward import lit

# Rounds of least squares: the set of lit pixels depends on the light.
HORIZON_ROUNDS = 3


def frontal_lights(count: int) -> Lights:
    """`count` white lights of unit intensity at the camera, no ambient light: the paper's start.

    >>> frontal_lights(2).vector[:, 0].tolist()
    [[0.0, 0.0, -1.0], [0.0, 0.0, -1.0]]
    """
    vector = np.zeros((count, 1, 3))
    vector[..., 2] = -1.0
    return Lights(vector=vector, ambient=np.zeros((count, 1)))


def estimate_light(
    image: Floats,
    weight: Floats | Mask,
    albedo: Floats,
    normals: Floats,
    start: Floats | None = None,
) -> Floats:
    """Least-squares light (s_x, s_y, s_z, phi) of one photograph.

    image, albedo : (P, C) linear light and albedo; weight : (P, C), 0 leaves a value out
    normals : (P, 3)
    start : (3,) a light vector that says which pixels are lit at first; None for first-order
        harmonics without attached shadows, whose phi may have any sign; else it is at least 0

    Minimises sum_c sum_p w (rho_c (max(0, s.n) + phi) - I_c)^2, equation (3) over all channels;
    without a start, s.n takes the place of max(0, s.n).
    Where the pixels do not determine the light, it is of minimum norm.

    >>> rng = np.random.default_rng(0)
    >>> n = rng.normal(size=(99, 3)); n /= np.linalg.norm(n, axis=1, keepdims=True)
    >>> image = (np.maximum(n @ [0.1, 0.2, -0.9], 0) + 0.05)[:, None]
    >>> start = np.array([0.0, 0.0, -1.0])
    >>> estimate_light(image, np.ones((99, 1)), np.ones((99, 1)), n, start).round(3).tolist()
    [0.1, 0.2, -0.9, 0.05]
    """
    squares = (weight * albedo**2).sum(axis=1)
    products = (weight * albedo * image).sum(axis=1)
    basis = np.vstack([normals.T, np.ones(len(normals))])
    if start is None:
        return _least_squares((basis * squares) @ basis.T, basis @ products)
    vector, ambient = start, 0.0
    for _ in range(HORIZON_ROUNDS):
        # In attached shadow there is the ambient light alone.
        seen = lit(normals, vector)
        matrix, rhs = (basis * (squares * seen)) @ basis.T, basis @ (products * seen)
        matrix[3, 3], rhs[3] = squares.sum(), products.sum()
        light = without_negative_ambient(matrix, rhs)
        vector, ambient = light[:3], light[3]
    return np.append(vector, ambient)


def without_negative_ambient(matrix: Floats, rhs: Floats) -> Floats:
    """The light (s_x, s_y, s_z, phi) of these normal equations, (4, 4) and (4,); phi at least 0.

    Where the pixels do not determine it, of minimum norm.
    """
    light = _least_squares(matrix, rhs)
    if light[3] < 0:
        light = np.append(_least_squares(matrix[:3, :3], rhs[:3]), 0.0)
    return light


def _least_squares(matrix: Floats, rhs: Floats) -> Floats:
    return np.asarray(np.linalg.lstsq(matrix, rhs, rcond=1e-9)[0])
