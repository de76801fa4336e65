"""How much figures that scatter speak for one of two signs.

Where a mistake turns the sign of a figure, the two hypotheses are means of mu and of -mu, and mu is
not known.  With errors of unknown variance the likelihoods at their maxima have the ratio

    log L = K/2 log(1 + t^2 / (K - 1)),   t = mean / (deviation / sqrt(K))           (Student's t)

K independent figures: sectors or blocks of the image that are as large as the errors' correlation,
for single pixels err together and would be counted many times.
"""

from __future__ import annotations

import numpy as np

from rakelight.model import Array, Floats, Mask

# Prior probability that a capture is wrong in one given way.  Of how captures are really made
# nothing was measured; a tenth of it changes the bounds below by 2.3.
PRIOR = 0.01
# Least log-likelihood ratio for a posterior probability of 1/2: a warning; and of 99 %: a refusal.
LIKELY = float(np.log((1 - PRIOR) / PRIOR))
SURELY = LIKELY + float(np.log(99))
# Fewest figures whose scatter is a variance.
FEWEST = 4
# Blocks along the object's side.  Errors of depth sensors are correlated over up to a third of the
# object in random captures; of `depth_orientation`, 4 blocks find a tenth less than 6, with 8 a
# ring counts as turned (draws 3000 to 3099).
BLOCKS = 6
# Relative scatter that is no smaller in images of single precision.
ROUNDING = 1e-6


def log_likelihood_ratio(figures: Floats, weights: Floats | None = None) -> float:
    """For a mean above 0 against one as far below it, of figures (K,) with weights (K,).

    NaN is no figure; 0 for fewer than `FEWEST`.

    >>> round(log_likelihood_ratio(np.array([1.0, 2.0, 1.0, 2.0, 1.5, 1.5])), 1)
    8.0
    >>> log_likelihood_ratio(np.array([1.0, -1.0, 1.0, -1.0]))
    0.0
    """
    there = np.isfinite(figures)
    count = int(np.count_nonzero(there))
    if count < FEWEST:
        return 0.0
    share = np.ones(count) if weights is None else weights[there]
    share = share / share.sum()
    mean = float(share @ figures[there])
    variance = count / (count - 1) * float(np.sum((share * (figures[there] - mean)) ** 2))
    # Figures that are all the same, as of depth that somebody invented, scatter by rounding.
    squared_t = 1 / max(variance / mean**2, ROUNDING**2) if mean else 0.0
    return float(np.sign(mean) * count / 2 * np.log1p(squared_t / (count - 1)))


def block_of(where: Mask) -> Array:
    """(P,) the number, from 0, of the block that each of the pixels `where` (h, w) lies in.

    >>> block_of(np.ones((12, 12), bool)).max()
    np.int64(35)
    """
    rows, columns = np.nonzero(where)
    side = max(float(np.sqrt(len(rows))) / BLOCKS, 1.0)
    number = (rows // side) * where.shape[1] + columns // side
    return np.asarray(np.unique(number, return_inverse=True)[1])


def evidence_in_blocks(figures: Floats, where: Mask) -> float:
    """`log_likelihood_ratio` of figures (P,), one for each of the pixels `where` (h, w)."""
    block = block_of(where)
    pixels = np.bincount(block).astype(np.float64)
    return log_likelihood_ratio(np.bincount(block, figures) / pixels, pixels)
