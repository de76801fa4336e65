# mypy: disable-error-code="no-untyped-def"
"""The loops over pixels behind methods/rgb_ratio/ratios.py, compiled on first use."""

from __future__ import annotations

import numpy as np

from rakelight.jit import helper, kernel

# Weight of an equation: the three pairs of channels are only two independent ones.
PAIR_SHARE = 2.0 / 3.0
# Least cosine between normal and light: with less the pixel is in attached shadow, without ratios.
SHADOW = 0.05
# Least sum of (rho l . n)^2 of a pair in the equation's variance: no equation is exact.
DIMMEST = 1e-4


@helper
def seen(light, usable, normal, shade):
    """Fill shade (3) with l . n of the channels, NaN where one is not usable."""
    for c in range(3):
        x, y, z = light[c, 0], light[c, 1], light[c, 2]
        shade[c] = x * normal[0] + y * normal[1] + z * normal[2]
        if not usable[c] or shade[c] <= SHADOW * np.sqrt(x * x + y * y + z * z):
            shade[c] = np.nan


@kernel
def ratio_squares(first_row, last_row, image, usable, albedo, light, noise, normals, out):
    """out (h, w, 3): (q . n)^2 of every pair of channels in units of its variance, or NaN."""
    width = image.shape[1]
    for row in range(first_row, last_row):
        shade = np.empty(3)
        for column in range(width):
            s = light[row, column]
            seen(s, usable[row, column], normals[row, column], shade)
            rho, I = albedo[row, column], image[row, column]  # noqa: E741
            for pair in range(3):
                c, d = pair // 2, 2 - (2 - pair) // 2
                one, other = rho[d] * shade[d], rho[c] * shade[c]
                q_n = (I[c] - rho[c] * s[c, 3]) * one - (I[d] - rho[d] * s[d, 3]) * other
                variance = max(one * one + other * other, DIMMEST) * noise * noise
                out[row, column, pair] = q_n * q_n / variance


@kernel
def ratio_terms(
    first_row, last_row, image, usable, albedo, light, noise, normals, length, optics,
    variance_factor, cauchy, tensor, rhs,
):  # fmt: skip
    """Sums over the pairs: tensor (h, w, 3) and rhs (h, w, 2) of the gradient of log depth.

    variance_factor : (h, w) of every variance; cauchy : scale of the loss, 0 for squares
    """
    width = image.shape[1]
    fx, fy, cx, cy = optics
    for row in range(first_row, last_row):
        shade, along_u, along_v = np.empty(3), np.empty(3), np.empty(3)
        for column in range(width):
            s = light[row, column]
            seen(s, usable[row, column], normals[row, column], shade)
            rho, I = albedo[row, column], image[row, column]  # noqa: E741
            for c in range(3):
                along_u[c] = fx * s[c, 0] - (column - cx) * s[c, 2]
                along_v[c] = fy * s[c, 1] - (row - cy) * s[c, 2]
            for pair in range(3):
                c, d = pair // 2, 2 - (2 - pair) // 2
                one, other = rho[d] * shade[d], rho[c] * shade[c]
                variance = max(one * one + other * other, DIMMEST) * noise * noise
                if not np.isfinite(variance):
                    continue
                variance *= variance_factor[row, column]
                first = (I[c] - rho[c] * s[c, 3]) * rho[d]
                second = (I[d] - rho[d] * s[d, 3]) * rho[c]
                q_n = first * shade[d] - second * shade[c]
                weight = PAIR_SHARE / (variance * length[row, column] ** 2)
                if cauchy > 0.0:
                    weight /= 1.0 + q_n * q_n / (variance * cauchy * cauchy)
                j_u = first * along_u[d] - second * along_u[c]
                j_v = first * along_v[d] - second * along_v[c]
                q_z = first * s[d, 2] - second * s[c, 2]
                tensor[row, column, 0] += weight * j_u * j_u
                tensor[row, column, 1] += weight * j_u * j_v
                tensor[row, column, 2] += weight * j_v * j_v
                rhs[row, column, 0] += weight * j_u * q_z
                rhs[row, column, 1] += weight * j_v * q_z
