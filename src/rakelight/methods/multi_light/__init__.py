"""Multi-light, solved jointly: Gauss-Newton on log depth and all lights, albedo eliminated.

    I_ic = rho_c (max(0, s_i . n) + phi_i (1 + d . n)) + |s_i| sum_e k_e (n . h_i)^e

with equation (3)'s lights s and ambient light phi, a direction d of the latter, and gloss k.

The albedo is linear given the shading and is eliminated per pixel and channel (variable
projection).  The lights are few and are eliminated by a Schur complement.  Alternation (3.4)
is slow along the bas-relief valley, in which lights and depth have to move together; the joint step
is not.  Coarse to fine; Cauchy weights per photograph, pixel and channel.  Values that are
predicted to lie in cast shadow, or to be a highlight by more than a twentieth, are left out.

The files, in the order of reading: options.py; energy.py and equal_intensity.py (what is minimised,
and its derivatives), light_model.py (which numbers of the lights are free), steps.py and
joint_step.py (Gauss-Newton steps, and the loop over them), bas_relief.py (what photographs leave
open), model_selection.py (which lights, which start, what depth weight), initial_lights.py and
factored_start.py (where descents begin), noise.py (both error models), sensor_blur.py, outliers.py,
confidence.py and bas_relief_variance.py (expected errors), normals.py, notes.py, tiles.py (large
captures).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rakelight.methods.base import Estimate, Method, brightest, light_findings, require_photographs
from rakelight.methods.levels import (
    CORRELATION_PX,
    Level,
    cut_at_measured_jumps,
    finest_level,
    held_to_measurements,
    pyramid,
)
from rakelight.methods.multi_light.bas_relief_variance import shape_errors
from rakelight.methods.multi_light.confidence import depth_sigma, normal_errors
from rakelight.methods.multi_light.energy import Fit, evaluated, reset_scale
from rakelight.methods.multi_light.model_selection import Search, try_near_lights
from rakelight.methods.multi_light.noise import (
    correlation_ratio,
    estimate_depth_weight,
    estimate_equal_intensity_weight,
    estimate_laplacian_weight,
)
from rakelight.methods.multi_light.normals import fine_normals
from rakelight.methods.multi_light.notes import notes_of
from rakelight.methods.multi_light.options import MultiLight
from rakelight.methods.multi_light.outliers import remove_outliers
from rakelight.methods.multi_light.sensor_blur import (
    select_sharpened,
    sharpened,
    sharpened_measurements,
)
from rakelight.methods.multi_light.steps import Descent, descend, try_bas_relief
from rakelight.model import Floats, ProgressCallback
from rakelight.prepare import Prepared
from rakelight.solve.robust import ROUNDS

# Depth weights that the coarsest level chooses from, multiples of white noise's, 1/variance, times
# the result's pixels in a depth pixel over which the photographs' errors are correlated: all of
# them up to a side of `CORRELATION_PX` (ablation.md: halved 0.96, doubled 1.03).
FIRST_DEPTH_WEIGHTS = (0.01, 0.1, 1.0, 10.0)
# Factor of the depth weight per halving of the resolution: a coarser level explains averaged
# photographs, and only roughly (ablation.md: off 0.98, but correlated errors of the depth then
# count too much at the coarsest level).
COARSER_WEIGHT = 2.0


def multi_light(prepared: Prepared, options: MultiLight, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by all photographs at once.

    Raises MethodError for fewer than 3 photographs.
    """
    require_photographs(prepared, "multi-light", 3)
    levels, weights = first_levels(prepared, options)
    # 1. The coarsest level: the start, the light model, and a first depth weight.
    coarsest = len(levels) - 1
    coarse, factor = coarsest_level(levels)
    largest = weights[-1]
    weights = [factor * each for each in weights]
    search = Search(coarse, weights, options, progress, stage(coarsest))
    descent = search.select(prepared.lights)
    # 2. With the highlights and without the cast shadows that this fit predicts, the weight is
    # chosen again: they had been errors of the photographs.
    descent = select_without_outliers(search, descent)
    blur_px, descent = select_sharpened(search, levels, descent, prepared)
    weight = descent.weight / factor
    levels = [each.weighted(weight * COARSER_WEIGHT**k) for k, each in enumerate(levels)]

    # 3. Coarse to fine, a few steps each: lights and depth together.
    briefly = replace(options, max_iterations=min(options.max_iterations, ROUNDS))
    for index in reversed(range(coarsest)):
        log_depth = levels[index].carried(levels[index + 1], descent.fit.log_depth)
        level = sharpened(levels[index], log_depth, blur_px)
        level, lights = remove_outliers(level, log_depth, descent.fit.lights)
        fit = reset_scale(level, replace(descent.fit, log_depth=log_depth, lights=lights))
        # At the finest level the depth alone, to take up detail; the lights move in step 5.
        descent = descend(level, fit, briefly, progress, stage(index), together=index > 0)

    # 4. The depth weight from the errors of both sides, now that there are residuals.  Before it
    # the sensor's blur again, of the measurements themselves.
    first_weight, native = weight, levels[0].weighted(1 / weight)
    blur_px, prepared = sharpened_measurements(prepared, native, descent.fit, weight)
    if options.depth_weight is None:
        weight = estimate_depth_weight(descent.fit, prepared, largest / max(weight, largest))
    # 5. The lights, the depth moving with them, until the energy has converged.  Outliers are
    # predicted again, and links cut at jumps that the sensor blurred or its noise hid: they are
    # steep by now.  One scale for all pixels: the lights do not follow those where the model errs.
    # The sensor's measurements themselves, not smoothed, say how high fine relief is.
    level, fit = without_outliers(levels[0], descent.fit)
    level = level.weighted(weight / first_weight).cut(fit.log_depth)
    level = held_to_measurements(level, prepared)
    equal_intensity = estimate_equal_intensity_weight(level, fit.log_depth, prepared)
    # What photographs say of the lights counts the less, the farther their errors are correlated.
    correlated = max(correlation_ratio(level, fit), 1.0)
    fit = replace(fit, equal_intensity_weight=correlated * equal_intensity)
    start = try_bas_relief(level, try_near_lights(level, fit, options, progress), options)
    both = descend(level, start, options, progress, "refine, weighed", last=True)
    # 6. The depth alone under these lights, from where step 5 began: its depth has errors of
    # millimetres on steep sides, where one scale takes all of a pixel for outliers.
    laplacian = estimate_laplacian_weight(level, both.fit)
    fit = replace(both.fit, equal_intensity_weight=equal_intensity, laplacian_weight=laplacian)
    fit = evaluated(level, fit, start.log_depth, both.fit.lights)
    last = descend(level, fit, options, progress, "refine, depth", together=False, last=True)
    steps, converged = descent.steps + both.steps + last.steps, both.converged and last.converged
    descent = replace(last, steps=steps, converged=converged)
    return finished(prepared, level, descent, start.log_depth, weight, blur_px)


