"""The steps that lower the energy: of the depth, of the lights, of both, and the loop over them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.methods.levels import Level
from rakelight.methods.multi_light.bas_relief import nearest_bas_relief
from rakelight.methods.multi_light.energy import (
    LARGEST_NOISE,
    Fit,
    depth_system,
    evaluated,
    lamps_after,
    light_curvature,
    light_slope,
    update_scale,
)
from rakelight.methods.multi_light.joint_step import damped_tensor, joint_step
from rakelight.methods.multi_light.options import MultiLight
from rakelight.model import Floats, Progress, ProgressCallback
from rakelight.photometry.images import Lamps
from rakelight.solve import solve
from rakelight.solve.gauss_newton import damped_solution
from rakelight.solve.levenberg_marquardt import lowered

# The loss is fixed when the residuals' scale falls by less than to this part from one step to the
# next (ablation.md: halved 1.00, doubled 1.05).
NOISE_AT_REST = 0.95
# How often a refused step is tried with more damping.
TRIES = 3
# Relative residual to which a depth step is solved: the next step starts from what it missed.
STEP_TOLERANCE = 2e-2
# Steps of the lights alone, and how many pixels are enough for their second derivatives.
LIGHT_STEPS, CURVATURE_PIXELS = 2, 2000


@dataclass(frozen=True, slots=True)
class Descent:
    """Where steps at one level led: the fits under the last loss, and whether the energy rests.

    steps : how many were taken, under earlier losses too
    """

    fits: tuple[Fit, ...]
    converged: bool
    steps: int

    @property
    def fit(self) -> Fit:
        """The last and best."""
        return self.fits[-1]


def descend(
    level: Level,
    fit: Fit,
    options: MultiLight,
    progress: ProgressCallback,
    stage: str,
    noisiest: float = LARGEST_NOISE,
    together: bool = True,
    thorough: bool = False,
) -> Descent:
    """Gauss-Newton steps at one level until the energy rests.

    together : whether lights move with the depth
    thorough : whether it rests only where an extrapolated step lowers nothing either
    """
    fits: list[Fit] = []
    settled = converged = False
    for step in range(options.max_iterations):
        progress(Progress(stage, step + 1, options.max_iterations, fit.energy))
        if not settled:
            # The residuals' scale falls as they do; once it rests, it is one energy that falls.
            noise, fit = fit.noise, update_scale(level, fit, noisiest)
            settled = step > 0 and fit.noise > NOISE_AT_REST * noise
            fits = [fit]
        before = fit
        fit = depth_step(level, fit)
        if together:
            fit = joint_step(level, fit, options.coarse_pixels)
        fit = project_bas_relief(level, fit)
        small = options.tolerance * before.energy
        if settled and (thorough or before.energy - fit.energy >= small):
            fit = extrapolated(level, before, fit)
        converged = settled and before.energy - fit.energy < small
        if converged and fit.energy > before.energy:
            break  # what the photographs gained was a bas-relief that the sensor contradicts
        fits.append(fit)
        if converged:
            break
    return Descent(tuple(fits), converged, step + 1)


def depth_step(level: Level, fit: Fit) -> Fit:
    """One Gauss-Newton step of the depth, lights held; damped until the energy falls."""

    def after(damping: float) -> Fit:
        system = depth_system(level, fit, damped_tensor(level, fit, damping))
        solution = solve(system, tolerance=STEP_TOLERANCE)
        if solution.status == "stalled":
            return fit  # refused, as it is no lower
        log_depth = level.placed(fit.log_depth + solution.value)
        return evaluated(level, fit, log_depth, fit.lamps, turning=True)

    lower, damping = lowered(fit, fit.depth_damping, after, TRIES)
    return replace(lower, depth_damping=damping)


def project_bas_relief(level: Level, fit: Fit) -> Fit:
    """The fit after the bas-relief transform that brings the surface closest to the sensor.

    Whatever becomes of the photographs' energy: distant lamps leave the transform open, and what
    the energy says of it is the model's error, down which the surface would slide.  Near lamps
    tell it, and joint steps see to it.
    """
    if fit.near:
        return fit
    log_depth, turn = nearest_bas_relief(
        level, fit.log_depth, fit.lamps, fit.equal_intensity_weight
    )
    lamps = replace(fit.lamps, vector=fit.lamps.vector @ turn.T)
    return evaluated(level, fit, log_depth, lamps, turning=True)


def refine_lights(level: Level, fit: Fit) -> Fit:
    """The fit after some steps of the lights alone."""
    for _ in range(LIGHT_STEPS):
        fit = lights_step(level, fit)
    return fit


def lights_step(level: Level, fit: Fit) -> Fit:
    """One Gauss-Newton step of the lights, the depth held; damped until the energy falls."""
    hessian, _ = light_curvature(level, fit, CURVATURE_PIXELS)
    slope = light_slope(level, fit)

    def after(damping: float) -> Fit:
        step = damped_solution(hessian, -slope, np.diag(hessian), damping)
        return evaluated(level, fit, fit.log_depth, lamps_after(fit, step), turning=True)

    lower, damping = lowered(fit, fit.lights_damping, after, TRIES)
    return replace(lower, lights_damping=damping)


def extrapolated(level: Level, before: Fit, fit: Fit) -> Fit:
    """The way from `before` to `fit` once more and further, for as long as the energy falls.

    Where reweighting or the bas-relief valley make the steps short, they all point one way.
    """
    way = fit.log_depth - before.log_depth
    lights = lamps_step(before.lamps, fit.lamps)
    best, share = fit, 1.0
    behind = [(0.0, before.energy), (1.0, fit.energy)]
    while parabola_falls(behind, 1 + share):
        tried = evaluated(level, fit, fit.log_depth + share * way, fit.lamps.moved(share * lights))
        if not tried.energy < best.energy:
            break
        behind.append((1 + share, tried.energy))
        best, share = tried, 2 * share
    return best


def parabola_falls(behind: list[tuple[float, float]], place: float) -> bool:
    """Whether the parabola through the last three (place, energy) is lower there than at the last.

    Two tell nothing of what is ahead.
    """
    if len(behind) < 3:
        return True
    (first, high), (middle, low), (last, lowest) = behind[-3:]
    slope = (lowest - low) / (last - middle)
    bend = (slope - (low - high) / (middle - first)) / (last - first)
    return slope + bend * (place - middle) < 0


def lamps_step(before: Lamps, after: Lamps) -> Floats:
    """What `Lamps.moved` takes from one to the other."""
    closer, ambient = after.closeness - before.closeness, after.ambient - before.ambient
    change = [after.vector - before.vector, closer[..., None], ambient[..., None]]
    return np.concatenate(change, axis=-1)
