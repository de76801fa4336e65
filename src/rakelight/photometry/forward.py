"""The forward model: a photograph of a surface with known normals, albedo and light."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats, Lights
from rakelight.photometry.harmonics import shading


def render(normals: Floats, albedo: Floats, lights: Lights, photograph: int) -> Floats:
    """Linear light (P, 3) or (H, W, 3) of one photograph, equation (3) per channel.

    normals, albedo : (..., 3); lights : distant, white or one per channel

    >>> n, rho = np.array([[0.0, 0.0, -1.0]]), np.array([[0.2, 0.4, 0.8]])
    >>> lights = Lights(vector=np.array([[[0.0, 0.0, -0.5]]]), ambient=np.array([[0.5]]))
    >>> render(n, rho, lights, 0).tolist()
    [[0.2, 0.4, 0.8]]
    """
    channels = [
        shading(normals, vector, ambient)
        for vector, ambient in zip(
            lights.vector[photograph], lights.ambient[photograph], strict=True
        )
    ]
    return np.asarray(albedo * np.stack(channels, axis=-1))
