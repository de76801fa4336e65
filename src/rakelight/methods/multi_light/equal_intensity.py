"""The equal-intensity term: lights of one lamp have about the same intensity.

Distant lights leave the bas-relief transform of the surface open, and a transform changes their
intensities differently: if one lamp took all photographs from the same distance, the right surface
is the one under which they are equal (Hayakawa 1994).  Whether it did is inferred: let the
logarithms of the intensities of N lights be normal with unknown variance.  Their mean and three
numbers of a bas-relief transform are free, so minus twice the log-likelihood is, but for a
constant,  (N - 4) log(variance).  Its gradient is large where intensities are nearly equal, and
small where they differ or are few.  An intensity is what a photograph shows of the lamp over its
exposure, where a camera changed that.
"""

from __future__ import annotations

import numpy as np

from rakelight.methods.base import DARK
from rakelight.model import Array, Floats
from rakelight.photometry.images import LightParameters

# Degrees of freedom that are not evidence: the mean of the intensities and three numbers of a
# bas-relief transform (ablation.md: halved 0.92, doubled 1.15).
GAUGE_FREEDOM = 4
# Least standard deviation of log intensity: photographs do not determine intensity better
# (ablation.md: halved 0.99, doubled 1.01).
LEAST_LOG_SIGMA = 0.005


def equal_intensity_energy(vectors: Floats, exposures: Floats | None = None) -> float:
    """(N - 4) log(variance) of the log intensities of the N lights that are not dark; 0 up to 4.

    vectors : (N, C, 3), as in `LightParameters`; exposures : (N,), as in `Photographs`

    >>> equal = np.full((8, 1, 3), 1.0)
    >>> differing = np.arange(1, 9)[:, None, None] * equal
    >>> equal_intensity_energy(equal) < equal_intensity_energy(differing)
    True
    """
    return equal_intensity_slope(vectors, exposures)[0]


def equal_intensity_slope(vectors: Floats, exposures: Floats | None = None) -> tuple[float, Floats]:
    """`equal_intensity_energy`, and its (N, 3) derivatives with each vector's mean over channels.

    Arguments as there.
    """
    deviation, each, freedom, variance = _log_intensities(vectors, exposures)
    weight = 2 * freedom / max(len(each), 1) / variance
    return float(freedom * np.log(variance)), weight * deviation[:, None] * _along(vectors)


def equal_intensity_derivatives(
    lights: LightParameters, parameters: int, exposures: Floats | None = None
) -> tuple[Floats, Floats]:
    """(K,) half the first and (K, K) half the second derivatives of the energy, Gauss-Newton's.

    parameters : number of each light's parameters, the vector's three first; K counts all
    exposures : (N,), as in `Photographs`
    """
    count, channels = lights.ambient.shape
    deviation, each, freedom, variance = _log_intensities(lights.vector, exposures)
    weight = freedom / max(len(each), 1) / variance
    along = _along(lights.vector)
    own = np.zeros((count, count, channels, parameters))
    own[each, each, :, :3] = along[each, None] / channels
    slopes = own.reshape(count, -1)[each]
    slopes -= slopes.sum(axis=0) / max(len(each), 1)
    return weight * deviation[each] @ slopes, weight * slopes.T @ slopes


def _along(vectors: Floats) -> Floats:
    """(N, 3) derivatives of the log intensity of each light with its vector's mean."""
    mean = vectors.mean(axis=1)
    length2 = np.maximum((mean**2).sum(axis=-1, keepdims=True), np.finfo(float).tiny)
    return np.asarray(mean / length2)


def intensities(vectors: Floats, exposures: Floats | None = None) -> Floats:
    """(N,) the lights' intensities; arguments as of `equal_intensity_energy`."""
    size = np.linalg.norm(vectors.mean(axis=1), axis=-1)
    return np.asarray(size if exposures is None else size / exposures)


def _log_intensities(vectors: Floats, exposures: Floats | None) -> tuple[Floats, Array, int, float]:
    """(N,) log intensities less their mean; which lights count; N - 4, if above 0; the variance.

    Lights that do not reach the object do not count: 0.
    """
    size = intensities(vectors, exposures)
    reaching = size >= DARK * max(float(np.median(size)), np.finfo(float).tiny)
    log, each = np.log(np.where(reaching, size, 1.0)), np.flatnonzero(reaching)
    count = max(len(each), 1)
    deviation = np.where(reaching, log - log.sum() / count, 0.0)
    variance = float((deviation**2).sum()) / count + LEAST_LOG_SIGMA**2
    return deviation, each, max(len(each) - GAUGE_FREEDOM, 0), variance
