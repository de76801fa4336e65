"""The albedo of each pixel from all photographs, by least squares, without a regulariser."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats, Mask


class AlbedoFit:
    """Sums over photographs from which the albedo (P, C) follows.

    Minimises sum_i w_i (rho a_i - I_i)^2 per pixel and channel, a_i the shading of photograph i.

    >>> fit = AlbedoFit(pixels=1)
    >>> fit.add(np.array([[0.2, 0.4, 0.6]]), np.array([2.0]), np.ones((1, 3)))
    >>> fit.albedo().tolist()
    [[0.1, 0.2, 0.3]]
    """

    def __init__(self, pixels: int, channels: int = 3) -> None:
        self._products = np.zeros((pixels, channels))
        self._squares = np.zeros((pixels, channels))

    def add(self, image: Floats, shading: Floats, weight: Floats | Mask) -> None:
        """Take in one photograph: image (P, C), shading (P,), weight (P, C)."""
        self._products += weight * shading[:, None] * image
        self._squares += weight * shading[:, None] ** 2

    def albedo(self) -> Floats:
        """(P, C); 0 where no photograph showed the pixel."""
        return np.asarray(self._products / np.maximum(self._squares, 1e-12))
