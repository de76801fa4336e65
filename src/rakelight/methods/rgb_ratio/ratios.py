"""The ratio equations of one photograph under three coloured lights (the paper's 3.3).

    (I_c - rho_c phi_c) rho_d l_d . m = (I_d - rho_d phi_d) rho_c l_c . m,    in short q . m = 0

for every pair c, d of channels: the length of n = m / |m| cancels in the ratio, which leaves an
equation that is linear in the gradient of log depth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rakelight.jit import in_parts
from rakelight.model import Camera, Floats, Mask
from rakelight.solve.robust import CAUCHY

# Standard deviation, pixels, of the window in which squared residuals are averaged; factor of that
# mean in the variance of the equations.
AGREE_PX, DISAGREEMENT = 4.0, 3.0


@dataclass(frozen=True, slots=True)
class Ratios:
    """The equations of all pairs of channels, red-green, red-blue and green-blue.

    image : (h, w, 3) linear light; usable : (h, w, 3) which values depend on a normal
    noise : of the image's values; albedo : (h, w, 3)
    light : (h, w, 3, 4) that arrives at each pixel, phi last
    """

    image: Floats
    usable: Mask
    noise: float
    albedo: Floats
    light: Floats

    @property
    def _arrays(self) -> tuple[Any, ...]:
        """In the one memory layout that the kernels are compiled for."""
        image, albedo, light = (
            np.ascontiguousarray(each, np.float64) for each in (self.image, self.albedo, self.light)
        )
        return image, np.ascontiguousarray(self.usable), albedo, light, float(self.noise)

    def squares(self, normals: Floats) -> Floats:
        """(h, w, 3) squared residuals of normals (h, w, 3) in units of the photograph's noise.

        NaN where a channel of the pair is in shadow or not usable.
        """
        from rakelight.methods.rgb_ratio import _kernels

        out = np.empty(self.image.shape)
        given = (*self._arrays, np.ascontiguousarray(normals, np.float64), out)
        in_parts(_kernels.ratio_squares, 0, len(out), out[..., 0].size, *given)
        return out

    def energy(self, normals: Floats) -> float:
        """Mean Cauchy loss of the equations in units of their noise."""
        squares = self.squares(normals)
        squares = squares[np.isfinite(squares)]
        return float(np.log1p(squares / CAUCHY**2).mean()) if squares.size else 0.0

    def terms(
        self, normals: Floats, length: Floats, camera: Camera, robust: bool
    ) -> tuple[Floats, Floats]:
        """Tensor (h, w, 3) and vector (h, w, 2) of the gradient of log depth, as `assemble` takes.

        normals, length : (h, w, 3) and (h, w) of a surface, which fix the equations' noise
        robust : whether equations with large residuals at this surface have less weight: one by one
            (Cauchy), and all where the mean around them is large
        """
        from rakelight.methods.rgb_ratio import _kernels

        variance_factor = np.ones(length.shape)
        if robust:
            variance_factor = np.maximum(
                variance_factor, DISAGREEMENT * averaged(self.squares(normals))
            )
        tensor, rhs = np.zeros((*length.shape, 3)), np.zeros((*length.shape, 2))
        optics = (camera.fx, camera.fy, camera.cx, camera.cy)
        surface = (np.ascontiguousarray(normals, np.float64), np.ascontiguousarray(length))
        cauchy = CAUCHY if robust else 0.0
        given = (*self._arrays, *surface, optics, variance_factor, cauchy, tensor, rhs)
        in_parts(_kernels.ratio_terms, 0, len(length), length.size, *given)
        return tensor, rhs


def averaged(squares: Floats) -> Floats:
    """(h, w) mean of the finite `squares` (h, w, 3) around each pixel."""
    from scipy.ndimage import gaussian_filter

    there = np.isfinite(squares)
    total = gaussian_filter(np.where(there, squares, 0.0).sum(axis=-1), AGREE_PX)
    count = gaussian_filter(there.sum(axis=-1).astype(float), AGREE_PX)
    return np.asarray(total / np.maximum(count, 1e-6))
