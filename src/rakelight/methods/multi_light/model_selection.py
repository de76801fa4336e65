"""What is chosen at the coarsest level: the start, the light model, the depth weight."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rakelight.methods.levels import Level
from rakelight.methods.multi_light.energy import Fit, evaluated, first_fit, reset_scale
from rakelight.methods.multi_light.equal_intensity import equal_intensity_energy
from rakelight.methods.multi_light.factored_start import factored_start
from rakelight.methods.multi_light.initial_lights import lights_of_given, lights_of_prior
from rakelight.methods.multi_light.options import MultiLight
from rakelight.methods.multi_light.steps import Descent, descend, refine_lights
from rakelight.model import GivenLights, ProgressCallback
from rakelight.photometry.images import LightParameters

# Factors of the first depth weight that are tried at the coarsest level.  The sensor's errors are
# correlated over an unknown area, and count that many times less (ablation.md: 1.07 either way).
WEIGHT_FACTORS = (1e-3, 1e-2, 1e-1)
# A factor is taken where it multiplies `penalised_noise` by less than its power of this exponent: a
# thousandth where it halves it (ablation.md: halved 0.84, doubled 1.07, one draw of 12 each).
FACTOR_EXPONENT = np.log(2) / np.log(1e3)
# Pixels of the object above which a level is halved for the factorisation, which is as good there
# and faster (ablation.md: halved 0.98, doubled 1.12).
FACTORED_PIXELS = 2000
# Near or coloured lights are taken where they lower the energy by more than this fraction, divided
# by the number of photographs: of few, more parameters explain more of anything (ablation.md: off
# 1.07, halved 0.98, doubled 1.00).
LEAST_ENERGY_GAIN = 0.5
# The object's radius over the distance at which all near lights start (ablation.md: halved 1.01,
# doubled 1.00).
FIRST_RADIUS_OVER_DISTANCE = 0.15
# Largest interquartile range of the lights' inverse distances, over their median, that is plausible
# of a lamp in a hand (ablation.md: off 1.07, halved and doubled 1.00).
MOST_VARIED_DISTANCES = 0.5


def select_model(
    level: Level,
    options: MultiLight,
    progress: ProgressCallback,
    stage: str,
    given: GivenLights | None = None,
) -> tuple[float, Descent]:
    """The factor of the level's depth weight that is chosen, and the descent with it.

    From distant white lights with a shared ambient ratio; near and coloured ones where they explain
    much more.  Where near lights come out implausible, all is chosen again with distant ones.

    given : lights that are one more start or, fixed, the only one
    """
    if given is not None and given.fixed:
        fit = given_fit(level, given)
        simple = descend(level, fit, options, progress, stage)
        starts: tuple[Fit, ...] = ()
    else:
        fit = first_fit(level, level.prior, lights_of_prior(level), shared_ambient=True)
        simple = descend(level, fit, options, progress, stage)
        found = (factored_fit(level), None if given is None else given_fit(level, given))
        starts = tuple(each for each in found if each is not None)
        simple = multi_start(level, simple, starts, options, progress)
    for distance in (options.distance, "distant"):
        these = replace(options, distance=distance)
        descent = select_lights(level, simple, these, progress)
        factor, descent = search_depth_weight(level, descent, these, progress, starts)
        if factor < 1:
            descent = select_lights(level.weighted(factor), descent, these, progress)
        if acceptable(level, descent.fit, options):
            break
    fit = replace(descent.fit, shared_ambient=False)
    return factor, replace(descent, fits=(*descent.fits[:-1], fit))


def search_depth_weight(
    level: Level,
    descent: Descent,
    options: MultiLight,
    progress: ProgressCallback,
    starts: Sequence[Fit] = (),
) -> tuple[float, Descent]:
    """The factor of the level's depth weight with the least penalised noise, and its descent.

    starts : other states to start from, where their residuals are smaller: under the whole weight
        the descent may have bent the lights to the sensor's noise

    Correlated errors of the depth count less than their number.  The area over which they are
    correlated shows only from a surface that follows the photographs, which too large a weight
    prevents.
    """
    chosen, fit = (1.0, descent), descent.fit
    if options.depth_weight is not None:
        return chosen
    least = penalised_noise(level, fit) if acceptable(level, fit, options) else np.inf
    floor = 0.0
    if fit.near:
        fit, *starts = (with_near_lights(level, each) for each in (fit, *starts))
    for factor in WEIGHT_FACTORS:
        penalty = factor**-FACTOR_EXPONENT
        if floor * penalty >= least:
            continue  # residuals under a smaller weight are too large already
        weaker = level.weighted(factor)
        words = "try a smaller depth weight"
        start = min(
            (reset_scale(weaker, each) for each in (fit, *starts)),
            key=lambda each: each.linearization.noise_sigma,
        )
        trial = descend(weaker, start, options, progress, words)
        penalised = penalised_noise(level, trial.fit)
        floor = max(floor, penalised)
        if penalised * penalty < least and acceptable(level, trial.fit, options):
            chosen, least = (factor, trial), penalised * penalty
    return chosen


def penalised_noise(level: Level, fit: Fit) -> float:
    """The residuals' sigma, times penalties for lights of unequal intensity and for near ones.

    On low relief a flat surface explains photographs nearly as well as the right one, under lights
    of very different intensity, or so near that their fall-off makes the shading.  Under lights in
    given directions it does not.
    """
    if fit.directions is not None:
        return fit.linearization.noise_sigma
    equal_intensity = equal_intensity_energy(fit.lights.vector) / (4 * len(fit.lights.vector))
    near = 1 + radius_over_distance(level, fit.lights) ** 2
    return float(fit.linearization.noise_sigma * np.exp(equal_intensity) * near)


def factored_fit(level: Level) -> Fit | None:
    """The state at the photographs' factorisation, or None; see `factored_start`."""
    small = level if np.count_nonzero(level.mask) <= FACTORED_PIXELS else level.halved()
    found = factored_start(small)
    if found is None:
        return None
    log_depth, lights = found
    if small is not level:
        log_depth = level.carried(small, log_depth)
    return first_fit(level, log_depth, lights, shared_ambient=True)


