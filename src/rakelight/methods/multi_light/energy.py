"""A depth and lamps that explain photographs, and the Gauss-Newton steps that improve them.

The energy of log depth p and lights s, albedo eliminated (variable projection):

    E = sum loss(rho_c (max(0, s_i . n) + phi_i) - I_ic)    n from the mean gradient G p, (3)
        + beta sum M_uu (p_uuuu / 8)^2 + M_vv (p_vvvv / 8)^2    against a checkerboard
        + sigma^2 sum w (K (p - p_0))^2                     the sensor's depth
        + sigma^2 W (N - 4) log(spread of |s_i|)^2          lamps of one brightness

Under distant lamps the four numbers of a bas-relief transform are taken from the sensor's depth
(and the lamps' brightness) alone, not from the photographs: `project_bas_relief`.
The mean gradient does not see a checkerboard; fourth differences do, and see little else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.geometry.derivatives import fourth_differences
from rakelight.geometry.grid import Links, mean_gradient_transposed
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.equal_intensity import (
    equal_intensity_derivatives,
    equal_intensity_energy,
)
from rakelight.model import Floats
from rakelight.photometry.images import Explanation, Lamps, Surface
from rakelight.solve import DepthSystem, assemble
from rakelight.solve.levenberg_marquardt import Damping
from rakelight.solve.robust import cauchy_scales

FOURTH_DIFFERENCE = (0.125, -0.5, 0.75, -0.5, 0.125)
# Weight of the fourth differences over the photographs' own of the gradient: a flatter surface
# has less of them, and more would flatten where photographs leave the bas-relief open.
FOURTH_DIFFERENCE_WEIGHT = 0.003
# No photograph is better than this (white is 1), even if the model explains it exactly.
SMALLEST_NOISE = 1e-5
# On the way no photograph is taken for worse: rough residuals would hand the surface to the sensor.
LARGEST_NOISE = 0.01
# Of a depth step: with less damping the step is the same (ablation.md).
LEAST_DEPTH_DAMPING = 1e-3
# The damping of the first steps of the depth, of both, and of the lights.
OF_DEPTH = Damping(LEAST_DEPTH_DAMPING, LEAST_DEPTH_DAMPING)
OF_BOTH, OF_LIGHTS = Damping(1e-3), Damping(1e-2)


@dataclass(frozen=True, slots=True)
class Fit:
    """Log depth (h, w) and lamps at one level, and how they explain the photographs.

    scales : (h, w) of the Cauchy losses; noise : deviation of a value; energy : of everything
    fourth_difference : (2, h, w) an eighth of it along u and v; fourth_difference_weight (2, h, w)
    near : whether the lamps' distances are fitted too
    shared_ambient : whether the ambient light is one part of every lamp's; see `parameter_map`
    equal_intensity_weight : W, of `equal_intensity_energy`: how alike the lamps' brightness is
    depth_damping, joint_damping, lights_damping : of the next step of each kind
    """

    log_depth: Floats
    lamps: Lamps
    surface: Surface
    explanation: Explanation
    scales: Floats
    noise: float
    energy: float
    fourth_difference_weight: Floats
    fourth_difference: Floats
    near: bool = False
    shared_ambient: bool = False
    equal_intensity_weight: float = 0.0
    depth_damping: Damping = OF_DEPTH
    joint_damping: Damping = OF_BOTH
    lights_damping: Damping = OF_LIGHTS


def first_fit(
    level: Level, log_depth: Floats, lamps: Lamps, near: bool = False, shared_ambient: bool = False
) -> Fit:
    """The photographs explained by a depth and lamps; the loss takes its scale from that.

    Twice, with what `descend` does: pixels beside a jump that least squares bends come right.
    """
    surface = level.surface(log_depth)
    plain = level.photographs.explain(surface, lamps)
    nothing = np.zeros((2, *level.mask.shape))
    start = Fit(
        log_depth, lamps, surface, plain, nothing[0], 0.0, 0.0, nothing, nothing,
        near=near, shared_ambient=shared_ambient,
    )  # fmt: skip
    return update_scale(level, start)


def reset_scale(level: Level, fit: Fit, log_depth: Floats | None = None) -> Fit:
    """`first_fit` where a fit led, on other photographs, at another level or under another weight.

    What the fit's loss let go of is not held against another surface.
    log_depth : the fit's, carried to the level; its own unless given
    """
    log_depth = fit.log_depth if log_depth is None else log_depth
    return first_fit(level, log_depth, fit.lamps, fit.near, fit.shared_ambient)


def update_scale(level: Level, fit: Fit, noisiest: float = LARGEST_NOISE) -> Fit:
    """The same depth and lamps with the loss's scales taken from the present residuals."""
    spread_now = max(fit.explanation.spread, SMALLEST_NOISE)
    scales = cauchy_scales(spread_now, fit.explanation.misfit)
    weight = FOURTH_DIFFERENCE_WEIGHT * np.moveaxis(fit.explanation.tensor[..., [0, 2]], -1, 0)
    same = replace(
        fit, scales=scales, noise=min(spread_now, noisiest), fourth_difference_weight=weight
    )
    return evaluated(level, same, fit.log_depth, fit.lamps)


