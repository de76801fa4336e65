"""How alike the lamps' brightness is, which tells flat from deep where distant lamps do not.

A bas-relief transform of the surface goes with lamps that are brighter here and darker there: if
one lamp took all photographs from the same distance, the right surface is the one under which they
are alike (Hayakawa 1994).  Whether it did is for the photographs to say: let the logarithms of N
lamps' brightness be normal, with a deviation that nobody knows.  Their mean and three numbers of a
bas-relief transform are free, so minus twice the logarithm of the probability is, but for a
constant,  (N - 4) log(deviation^2).  It pulls hard where lamps come out nearly alike, and next to
nothing where they differ, or are too few to tell.
"""

from __future__ import annotations

import numpy as np

from rakelight.methods.base import DARK
from rakelight.model import Floats, Mask
from rakelight.photometry.images import Lamps

# The mean, and what a bas-relief transform makes of the others.
FREE = 4
# Photographs do not tell a lamp's brightness better than this fraction.
LEAST_SPREAD = 0.005


def equal_intensity_energy(vectors: Floats) -> float:
    """(N - 4) log(spread^2) of the brightness of the N lamps that reach the object; 0 up to 4.

    vectors : (N, C, 3), as in `Lamps`

    >>> alike = np.full((8, 1, 3), 1.0)
    >>> differing = np.arange(1, 9)[:, None, None] * alike
    >>> equal_intensity_energy(alike) < equal_intensity_energy(differing)
    True
    """
    off, reaching = _deviations(vectors)
    variance = float((off**2).sum()) / max(int(np.count_nonzero(reaching)), 1)
    return float(_told(reaching) * np.log(variance + LEAST_SPREAD**2))


def equal_intensity_derivatives(lamps: Lamps, parameters: int) -> tuple[Floats, Floats]:
    """(K,) half the first and (K, K) half the second derivatives of the energy, Gauss-Newton's.

    parameters : numbers that may move of each light, the vector's three first; K counts all
    """
    count, channels = lamps.ambient.shape
    off, reaching = _deviations(lamps.vector)
    known = max(int(np.count_nonzero(reaching)), 1)
    weight = _told(reaching) / known / ((off**2).sum() / known + LEAST_SPREAD**2)
    mean = lamps.vector.mean(axis=1)
    # Of the logarithm of |mean over the channels|.
    along = mean / np.maximum((mean**2).sum(axis=-1, keepdims=True), np.finfo(float).tiny)
    own = np.zeros((count, count, channels, parameters))
    each = np.flatnonzero(reaching)
    own[each, each, :, :3] = along[each, None] / channels
    slopes = own.reshape(count, -1)[each]
    slopes -= slopes.sum(axis=0) / known
    return weight * off[each] @ slopes, weight * slopes.T @ slopes


def _told(reaching: Mask) -> int:
    """How many of the lamps say something about the others."""
    return max(int(np.count_nonzero(reaching)) - FREE, 0)


def _deviations(vectors: Floats) -> tuple[Floats, Mask]:
    """(N,) logarithm of each lamp's brightness over their mean, and which reach the object.

    0 for those that do not.
    """
    size = np.linalg.norm(vectors.mean(axis=1), axis=-1)
    reaching = size >= DARK * max(float(np.median(size)), np.finfo(float).tiny)
    log = np.log(np.where(reaching, size, 1.0))
    off = np.where(reaching, log - log.sum() / max(np.count_nonzero(reaching), 1), 0.0)
    return off, reaching
