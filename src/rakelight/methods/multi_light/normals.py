"""Normals finer than differences of a depth map: what each pixel's photographs say beyond those.

Between two pixels a depth map is straight; in a crease the surface is not, and the photographs saw
it.  One more Gauss-Newton step, of each pixel's gradient g of log depth on its own, with the lights
held and the albedo following:

    d = (M + h)^-1 b       M, b of `Explanation`,  h = sigma^2 / tau^2 |dn/dg|^2

tau is by how much the normals of the depth map are off, radians.  It is local, and follows from b:
noise alone makes b M^-1 b twice sigma^2 on average, what exceeds that is the depth map's.  Where
its normals fit, as on smooth surfaces, they stay: they average noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from rakelight.geometry.blur import blurred
from rakelight.geometry.normals import normal_lengths, normals_from_gradient, squared_turn
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.energy import Fit
from rakelight.model import Floats
from rakelight.photometry.images import Explanation
from rakelight.solve.robust import variance_beyond

# Over so many pixels the depth map's error is told from noise.
LOCAL_PX = 3.0
# Residuals beyond the noise count so many times: part of them, all photographs share.
SHARED = 2.0
TINY = 1e-30


def fine_normals(level: Level, fit: Fit) -> tuple[Floats, Explanation]:
    """(h, w, 3) unit normals, NaN where photographs say nothing, and what they explain.

    A pixel that they would explain worse, since the step is too long for a linear model, keeps the
    depth map's.
    """
    photographs, gradient = level.photographs, fit.surface.gradient

    def explained(step: Floats) -> Explanation:
        surface = replace(fit.surface, gradient=gradient + step)
        return photographs.explain(
            surface, fit.lamps, scale=fit.scales, start=fit.explanation.albedo
        )

    step = gradient_step(level, fit, explained)
    u, v = np.moveaxis(gradient + step, -1, 0)
    normals, _ = normals_from_gradient(u, v, photographs.camera)
    normals[~photographs.active] = np.nan
    return normals, explained(step)


def gradient_step(level: Level, fit: Fit, explained: Callable[[Floats], Explanation]) -> Floats:
    """(h, w, 2) the correction d of each pixel's gradient of log depth.

    explained : how a correction explains the photographs
    """
    camera, active = level.photographs.camera, level.photographs.active
    (uu, uv, vv), (u, v) = (
        np.moveaxis(each, -1, 0) for each in (fit.explanation.tensor, fit.explanation.vector)
    )
    gradient = fit.surface.gradient
    length = normal_lengths(gradient[..., 0], gradient[..., 1], camera)
    turn = squared_turn(length, camera)
    knowledge = np.where(active, uu + vv, 0.0) / turn
    least = 1e-6 * float(np.median(knowledge[active])) * turn
    free = np.where(active[..., None], _solved(uu + least, uv, vv + least, u, v), 0.0)
    # What no normal explains is noise, and worse: highlights, paints whose edges do not align.
    left = explained(free).misfit
    noise = fit.noise**2 + SHARED * variance_beyond(fit.noise, left)
    told = blurred(u * free[..., 0] + v * free[..., 1] - 2 * noise, LOCAL_PX, active)
    # A variance of the normal, radians squared: b has  M M tau^2 + M sigma^2.
    variance = np.maximum(told, 0) / np.maximum(blurred(knowledge, LOCAL_PX, active), TINY)
    hold = noise * turn / np.maximum(variance, TINY)
    better = active & (left <= fit.explanation.misfit)
    return np.where(better[..., None], _solved(uu + hold, uv, vv + hold, u, v), 0.0)


def _solved(uu: Floats, uv: Floats, vv: Floats, u: Floats, v: Floats) -> Floats:
    """(h, w, 2) of  [[uu, uv], [uv, vv]] x = (u, v)  at each pixel."""
    determinant = np.maximum(uu * vv - uv * uv, TINY)
    return np.stack([vv * u - uv * v, uu * v - uv * u], axis=-1) / determinant[..., None]