def evaluated(
    level: Level, fit: Fit, log_depth: Floats, lamps: Lamps, turning: bool = False
) -> Fit:
    """The fit at another depth and other lamps, under the same loss; see `explain`."""
    surface = level.surface(log_depth)
    explanation = level.photographs.explain(
        surface, lamps, scale=fit.scales, start=fit.explanation.albedo, turning=turning
    )
    fourth_difference = fourth_difference_term(level, log_depth)
    bending = float(np.vdot(fit.fourth_difference_weight * fourth_difference, fourth_difference))
    alike = fit.equal_intensity_weight * equal_intensity_energy(lamps.vector)
    prior = fit.noise**2 * (level.sensor_misfit(log_depth) + alike)
    energy = explanation.energy + bending + prior
    return replace(
        fit, log_depth=log_depth, lamps=lamps, surface=surface, explanation=explanation,
        energy=energy, fourth_difference=fourth_difference,
    )  # fmt: skip


def fourth_difference_term(level: Level, log_depth: Floats) -> Floats:
    """(2, h, w) an eighth of the fourth difference along u and v, 0 where there is none.

    It sees what the mean gradient does not, a checkerboard, and next to nothing else.  Where a
    pixel in the middle has no normal there is none: the matrix of a step would not hold it.
    """
    return fourth_differences(log_depth, level.grid) / 8


def fourth_difference_term_transposed(level: Level, along: Floats) -> Floats:
    """(h, w) the transpose of `fourth_difference_term`, of an image (2, h, w)."""
    from scipy.ndimage import correlate1d

    total = np.zeros(level.mask.shape)
    for axis, wide, image in zip((1, 0), Links.of(level.grid).fives, along, strict=True):
        total += correlate1d(wide * image, FOURTH_DIFFERENCE, axis, mode="constant")
    return total


def depth_system(level: Level, fit: Fit, tensor: Floats) -> DepthSystem:
    """The normal equations of a correction of log depth, with `tensor` (h, w, 3) for a matrix."""
    sensor = level.sensor_terms(fit.log_depth, fit.noise**2)
    return assemble(
        level.mask, tensor, fit.explanation.vector, pair_weights=level.pairs, **sensor,
    ).plus(-fourth_difference_gradient(level, fit))  # fmt: skip


def fourth_difference_gradient(level: Level, fit: Fit) -> Floats:
    """(h, w) half the derivatives of the fourth differences' energy with log depth."""
    return fourth_difference_term_transposed(
        level, fit.fourth_difference_weight * fit.fourth_difference
    )


def depth_negative_gradient(level: Level, fit: Fit) -> Floats:
    """(h, w) minus half the energy's derivatives with log depth: `depth_system`'s right side."""
    sensor = level.sensor_terms(fit.log_depth, fit.noise**2)
    along = fit.explanation.vector
    shading = mean_gradient_transposed(along[..., 0], along[..., 1], level.grid)
    data = sensor["data_weight"] * sensor["data_target"] + sensor.get("extra_rhs", 0.0)
    return np.asarray(shading + data - fourth_difference_gradient(level, fit))


