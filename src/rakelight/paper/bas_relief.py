"""The bas-relief transformation that brings a surface's normals closest to the truth."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats, Mask

ROUNDS = 10


def bas_relief_aligned(normals: Floats, truth_normals: Floats, mask: Mask) -> Floats:
    """`normals` (H, W, 3) after the bas-relief that fits `truth_normals` best over `mask`.

    n' ~ (n_x + mu n_z, n_y + nu n_z, lambda n_z), for the mu, nu, lambda with the least sum of
    squared sines of the angles to the truth: what is left is not bas-relief.  NaN stays.

    >>> flat = np.array([[[0.6, 0.0, -0.8], [0.0, 0.0, -1.0], [0.0, 0.6, -0.8], [-0.6, 0, -0.8]]])
    >>> deep = flat * [1.0, 1.0, 0.5]
    >>> deep /= np.linalg.norm(deep, axis=-1, keepdims=True)
    >>> bool(np.allclose(bas_relief_aligned(flat, deep, np.ones((1, 4), bool)), deep))
    True
    """
    chosen = mask & np.isfinite(normals).all(axis=-1) & np.isfinite(truth_normals).all(axis=-1)
    n, t = normals[chosen].astype(float), truth_normals[chosen].astype(float)
    still = np.cross(n * [1.0, 1.0, 0.0], t)
    moved = np.stack([np.cross(np.eye(3)[k] * n[:, 2:], t) for k in range(3)], axis=-1)
    G = np.eye(3)
    for _ in range(ROUNDS):  # |G n| lagged: the sine is |G n x t| / |G n|
        weight = 1 / np.linalg.norm(n @ G.T, axis=1)
        A = (moved * weight[:, None, None]).reshape(-1, 3)
        G[:, 2] = np.linalg.lstsq(A, -(still * weight[:, None]).ravel(), rcond=None)[0]
    aligned = normals @ G.T
    return np.asarray(aligned / np.linalg.norm(aligned, axis=-1, keepdims=True))
