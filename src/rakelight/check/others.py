"""A photograph as the others explain it: the same paint, outline and relief under other lights.

Under distant lights every photograph of a matte object is a linear combination of four images, its
albedo and that times each coordinate of the normal (Basri & Jacobs 2003), whatever the lights are:
the first principal components of the other photographs span them.  Edges of shading, which come and
go with the light, are part of it; of a photograph that moved or is out of focus they are elsewhere,
or softer, than the combination has them.
"""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.check.evidence import evidence_in_blocks
from rakelight.model import Array, Floats, Mask

# Principal components of the others: ambient light and three directions.
COMPONENTS = 4
# Least square of a component over the largest one's: smaller ones are rounding.
ROUNDING = 1e-6
# Added to squares, lest they be 0: white is 1, of 16 bits a step 2e-10 squared.
TINY = 1e-20


def combination(products: Floats, which: int) -> Floats:
    """(N,) weights of the other images that explain one of N best; 0 for itself.

    products : (N, N) inner products of the images

    >>> images = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 1.0], [1.0, 1.0, 3.0]])
    >>> combination(images @ images.T, 2).round(6).tolist()
    [1.0, 1.0, 0.0]
    """
    return combinations(products, products[:, which : which + 1], which)[:, 0]


def combinations(
    products: Floats, wanted: Floats, which: int, components: int = COMPONENTS
) -> Floats:
    """(N, T) weights of N images but one that explain each of T others best; 0 for the one.

    products : (N, N) inner products of the images; wanted : (N, T) theirs with the others
    components : how many principal components of the images are taken
    """
    others = np.arange(len(products)) != which
    weights = np.zeros(wanted.shape)
    squares, turned = np.linalg.eigh(products[np.ix_(others, others)].astype(np.float64))
    kept = squares > ROUNDING * max(float(squares[-1]), np.finfo(float).tiny)
    kept[:-components] = False
    along = turned[:, kept]
    weights[others] = along @ ((along.T @ wanted[others]) / squares[kept, None])
    return weights


def band(image: Array, fine_px: float, coarse_px: float) -> Array:
    """An image (h, w) blurred by a Gaussian of `fine_px`, less that blurred by `coarse_px`."""
    fine, coarse = (cv2.GaussianBlur(image, (0, 0), sigma) for sigma in (fine_px, coarse_px))
    return np.asarray(fine - coarse)


def better_explained(before: Floats, after: Floats, where: Mask) -> float:
    """Evidence that N images (N, P) explain one another better `after` than `before`.

    The log-likelihood ratio of Gaussian residuals, each over the image's own variance, in blocks of
    the pixels `where` (h, w), P of them (Vuong 1989; see `depth_orientation`).
    """
    return evidence_in_blocks(log_likelihoods(after) - log_likelihoods(before), where)


def log_likelihoods(images: Floats) -> Floats:
    """(P,) log-likelihoods of the pixels of N images (N, P), each explained by the others."""
    products, total = images @ images.T, np.zeros(images.shape[1])
    for i, image in enumerate(images):
        total += log_likelihood(image, images, products, i)
    return total


def log_likelihood(image: Floats, images: Floats, products: Floats, which: int) -> Floats:
    """(P,) log-likelihoods of the pixels of an image that N others (N, P) but one explain.

    products : (N, N) inner products of the others; which : the one of them that does not count
    """
    weights = combinations(products, (images @ image)[:, None], which)[:, 0]
    left = (image - weights @ images) ** 2
    mean, own = float(left.mean()) + TINY, float((image**2).mean()) + TINY
    return np.asarray(-0.5 * (left / mean + np.log(mean / own)))
