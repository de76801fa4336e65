"""How well a result predicts a photograph that its albedo is not estimated from.

Each photograph is rendered by equation (3) with its own light, the refined relief, and an albedo
that the other photographs alone determine:

    rho_-i = sum_{j != i} a_j I_j / sum_{j != i} a_j^2,    error_i = |rho_-i a_i - I_i|

A relief that is wrong shades differently under every light, and then no albedo fits them all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.model import Array, Floats, Lights, Mask
from rakelight.photometry.forward import shadings
from rakelight.prepare import Prepared

# Pixels in the sample: its medians are good to a few per cent.
MOST_PIXELS = 20_000
LEAST_PHOTOGRAPHS = 3


def prediction_errors(
    prepared: Prepared, depth_m: Floats, normals: Floats, lights: Lights
) -> tuple[float, ...]:
    """Typical error of every photograph's prediction, as a fraction of its mean brightness.

    depth_m, normals : (h, w), (h, w, 3) the refined surface in the prepared window
    lights : of the photographs, the one that is predicted included

    The median over pixels and channels; NaN for a photograph that shows nothing usable, nothing
    at all for fewer than three photographs, or a method that used but one of them.
    """
    if len(prepared) < LEAST_PHOTOGRAPHS or len(lights) != len(prepared):
        return ()
    chosen, images, good = sampled_pixels(prepared, prepared.mask, MOST_PIXELS)
    points = back_project(depth_m, prepared.camera)
    shading = shadings(normals.reshape(-1, 3)[chosen], points.reshape(-1, 3)[chosen], lights)
    return leave_one_out(images, good, shading)


def sampled_pixels(prepared: Prepared, where: Mask, most: int) -> tuple[Array, Floats, Mask]:
    """Indices (P,) of about `most` pixels of a mask (h, w), evenly spaced, and their values.

    The indices count the window's pixels row by row; values : (N, P, 3) linear light, and which of
    it is usable
    """
    chosen = np.flatnonzero(where)
    chosen = chosen[:: max(1, -(-len(chosen) // most))]
    sampled = np.zeros_like(prepared.mask)
    sampled.flat[chosen] = True
    sample = replace(prepared, mask=sampled)
    images, good = zip(*(sample.pixels(i) for i in range(len(prepared))), strict=True)
    return chosen, np.stack(images), np.stack(good)


def leave_one_out(images: Floats, good: Mask, shading: Floats) -> tuple[float, ...]:
    """Error of every photograph (N, P, 3) from the others' albedo; good (N, P, 3): usable values.

    >>> shading = np.array([1.0, 2.0, 3.0])[:, None, None]
    >>> leave_one_out(0.1 * shading + np.zeros((3, 4, 3)), np.ones((3, 4, 3), bool), shading)
    (0.0, 0.0, 0.0)
    """
    squares, products = good * shading**2, good * shading * images
    all_squares, all_products = squares.sum(axis=0), products.sum(axis=0)
    errors = []
    for i in range(len(images)):
        others_squares = all_squares - squares[i]
        determined = good[i] & (others_squares > 1e-12)
        albedo = np.divide(
            all_products - products[i],
            others_squares,
            out=np.zeros_like(others_squares),
            where=determined,
        )
        error = np.abs(albedo * shading[i] - images[i])[determined]
        mean = float(images[i][determined].mean()) if determined.any() else 0.0
        errors.append(round(float(np.median(error)) / mean, 9) if mean > 0 else float("nan"))
    return tuple(errors)