def first_levels(prepared: Prepared, options: MultiLight) -> tuple[list[Level], list[float]]:
    """The levels, finest first, under white noise's depth weight, and the first depth weights.

    Those are multiples of white noise's at the finest level, the least first.
    """
    finest = finest_level(prepared, cut=True, unbiased=True)
    levels = pyramid(cut_at_measured_jumps(finest, prepared), options.coarse_pixels)
    correlation_area = min(prepared.factor, CORRELATION_PX) ** 2
    weights = [each * correlation_area for each in FIRST_DEPTH_WEIGHTS]
    return levels, weights if options.depth_weight is None else [options.depth_weight]


def coarsest_level(levels: Sequence[Level]) -> tuple[Level, float]:
    """The coarsest level, and the factor of depth weights there.

    Its depth weight is of one sensor pixel's noise: errors of neighbours are correlated, and their
    mean over a pixel of the level is not that much smaller.
    """
    coarse, finest = (levels[k].sensor_weight for k in (-1, 0))
    averaged = float(np.median(coarse) / np.median(finest))
    return levels[-1].weighted(1 / averaged), averaged * COARSER_WEIGHT ** (len(levels) - 1)


def select_without_outliers(search: Search, descent: Descent) -> Descent:
    """The cheapest descent, under each weight, without the outliers that this descent predicts.

    Itself where it predicts none.
    """
    clear, fit = without_outliers(search.level, descent.fit)
    if fit is descent.fit:
        return descent
    again = replace(search, level=clear)
    return again.with_larger_weights(again.cheapest(again.descents(search.weights, fit)))


def without_outliers(level: Level, fit: Fit) -> tuple[Level, Fit]:
    """`remove_outliers` at a state, and the state on what is left, its robust scale reset."""
    clear, lights = remove_outliers(level, fit.log_depth, fit.lights)
    if clear is level and not fit.lights.gloss.any():
        return level, fit
    return clear, reset_scale(clear, replace(fit, lights=lights))


def stage(index: int) -> str:
    """The name of a level's stage in the progress."""
    return f"refine 1/{2**index}" if index else "refine"


def finished(
    prepared: Prepared, level: Level, descent: Descent, start: Floats, weight: float, blur_px: float
) -> Estimate:
    """The estimate of the finest level, the albedo's 99th percentile set to 1.

    start : (h, w) log depth where the last descents began, see `depth_sigma`
    weight, blur_px : the depth weight and the sensor's blur, for the notes
    """
    fit = descent.fit
    normals, linearization = fine_normals(level, fit)
    albedo = linearization.albedo
    gain = brightest(albedo[level.photographs.active])
    lights = fit.lights.brighter(gain).as_lights(level.middle_m)
    free = None if fit.model.directions is not None else fit.lights
    moment, bas_relief = shape_errors(level, fit.log_depth, free)
    confidence, normal_sigma, local = normal_errors(level, fit, normals, bas_relief)
    notes = notes_of(level, fit.lights, gain, weight, blur_px)
    return Estimate(
        log_depth=fit.log_depth,
        albedo=albedo / gain,
        confidence=confidence,
        lights=lights,
        normals=normals,
        energy=descent.energies,
        steps=descent.steps,
        converged=descent.converged,
        findings=(*light_findings(lights, prepared.names), *notes),
        depth_sigma=depth_sigma(level, fit, prepared, local, moment, start),
        normal_sigma=normal_sigma,
    )


METHOD = Method(
    "multi-light", multi_light, MultiLight,
    starts_from_depth=True, corrects_pose=True, given_lights="use", bytes_per_pixel=1500,
    in_tiles=True,
)  # fmt: skip

__all__ = ["METHOD", "MultiLight"]
