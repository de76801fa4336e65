"""The Cauchy loss: its scale, and the variance that exceeds the noise's."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats

# Scale s of the Cauchy loss s^2 log(1 + (r/s)^2) in standard deviations: 95 % efficient on Gaussian
# noise (ablation.md: least squares 1.15, halved 1.10, doubled 0.98).
CAUCHY = 2.385
# Rounds of least squares that are reweighted by the last residuals, or whose unknowns take turns;
# steps of the lights alone; the most at a level that is not the last, where to converge gains
# nothing; and those of the start by factorisation, for each number of its matrix (ablation.md:
# halved 1.02, doubled 0.99).
ROUNDS = 3
# Fraction up to which a part of a whole is next to nothing: what residuals lose by another model or
# the next step, what of them lobes explain, what of a value is specular, and how far a normal faces
# the camera (ablation.md: halved 0.99, doubled 1.00).
NOTABLE = 0.05
# Standard deviations up to which a value may be off by chance (ablation.md: halved 0.97,
# doubled 1.00).
BY_CHANCE = 3.0
# Least standard deviation of a value, where the model explains photographs exactly: the rounding
# to 16 bit (white is 1).
SMALLEST_NOISE = 12**-0.5 / 65535
# Standard deviation over mean absolute value, of a normal distribution.
MEAN_ABSOLUTE_TO_SIGMA = float(np.sqrt(np.pi / 2))


def cauchy_scales(noise_sigma: float, mean_abs_residual: Floats) -> Floats:
    """(h, w) the Cauchy scale of each pixel, from the noise and its mean absolute residual (h, w).

    An outlier is a photograph that contradicts the others of its pixel.  Where all contradict the
    surface, the surface is wrong: the scale grows with the mean absolute residual, so that the loss
    is quadratic there and the pixel moves.  With one scale for all pixels such pixels would be
    given up, and the surface would tear along them.

    >>> cauchy_scales(0.01, np.array([[0.0, 0.08]])).round(3).tolist()
    [[0.024, 0.239]]
    """
    return np.asarray(CAUCHY * np.maximum(noise_sigma, MEAN_ABSOLUTE_TO_SIGMA * mean_abs_residual))


def variance_beyond(noise: float, mean_abs_residual: Floats) -> Floats:
    """(...) the variance of residuals that exceeds the noise's, from mean absolute ones.

    noise : standard deviation of a value; mean_abs_residual : (...)

    >>> variance_beyond(0.01, np.array([0.001, 0.1])).round(4).tolist()
    [0.0, 0.0156]
    """
    return np.asarray(np.maximum((MEAN_ABSOLUTE_TO_SIGMA * mean_abs_residual) ** 2 - noise**2, 0.0))
