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
    light_system,
    reset_scale,
    update_scale,
)
from rakelight.methods.multi_light.joint_step import damped_tensor, joint_step
from rakelight.methods.multi_light.options import MultiLight
from rakelight.model import Progress, ProgressCallback
from rakelight.photometry.images import SAMPLE_PIXELS
from rakelight.solve import solve
from rakelight.solve.gauss_newton import damped_solution
from rakelight.solve.levenberg_marquardt import lowered
from rakelight.solve.robust import NOTABLE, ROUNDS

# Relative residual to which a depth step is solved; the next step starts from the rest (5 %: 1.03
# over 50 draws, and tiles agree less where they overlap; ablation.md).
STEP_TOLERANCE = 2e-2


@dataclass(frozen=True, slots=True)
class Descent:
    """The result of steps at one level: the last state, which is the best, and how it came about.

    energies : of the states under the last loss, from its first on
    steps : number of steps, including those under earlier losses
    weight : the depth weight, a multiple of the level's, where several are tried
    """

    fit: Fit
    energies: tuple[float, ...]
    converged: bool
    steps: int
    weight: float = 1.0


def descend(
    level: Level,
    fit: Fit,
    options: MultiLight,
    progress: ProgressCallback,
    stage: str,
    together: bool = True,
    last: bool = False,
) -> Descent:
    """Gauss-Newton steps at one level until the energy has converged.

    together : whether the lights move with the depth
    last : whether the result is what it finds: sigma weighs the priors however large it is; and if
        lights move, one scale is that of all pixels (`update_scale`), and it has converged only
        when no extrapolated step lowers the energy either
    """
    noisiest, thorough = 1.0 if last else LARGEST_NOISE, last and together
    energies: list[float] = []
    loss_fixed = converged = False
    for step in range(options.max_iterations):
        progress(Progress(stage, step + 1, options.max_iterations, fit.energy))
        if not loss_fixed:
            # The scale of the loss falls with the residuals; then it is fixed.
            noise, fit = fit.noise, update_scale(level, fit, noisiest, one_scale=thorough)
            loss_fixed = step > 0 and fit.noise > (1 - NOTABLE) * noise
            energies = [fit.energy]
        before = fit
        fit = depth_step(level, fit, with_light_slope=together)
        if together:
            fit = joint_step(level, fit, options.coarse_pixels)
        fit = project_bas_relief(level, fit)
        small = options.tolerance * before.linearization.energy
        if loss_fixed and (thorough or before.energy - fit.energy >= small):
            fit = extrapolated(level, before, fit)
        # A refused joint step says nothing of the next one, which has more damping.
        refused = thorough and before.joint_damping < fit.joint_damping < 1
        converged = loss_fixed and before.energy - fit.energy < small and not refused
        if converged and fit.energy > before.energy:
            fit = before  # the gain was a bas-relief transform that the projection has undone
            break
        energies.append(fit.energy)
        if converged:
            break
    return Descent(fit, tuple(energies), converged, step + 1)


def depth_step(level: Level, fit: Fit, with_light_slope: bool = True) -> Fit:
    """One Gauss-Newton step of the depth, lights fixed; if refused, the next has more damping.

    with_light_slope : whether the derivatives with the lights are found, for a step of both
    """

    def after(damping: float) -> Fit:
        system = depth_system(level, fit, damped_tensor(level, fit, damping))
        solution = solve(system, tolerance=STEP_TOLERANCE)
        if solution.status == "stalled":
            return fit  # refused, as it is no lower
        # A step that is cut off at the iteration limit is inexact: it counts if the energy falls.
        log_depth = level.placed(fit.log_depth + solution.value)
        return evaluated(level, fit, log_depth, fit.lights, with_light_slope=with_light_slope)

    lower, damping = lowered(fit, fit.depth_damping, after)
    return replace(lower, depth_damping=damping)


def project_bas_relief(level: Level, fit: Fit) -> Fit:
    """The state after the bas-relief transform that brings the surface closest to the sensor.

    Whatever it does to the energy: distant lights leave the transform open, and the photographs'
    energy along it is an error of the model, down which the surface would drift.  The fall-off of
    near lights determines it; there the joint steps do.  Beams make up for that, too, and given
    directions leave none open.
    """
    if fit.model.directions is not None or (fit.model.near and not fit.model.beam):
        return fit
    return after_bas_relief(level, fit)


