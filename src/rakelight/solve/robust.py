"""Robust losses: how far an observation may be off before it counts less."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats

# The Cauchy loss s^2 log(1 + (r/s)^2) is 95 % efficient on Gaussian noise of deviation s / 2.385.
CAUCHY = 2.385
MEAN_ABSOLUTE_TO_SIGMA = float(np.sqrt(np.pi / 2))


def cauchy_scales(spread: float, misfit: Floats) -> Floats:
    """The Cauchy scale of each pixel (h, w) from the residuals' spread and its own misfit (h, w).

    An outlier is a photograph that disagrees with the pixel's others.  Where all disagree with
    the surface, the surface is wrong: the scale grows with the pixel's mean absolute residual,
    the loss is quadratic there and pulls.  One scale for all would let such pixels go, and the
    surface would crack along them.

    >>> cauchy_scales(0.01, np.array([[0.0, 0.08]])).round(3).tolist()
    [[0.024, 0.239]]
    """
    return np.asarray(CAUCHY * np.maximum(max(spread, 1e-5), MEAN_ABSOLUTE_TO_SIGMA * misfit))


def variance_beyond(noise: float, misfit: Floats) -> Floats:
    """(...) the variance of residuals that exceeds the noise's, from mean absolute ones.

    noise : standard deviation of a value; misfit : (...) mean absolute residuals

    >>> variance_beyond(0.01, np.array([0.001, 0.1])).round(4).tolist()
    [0.0, 0.0156]
    """
    return np.asarray(np.maximum((MEAN_ABSOLUTE_TO_SIGMA * misfit) ** 2 - noise**2, 0.0))