def given_fit(level: Level, given: GivenLights) -> Fit:
    """The state at the prior under given lights, which keep their directions if they are fixed.

    Near ones are distant at first, unless they are fixed: `with_near_lights` is tried later.
    """
    lights = lights_of_given(level, given)
    toward = lights.vector.mean(axis=1, keepdims=True)
    directions = toward / np.linalg.norm(toward, axis=-1, keepdims=True)
    if not given.fixed:
        lights = replace(lights, inverse_distance=np.zeros_like(lights.inverse_distance))
    fit = first_fit(level, level.prior, lights, shared_ambient=True, directions=directions)
    return replace(refine_lights(level, fit), directions=directions if given.fixed else None)


def multi_start(
    level: Level,
    descent: Descent,
    starts: Sequence[Fit],
    options: MultiLight,
    progress: ProgressCallback,
) -> Descent:
    """The descent, or one from another start, if that ends at a lower energy."""
    for start in starts:
        trial = descend(level, start, options, progress, "try another start")
        before = evaluated(level, trial.fit, descent.fit.log_depth, descent.fit.lights)
        descent = trial if trial.fit.energy < before.energy else descent
    return descent


def select_lights(
    level: Level, descent: Descent, options: MultiLight, progress: ProgressCallback
) -> Descent:
    """The descent with near or coloured lights, where these explain the photographs much better."""
    for wanted, free, already in (
        (options.distance, "near", descent.fit.near),
        (options.lights, "coloured", descent.fit.lights.ambient.shape[1] > 1),
    ):
        before = descent.fit
        held = free == "near" and before.directions is not None
        if wanted not in ("auto", free) or already or held:
            continue
        freer = with_near_lights(level, before) if free == "near" else with_coloured_lights(before)
        # Both under the loss of the simpler lights.
        simpler = replace(before, near=freer.near)
        enough = LEAST_ENERGY_GAIN / len(level.photographs) * before.energy
        trial = descend(level, freer, options, progress, f"try {free} lights")
        after = evaluated(level, simpler, trial.fit.log_depth, trial.fit.lights)
        gain = before.energy - after.energy
        if wanted == free or (gain > enough and distances_alike(after.lights)):
            descent = trial
    return descent


def acceptable(level: Level, fit: Fit, options: MultiLight) -> bool:
    """Whether near lights are asked for, given or, if there are any, plausible."""
    stated = options.distance == "near" or fit.directions is not None
    return stated or plausible(level, fit.lights)


def plausible(level: Level, lights: LightParameters) -> bool:
    """Whether distances, if any, are a lamp's in a hand: about equal, and outside the object.

    Where they only make up for another error of the model, they are random or tiny.
    """
    return distances_alike(lights) and radius_over_distance(level, lights) <= 1


def radius_over_distance(level: Level, lights: LightParameters) -> float:
    """The object's radius over the lights' median distance."""
    return float(np.median(lights.inverse_distance)) * object_radius(level)


def object_radius(level: Level) -> float:
    """The object's radius about its middle, metres."""
    return float(np.linalg.norm(level.points[level.mask], axis=-1).max())


def distances_alike(lights: LightParameters) -> bool:
    """Whether the inverse distances have a small interquartile range over their median."""
    low, middle, high = np.quantile(lights.inverse_distance, [0.25, 0.5, 0.75])
    return bool(high - low <= MOST_VARIED_DISTANCES * middle)


def with_near_lights(level: Level, fit: Fit) -> Fit:
    """The state with all lights at one distance, from where each finds its own.

    Descents from infinity fail where fall-off makes most of a flat object's shading.
    """
    inverse_distance = np.full_like(
        fit.lights.inverse_distance, FIRST_RADIUS_OVER_DISTANCE / object_radius(level)
    )
    lights = replace(fit.lights, inverse_distance=inverse_distance)
    start = first_fit(level, fit.log_depth, lights, shared_ambient=fit.shared_ambient)
    return replace(refine_lights(level, start), near=True)


def with_coloured_lights(fit: Fit) -> Fit:
    """The state with a light of its own for each channel."""
    lights = fit.lights
    each = (
        np.repeat(part, 3, axis=1)
        for part in (lights.vector, lights.ambient, lights.inverse_distance)
    )
    return replace(fit, lights=LightParameters(*each))