def try_bas_relief(level: Level, fit: Fit, options: MultiLight) -> Fit:
    """Under near lights the lower of two states; under others the state as it is.

    One begins at this state, the other at it after the bas-relief transform nearest to the
    sensor's.  Each takes up to three steps of the lights, one of the depth and one of both.  The
    fall-off of near lights determines the transform, but on a flat object so little that steps
    along it are short.  Compared by least squares: losses that have adapted to one surface do not
    judge another.
    """
    if not fit.model.near:
        return fit
    weight = fit.equal_intensity_weight
    fit = replace(reset_scale(level, fit), equal_intensity_weight=weight)
    small = options.tolerance * fit.linearization.energy
    starts = fit, after_bas_relief(level, fit, with_light_slope=True)
    lit = [refine_lights(level, start, small) for start in starts]
    if abs(lit[0].energy - lit[1].energy) < small:  # the same surface, as far as a level converges
        lit = lit[:1]
    both = (joint_step(level, depth_step(level, each), options.coarse_pixels) for each in lit)
    return min(both, key=lambda each: each.energy)


def after_bas_relief(level: Level, fit: Fit, with_light_slope: bool = False) -> Fit:
    """The state after the bas-relief transform nearest to the sensor's, lights and depth alike."""
    log_depth, transform = nearest_bas_relief(
        level, fit.log_depth, fit.lights, fit.equal_intensity_weight
    )
    lights = replace(fit.lights, vector=fit.lights.vector @ transform.T)
    return evaluated(level, fit, log_depth, lights, with_light_slope=with_light_slope)


def refine_lights(level: Level, fit: Fit, small: float = 0.0) -> Fit:
    """The state after `ROUNDS` steps of the lights alone, or fewer.

    small : a step that lowers the energy by less than this is the last
    """
    for _ in range(ROUNDS):
        before, fit = fit, lights_step(level, fit)
        if before.energy - fit.energy < small:
            break
    return fit


def lights_step(level: Level, fit: Fit) -> Fit:
    """One Gauss-Newton step of the lights, depth fixed; if refused, the next has more damping."""
    hessian, slope, _ = light_system(level, fit, SAMPLE_PIXELS)

    def after(damping: float) -> Fit:
        step = damped_solution(hessian, -slope, np.diag(hessian), damping)
        lights = fit.model.moved(fit.lights, step)
        return evaluated(level, fit, fit.log_depth, lights, with_light_slope=True)

    lower, damping = lowered(fit, fit.lights_damping, after)
    return replace(lower, lights_damping=damping)


def extrapolated(level: Level, before: Fit, fit: Fit) -> Fit:
    """The step from `before` to `fit`, lengthened and doubled for as long as the energy falls.

    Where reweighting or the bas-relief valley makes steps short, they all have one direction.
    """
    direction = fit.log_depth - before.log_depth
    lights = fit.model.own_numbers(fit.lights.numbers - before.lights.numbers)
    gloss = fit.lights.gloss - before.lights.gloss
    direction_of_ambient = fit.lights.ambient_direction - before.lights.ambient_direction
    best, factor = fit, 1.0
    history = [(0.0, before.energy), (1.0, fit.energy)]
    while parabola_falls(history, 1 + factor):
        trial = evaluated(
            level, fit, fit.log_depth + factor * direction,
            fit.lights.moved(factor * lights, factor * gloss, factor * direction_of_ambient),
        )  # fmt: skip
        if not trial.energy < best.energy:
            break
        history.append((1 + factor, trial.energy))
        best, factor = trial, 2 * factor
    return best


def parabola_falls(history: list[tuple[float, float]], position: float) -> bool:
    """Whether the parabola through the last three (position, energy) is lower at `position`.

    Than at the last of them.  With fewer than three there is no parabola: True.
    """
    if len(history) < 3:
        return True
    (first, high), (middle, low), (last, lowest) = history[-3:]
    slope = (lowest - low) / (last - middle)
    curvature = (slope - (low - high) / (middle - first)) / (last - first)
    return slope + curvature * (position - middle) < 0
