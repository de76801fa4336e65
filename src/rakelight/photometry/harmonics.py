"""First-order spherical harmonics with attached shadows: the paper's equation (3).

A surface with normal n under light (s, phi) has the shading  max(0, s . n) + phi:  where the
light is below the surface's own horizon, only the ambient light phi is left.
"""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats, Mask


def lit(normals: Floats, vector: Floats) -> Mask:
    """Where the light is above the horizon: normals (P, 3), light vector (3,) -> (P,) bool.

    >>> lit(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]), np.array([0.0, 0.0, -2.0])).tolist()
    [True, False]
    """
    return np.asarray(normals @ vector > 0)


def shading(normals: Floats, vector: Floats, ambient: float | Floats) -> Floats:
    """Shading (P,) of unit normals (P, 3) under the light `vector` (3,) and `ambient`.

    >>> shading(np.array([[0.0, 0.0, -1.0]]), np.array([0.0, 0.0, -2.0]), 0.5).tolist()
    [2.5]
    """
    return np.asarray(np.maximum(normals @ vector, 0) + ambient)
