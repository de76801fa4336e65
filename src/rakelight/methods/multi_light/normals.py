"""Normals finer than differences of a depth map: one more Gauss-Newton step at each pixel.

Between two pixels a depth map is straight; in a crease the surface is not, and the photographs show
it.  The step moves each pixel's gradient g of log depth by itself, with the lights fixed and the
albedo eliminated:

    d = (M + h)^-1 b       M, b of `Linearization`,  h = sigma^2 / tau^2 |dn/dg|^2

tau is the error of the depth map's normals, radians, estimated locally: noise alone makes b M^-1 b
twice sigma^2 on average, and what exceeds that is due to tau.  Where the depth map's normals fit,
as on smooth surfaces, they stay: they average noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rakelight.geometry.blur import blurred
from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.energy import Fit
from rakelight.model import TINY, Floats
from rakelight.photometry.images import Linearization
from rakelight.solve.robust import variance_beyond

# Standard deviation, pixels, of the Gaussian window in which tau is estimated (5 instead: 1.003
# over 50 draws, but 0.242 instead of 0.226 degrees on a smooth sphere; ablation.md).
LOCAL_PX = 3.0


def fine_normals(level: Level, fit: Fit) -> tuple[Floats, Linearization]:
    """(h, w, 3) unit normals, NaN where photographs have no information, and their linearization.

    A pixel whose residuals the step without damping (h = 0) would enlarge, since it is too long for
    a linear model, keeps the depth map's normal.
    """
    photographs, gradient = level.photographs, fit.surface.gradient

    def linearized(step: Floats) -> Linearization:
        surface = replace(fit.surface, gradient=gradient + step)
        return photographs.linearize(
            surface, fit.lights, scale=fit.scales, start=fit.linearization.albedo
        )

    step = gradient_step(level, fit, linearized)
    u, v = np.moveaxis(gradient + step, -1, 0)
    normals, _ = normals_from_gradient(u, v, photographs.camera)
    normals[~photographs.active] = np.nan
    return normals, linearized(step)


def gradient_step(level: Level, fit: Fit, linearized: Callable[[Floats], Linearization]) -> Floats:
    """(h, w, 2) the correction d of each pixel's gradient of log depth.

    linearized : the photographs' linearization after a correction
    """
    active, dn_dg2 = level.photographs.active, level.squared_normal_derivative(fit.surface)
    (uu, uv, vv), (u, v) = (
        np.moveaxis(each, -1, 0) for each in (fit.linearization.jtwj, fit.linearization.rhs)
    )
    information = np.where(active, uu + vv, 0.0) / dn_dg2
    least = 1e-6 * fit.linearization.typical_information(dn_dg2) * dn_dg2
    free = np.where(active[..., None], _solved(uu + least, uv, vv + least, u, v), 0.0)
    # Residuals that no normal explains: noise, highlights, edges of paint that do not align.
    mean_abs_residual = linearized(free).mean_abs_residual
    noise = fit.noise**2 + variance_beyond(fit.noise, mean_abs_residual)
    excess = blurred(u * free[..., 0] + v * free[..., 1] - 2 * noise, LOCAL_PX, active)
    # tau^2, radians squared: the covariance of b is  M M tau^2 + M sigma^2.
    variance = np.maximum(excess, 0) / np.maximum(blurred(information, LOCAL_PX, active), TINY)
    damping = noise * dn_dg2 / np.maximum(variance, TINY)
    better = active & (mean_abs_residual <= fit.linearization.mean_abs_residual)
    return np.where(better[..., None], _solved(uu + damping, uv, vv + damping, u, v), 0.0)


def _solved(uu: Floats, uv: Floats, vv: Floats, u: Floats, v: Floats) -> Floats:
    """(h, w, 2) of  [[uu, uv], [uv, vv]] x = (u, v)  at each pixel."""
    determinant = np.maximum(uu * vv - uv * uv, TINY)
    return np.stack([vv * u - uv * v, uu * v - uv * u], axis=-1) / determinant[..., None]
