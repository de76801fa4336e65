"""The energy of a depth and lights, its derivatives, and the state of the iteration.

The energy of log depth p and lights s, albedo eliminated (variable projection):

    E = sum loss(rho_c (max(0, s_i . n) + phi_i (1 + d . n)) + H_i - I_ic)    (3), n from G p
        + beta sum M_uu (p_uuuu / 8)^2 + M_vv (p_vvvv / 8)^2    fourth differences
        + sigma^2 sum w (K (p - p_0))^2                     the sensor's depth
        + sigma^2 c sum (L (p - p_1))^2                     Laplacian of the change
        + sigma^2 W (N - 4) log(variance of log |s_i|)      lights of equal intensity
        + sigma^2 |d|^2 / 4                                 ambient light is seldom uneven

G p is the mean gradient, H_i the highlight of `photometry.specular`; 0 until one is found.  d is 0
unless ambient light comes notably from one side.  p_1 is the prepared depth, and c is 0 but in the
last descent under lights in one plane.  The terms and their derivatives are in
`Photographs.linearize` and `light_terms`, here (`fourth_difference_term`), in `Level.sensor_terms`,
and in equal_intensity.py; `evaluated` adds the terms up, `depth_system` and `light_system` the
derivatives.

Under distant lights the four numbers of a bas-relief transform are taken from the sensor's depth
(and the lights' intensities) alone, not from the photographs: `project_bas_relief`.
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
from rakelight.methods.multi_light.light_model import FREE, LightModel
from rakelight.model import Floats
from rakelight.photometry.images import MOST_UNEVEN, LightParameters, Linearization, Surface
from rakelight.solve import DepthSystem, assemble
from rakelight.solve.levenberg_marquardt import LEAST
from rakelight.solve.robust import cauchy_scales
from rakelight.solve.stencil import Laplacian

FOURTH_DIFFERENCE = (0.125, -0.5, 0.75, -0.5, 0.125)
# Weight of the fourth differences over the diagonal of M, of the same pixel: relative, so that a
# flatter surface does not gain by it (ablation.md: off 1.02, halved 1.02, doubled 0.96).
FOURTH_DIFFERENCE_WEIGHT = 0.003
# Largest sigma, the standard deviation of a value (white is 1), by which priors are weighted before
# the last two descents, so that rough residuals do not give the surface to the sensor
# (ablation.md: halved 0.89, on 30 other draws 1.03; without it 7 of 32 coins are lost, not 1).
LARGEST_NOISE = 0.01

# Largest change of log depth: no part of an object is ten times as near or as far as prepared.
LARGEST_CHANGE = float(np.log(10))


@dataclass(frozen=True, slots=True)
class Fit:
    """The state: log depth (h, w) and lights at one level, and the linearization there.

    scales : (h, w) of the Cauchy losses; energy : the sum of all terms
    noise : sigma as it weighs the priors, at most `LARGEST_NOISE` before the last two descents
    fourth_difference_weight : (2, h, w) of its squares along u and v
    model : which of the lights' numbers are free
    equal_intensity_weight : W, of `equal_intensity_energy`; laplacian_weight : c
    depth_damping, joint_damping, lights_damping : of the next step of each kind
    """

    log_depth: Floats
    lights: LightParameters
    surface: Surface
    linearization: Linearization
    scales: Floats
    noise: float
    energy: float
    fourth_difference_weight: Floats
    model: LightModel = FREE
    equal_intensity_weight: float = 0.0
    laplacian_weight: float = 0.0
    depth_damping: float = LEAST
    joint_damping: float = LEAST
    lights_damping: float = 1e-2  # with LEAST, fine relief under near lights loses a seventh


def first_fit(
    level: Level, log_depth: Floats, lights: LightParameters, model: LightModel = FREE
) -> Fit:
    """The state at a depth and lights; the robust scale is that of its least-squares residuals.

    `descend` updates it once more: pixels beside a jump that least squares bends come right.
    """
    surface = level.surface(log_depth)
    plain = level.photographs.linearize(surface, lights)
    no_loss = np.zeros(level.mask.shape)
    start = Fit(log_depth, lights, surface, plain, no_loss, 0.0, 0.0, no_loss, model)
    return update_scale(level, start)


def reset_scale(level: Level, fit: Fit) -> Fit:
    """`first_fit` at a state's depth and lights: on other photographs, level or depth weight.

    The albedo, too, starts from least squares: weights of the old loss do not bias the new one.
    """
    return first_fit(level, fit.log_depth, fit.lights, fit.model)


def update_scale(
    level: Level, fit: Fit, noisiest: float = LARGEST_NOISE, one_scale: bool = False
) -> Fit:
    """The same depth and lights with the robust scale of the present residuals.

    one_scale : whether all pixels have the noise's, and none a larger one for its own residuals
    """
    sigma = fit.linearization.noise_sigma
    residual = fit.linearization.mean_abs_residual
    scales = cauchy_scales(sigma, np.zeros_like(residual) if one_scale else residual)
    weight = FOURTH_DIFFERENCE_WEIGHT * np.moveaxis(fit.linearization.jtwj[..., [0, 2]], -1, 0)
    same = replace(fit, scales=scales, noise=min(sigma, noisiest), fourth_difference_weight=weight)
    return evaluated(level, same, fit.log_depth, fit.lights)


def evaluated(
    level: Level,
    fit: Fit,
    log_depth: Floats,
    lights: LightParameters,
    with_light_slope: bool = False,
) -> Fit:
    """The state at another depth and other lights, under the same loss."""
    surface = level.surface(log_depth)
    linearization = level.photographs.linearize(
        surface, lights, scale=fit.scales, start=fit.linearization.albedo,
        with_light_slope=with_light_slope, ambient_direction=fit.model.ambient_direction,
    )  # fmt: skip
    fourth_difference = fourth_difference_term(level, log_depth)
    fourth_difference_energy = float(
        np.vdot(fit.fourth_difference_weight * fourth_difference, fourth_difference)
    )
    prior = level.sensor_sum_of_squares(log_depth)
    prior += float(np.square(lights.ambient_direction).sum()) / MOST_UNEVEN**2
    if weight := fit.laplacian_weight:
        change = laplacian_of_change(level, log_depth)
        prior += weight * float(np.vdot(change, change))
    if weight := fit.equal_intensity_weight:
        prior += weight * equal_intensity_energy(lights.vector, level.photographs.exposures)
    energy = linearization.energy + fourth_difference_energy + fit.noise**2 * prior
    if np.abs(log_depth - level.prior)[level.mask].max() > LARGEST_CHANGE:
        energy = np.inf  # no step leads there
    return replace(
        fit, log_depth=log_depth, lights=lights, surface=surface, linearization=linearization,
        energy=energy,
    )  # fmt: skip


def fourth_difference_term(level: Level, log_depth: Floats) -> Floats:
    """(2, h, w) an eighth of the fourth difference along u and v, 0 where there is none.

    It sees a checkerboard, which the mean gradient does not, and little else.  There is none where
    the pixel in the middle has no normal, since the matrix of a step has no entry for it.
    """
    return fourth_differences(log_depth, level.grid) / 8


def fourth_difference_term_transposed(level: Level, along: Floats) -> Floats:
    """(h, w) the transpose of `fourth_difference_term`, of an image (2, h, w)."""
    from scipy.ndimage import correlate1d

    total = np.zeros(level.mask.shape)
    for axis, wide, image in zip((1, 0), Links.of(level.grid).fives, along, strict=True):
        total += correlate1d(wide * image, FOURTH_DIFFERENCE, axis, mode="constant")
    return total


def laplacian_of_change(level: Level, log_depth: Floats) -> Floats:
    """(h, w) the Laplacian of what a log depth (h, w) has changed of the prepared one.

    0 where a pixel is not linked to all four neighbours: at the outline, and beside a jump.
    """
    return Laplacian.on(level.mask, level.links.inner.astype(float)).of(log_depth - level.prior)


def depth_system(level: Level, fit: Fit, tensor: Floats) -> DepthSystem:
    """The normal equations of a correction of log depth, with `tensor` (h, w, 3) for a matrix."""
    weight = fit.noise**2 * fit.laplacian_weight
    system = assemble(
        level.mask, tensor, fit.linearization.rhs, pair_weights=level.links.pairs,
        laplacian_weight=weight * level.links.inner if weight else None,
        **level.sensor_terms(fit.log_depth, fit.noise**2),
    )  # fmt: skip
    return replace(system, rhs=system.rhs - np.where(level.mask, wide_gradient(level, fit), 0.0))


def depth_negative_gradient(level: Level, fit: Fit) -> Floats:
    """(h, w) minus half the energy's derivatives with log depth: `depth_system`'s right side."""
    along = fit.linearization.rhs
    shading = mean_gradient_transposed(along[..., 0], along[..., 1], level.grid)
    sensor = level.sensor_terms(fit.log_depth, fit.noise**2)
    data = sensor["data_weight"] * sensor["data_target"] + sensor.get("extra_rhs", 0.0)
    return np.asarray(shading + data - wide_gradient(level, fit))


def wide_gradient(level: Level, fit: Fit) -> Floats:
    """(h, w) half the derivatives of fourth differences and Laplacian with log depth."""
    weighted = fit.fourth_difference_weight * fourth_difference_term(level, fit.log_depth)
    total = fourth_difference_term_transposed(level, weighted)
    if fit.laplacian_weight:
        weight = fit.noise**2 * fit.laplacian_weight * level.links.inner
        change = laplacian_of_change(level, fit.log_depth)
        total += Laplacian.on(level.mask, weight).right_side(change)
    return total


def light_system(
    level: Level, fit: Fit, most: int, mixed: bool = False
) -> tuple[Floats, Floats, Floats]:
    """(F, F) second and (F,) first derivatives of half the energy with the lights; mixed ones.

    F counts the lights' free parameters.  The second ones are of about `most` pixels, scaled up:
    enough for curvature, while the gradient near the minimum needs all of them.
    mixed : whether to find, of each of these pixels, the derivatives (h, w, 2, K) with the gradient
        of log depth as well; an empty array if not.  With all K numbers of the lights: to multiply
        sums of them by `model.jacobian` (K, F) is faster
    """
    photographs, model = level.photographs, fit.model
    share = np.count_nonzero(photographs.active) / np.count_nonzero(photographs.subsample(most))
    hessian, _, both = photographs.light_terms(
        fit.surface, fit.lights, fit.linearization.albedo, scale=fit.scales, numbers=model.numbers,
        subsampling=photographs.subsampling(most), mixed=mixed,
        ambient_direction=model.ambient_direction,
    )  # fmt: skip
    now = fit.linearization
    if now.light_slope is None:
        now = evaluated(level, fit, fit.log_depth, fit.lights, with_light_slope=True).linearization
    slope = model.own_numbers(np.asarray(now.light_slope)).ravel()
    hessian *= share
    both *= share
    own = hessian[: slope.size, : slope.size]
    own += gauge(fit, own)
    if weight := fit.noise**2 * fit.equal_intensity_weight:
        first, second = equal_intensity_derivatives(
            fit.lights, model.numbers, photographs.exposures
        )
        slope = slope + weight * first
        own += weight * second
    if fit.lights.gloss.any():
        slope = np.append(slope, np.asarray(now.gloss_slope))
    if model.ambient_direction:
        weight = fit.noise**2 / MOST_UNEVEN**2
        along = np.asarray(now.ambient_direction_slope) + weight * fit.lights.ambient_direction
        slope = np.append(slope, along)
        hessian[-3:, -3:] += weight * np.eye(3)
    jacobian = model.jacobian(fit.lights)
    return jacobian.T @ (hessian @ jacobian), slope @ jacobian, both


def gauge(fit: Fit, hessian: Floats) -> Floats:
    """(K, K) a term that fixes what the albedo makes up for, in each channel: the gauge.

    The lights' common intensity and, of beams, their common b.
    """
    lights, diagonal = fit.lights, np.diag(hessian)
    common = [(lights.brighter(2.0).numbers - lights.numbers, diagonal.sum())]
    if fit.model.beam:
        each = np.broadcast_to(np.eye(8), (*lights.ambient.shape, 8, 8))
        stiffness = diagonal.reshape(*lights.ambient.shape, -1).sum(axis=(0, 1))
        common += [(each[..., k], stiffness[k]) for k in (4, 5)]
    total = np.zeros_like(hessian)
    for numbers, weight in common:
        step = fit.model.own_numbers(numbers)
        for channel in range(step.shape[1]):
            along = np.zeros_like(step)
            along[:, channel] = step[:, channel]
            along = along.ravel() / max(float(np.linalg.norm(along)), np.finfo(float).tiny)
            total += weight * np.outer(along, along)
    return total
