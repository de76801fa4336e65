"""The ratio equations of one photograph under three coloured lamps (the paper's 3.3).

    (I_c - rho_c phi_c) rho_d l_d . m = (I_d - rho_d phi_d) rho_c l_c . m

for every pair c, d of channels: the length of n = m / |m| cancels in the ratio, which leaves an
equation that is linear in the gradient of log depth.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rakelight.geometry.normals import gradient_directions
from rakelight.model import Camera, Floats, Mask
from rakelight.solve.robust import CAUCHY

PAIRS = tuple(combinations(range(3), 2))
# Three pairs of three channels are worth two independent equations.
PAIR_SHARE = 2 / 3
# Below this part of its lamp a channel is in the lamp's own shadow: its ratios say nothing.
SHADOW = 0.05
# The neighbourhood over which equations have to agree, and what their disagreement counts.
AGREE_PX, DISAGREEMENT = 4.0, 3.0


@dataclass(frozen=True, slots=True)
class Ratios:
    """The equations q . m = 0 of all pairs of channels.

    q : (3, h, w, 3), a pair's noise being `noise` (white is 1) times |slope . n|
    slope : (3, 2, h, w, 3) what a pair's two intensities are multiplied by, without m
    usable : (h, w, 3), which values of the photograph say something; light : (3, 4) the lamps
    """

    q: Floats
    slope: Floats
    usable: Mask
    light: Floats
    noise: float

    @classmethod
    def of(cls, image: Floats, usable: Mask, noise: float, albedo: Floats, light: Floats) -> Ratios:
        """The equations of a photograph (h, w, 3), an albedo (h, w, 3) and lamps (3, 4)."""
        lamp = image - albedo * light[:, 3]
        slopes = [(albedo[..., d, None] * light[d, :3], albedo[..., c, None] * light[c, :3])
                  for c, d in PAIRS]  # fmt: skip
        q = [
            lamp[..., c, None] * one - lamp[..., d, None] * other
            for (c, d), (one, other) in zip(PAIRS, slopes, strict=True)
        ]
        return cls(np.array(q), np.array(slopes), usable, light, noise)

    def misfit(self, normals: Floats) -> tuple[Floats, Mask]:
        """Squared noise (3, h, w) of q . n, and where both channels see their lamps."""
        spread = (np.einsum("abhwk,hwk->abhw", self.slope, normals) ** 2).sum(axis=1)
        variance = np.maximum(spread, 1e-4) * self.noise**2
        strength = np.linalg.norm(self.light[:, :3], axis=-1)
        lit = (normals @ self.light[:, :3].T > SHADOW * strength) & self.usable
        return variance, np.stack([lit[..., c] & lit[..., d] for c, d in PAIRS])

    def energy(self, normals: Floats) -> float:
        """Mean Cauchy loss of the equations in units of their noise."""
        variance, lit = self.misfit(normals)
        squares = along(self.q, normals)[lit] ** 2 / variance[lit]
        return float(np.log1p(squares / CAUCHY**2).mean()) if squares.size else 0.0

    def terms(
        self, normals: Floats, length: Floats, camera: Camera, doubt: bool
    ) -> tuple[Floats, Floats]:
        """Tensor (h, w, 3) and vector (h, w, 2) of the gradient of log depth, as `assemble` takes.

        normals, length : (h, w, 3) and (h, w) of a surface, which fix the equations' noise
        doubt : whether equations that this surface does not meet count less: one by one (Cauchy),
            and all where those around disagree
        """
        from scipy.ndimage import gaussian_filter

        variance, lit = self.misfit(normals)
        weight = np.where(lit, PAIR_SHARE / (variance * length**2), 0.0)
        if doubt:
            squares = np.where(lit, along(self.q, normals) ** 2 / variance, 0.0)
            around = gaussian_filter(squares.sum(axis=0), AGREE_PX)
            around /= np.maximum(gaussian_filter(lit.sum(axis=0).astype(float), AGREE_PX), 1e-6)
            worse = np.maximum(1.0, DISAGREEMENT * around)
            weight /= worse * (1 + squares / worse / CAUCHY**2)
        u, v = gradient_directions(camera)
        j_u, j_v = along(self.q, u), along(self.q, v)
        tensor = np.stack([(weight * a).sum(axis=0) for a in (j_u**2, j_u * j_v, j_v**2)], axis=-1)
        q_2 = weight * self.q[..., 2]
        return tensor, np.stack([(q_2 * j).sum(axis=0) for j in (j_u, j_v)], axis=-1)


def along(q: Floats, directions: Floats) -> Floats:
    """q . direction, (3, h, w), of q (3, h, w, 3) and directions (h, w, 3)."""
    return np.asarray(np.einsum("ahwk,hwk->ahw", q, directions))
