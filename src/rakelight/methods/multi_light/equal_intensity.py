"""The equal-intensity term: lights of one lamp have about the same intensity.

Distant lights leave the bas-relief transform of the surface open, and a transform changes their
intensities differently: if one lamp took all photographs from the same distance, the right surface
is the one under which they are equal (Hayakawa 1994).  Whether it did is inferred: let the
logarithms of the intensities of N lights be normal with unknown variance.  Their mean and three
numbers of a bas-relief transform are free, so minus twice the log-likelihood is, but for a
constant,  (N - 4) log(variance).  Its gradient is large where intensities are nearly equal, and
small where they differ or are few.
"""

from __future__ import annotations

import numpy as np

from rakelight.methods.base import DARK
from rakelight.model import Floats, Mask
from rakelight.photometry.images import LightParameters

# Degrees of freedom that are not evidence: the mean of the intensities and three numbers of a
# bas-relief transform (ablation.md: halved 0.92, doubled 1.15).
GAUGE_FREEDOM = 4
# Least standard deviation of log intensity: photographs do not determine intensity better
# (ablation.md: halved 1.07, doubled 1.05).
LEAST_LOG_SIGMA = 0.005


def equal_intensity_energy(vectors: Floats) -> float:
    """(N - 4) log(variance) of the log intensities of the N lights that are not dark; 0 up to 4.

    vectors : (N, C, 3), as in `LightParameters`

    >>> equal = np.full((8, 1, 3), 1.0)
    >>> differing = np.arange(1, 9)[:, None, None] * equal
    >>> equal_intensity_energy(equal) < equal_intensity_energy(differing)
    True
    """
    deviation, reaching = _deviations(vectors)
    variance = float((deviation**2).sum()) / max(int(np.count_nonzero(reaching)), 1)
    return float(_degrees_of_freedom(reaching) * np.log(variance + LEAST_LOG_SIGMA**2))


def equal_intensity_derivatives(lights: LightParameters, parameters: int) -> tuple[Floats, Floats]:
    """(K,) half the first and (K, K) half the second derivatives of the energy, Gauss-Newton's.

    parameters : number of each light's parameters, the vector's three first; K counts all
    """
    count, channels = lights.ambient.shape
    deviation, reaching = _deviations(lights.vector)
    count_reaching = max(int(np.count_nonzero(reaching)), 1)
    weight = (
        _degrees_of_freedom(reaching)
        / count_reaching
        / ((deviation**2).sum() / count_reaching + LEAST_LOG_SIGMA**2)
    )
    mean = lights.vector.mean(axis=1)
    # Of the logarithm of |mean over the channels|.
    along = mean / np.maximum((mean**2).sum(axis=-1, keepdims=True), np.finfo(float).tiny)
    own = np.zeros((count, count, channels, parameters))
    each = np.flatnonzero(reaching)
    own[each, each, :, :3] = along[each, None] / channels
    slopes = own.reshape(count, -1)[each]
    slopes -= slopes.sum(axis=0) / count_reaching
    return weight * deviation[each] @ slopes, weight * slopes.T @ slopes


def _degrees_of_freedom(reaching: Mask) -> int:
    """N - 4, the degrees of freedom of the variance, or 0."""
    return max(int(np.count_nonzero(reaching)) - GAUGE_FREEDOM, 0)


def _deviations(vectors: Floats) -> tuple[Floats, Mask]:
    """(N,) log intensities less their mean, and which lights reach the object.

    0 for those that do not.
    """
    size = np.linalg.norm(vectors.mean(axis=1), axis=-1)
    reaching = size >= DARK * max(float(np.median(size)), np.finfo(float).tiny)
    log = np.log(np.where(reaching, size, 1.0))
    deviation = np.where(reaching, log - log.sum() / max(np.count_nonzero(reaching), 1), 0.0)
    return deviation, reaching