def light_curvature(
    level: Level, fit: Fit, most: int, mixed: bool = False
) -> tuple[Floats, Floats]:
    """(F, F) second derivatives of half the energy with the lights, (h, w, 2, F) mixed ones.

    F counts what is free of the lights.  Of `most` pixels, scaled up: enough for the curvature;
    near the end only all have the right slope.
    mixed : whether to find those with the gradient of log depth, of each of these pixels
    """
    photographs = level.photographs
    share = np.count_nonzero(photographs.active) / np.count_nonzero(photographs.some(most))
    hessian, _, both = photographs.light_terms(
        fit.surface, fit.lamps, fit.explanation.albedo, scale=fit.scales, near=fit.near,
        stride=photographs.stride(most), mixed=mixed,
    )  # fmt: skip
    _, alike = equal_intensity_derivatives(fit.lamps, 5 if fit.near else 4)
    hessian *= share
    hessian += gauge(fit, hessian) + fit.noise**2 * fit.equal_intensity_weight * alike
    both *= share
    if not fit.shared_ambient:
        return hessian, both
    free = parameter_map(fit)
    return free.T @ hessian @ free, both @ free


def light_slope(level: Level, fit: Fit) -> Floats:
    """(F,) half the energy's derivatives with what is free of the lights."""
    slope = fit.explanation.light_slope
    if slope is None:
        slope = level.photographs.explain(
            fit.surface, fit.lamps, scale=fit.scales, start=fit.explanation.albedo, turning=True
        ).light_slope
    slope = np.delete(np.asarray(slope), () if fit.near else 3, axis=-1)
    alike, _ = equal_intensity_derivatives(fit.lamps, slope.shape[-1])
    slope = np.asarray(slope.ravel() + fit.noise**2 * fit.equal_intensity_weight * alike)
    return slope @ parameter_map(fit) if fit.shared_ambient else slope


def parameter_map(fit: Fit) -> Floats:
    """(K, F) by how much the K numbers of the lights change with the F that are free.

    On a nearly flat surface all normals see as much of a lamp: only ambient light that is alike
    tells how much that is.
    """
    lamps = fit.lamps
    *shape, numbers = *lamps.ambient.shape, 5 if fit.near else 4
    order = np.arange(lamps.ambient.size * numbers).reshape(*shape, numbers)
    own, ambient = order[..., :-1].ravel(), order[..., -1]
    free = np.zeros((order.size, own.size + 1))
    free[own, np.arange(own.size)] = 1
    size = np.maximum(lamps.irradiance, np.finfo(float).tiny)
    along = lamps.ambient_share * lamps.vector / size[..., None]
    columns = np.arange(own.size).reshape(*shape, numbers - 1)[..., :3]
    free[ambient[..., None], columns] = along
    free[ambient.ravel(), -1] = size.ravel()
    return free


def lamps_after(fit: Fit, step: Floats) -> Lamps:
    """The fit's lamps after a step (F,) of what is free of them."""
    numbers = parameter_map(fit) @ step if fit.shared_ambient else step
    lamps = fit.lamps.moved(numbers.reshape(*fit.lamps.ambient.shape, -1))
    if fit.shared_ambient:
        lamps = replace(lamps, ambient=lamps.ambient_share * lamps.irradiance)
    return lamps


def gauge(fit: Fit, hessian: Floats) -> Floats:
    """Holds the lights' common intensity, which the albedo makes up for: one per channel."""
    lamps = fit.lamps
    still = [np.zeros((*lamps.ambient.shape, 1))] if fit.near else []
    intensity = np.concatenate([lamps.vector, *still, lamps.ambient[..., None]], axis=-1)
    total = np.zeros_like(hessian)
    for channel in range(lamps.ambient.shape[1]):
        along = np.zeros_like(intensity)
        along[:, channel] = intensity[:, channel]
        along = along.ravel() / max(float(np.linalg.norm(along)), np.finfo(float).tiny)
        total += float(np.trace(hessian)) * np.outer(along, along)
    return total
