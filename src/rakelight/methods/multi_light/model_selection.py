"""What the coarsest level decides: where to start, what lights there are, what the depth weighs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rakelight.methods.levels import Level
from rakelight.methods.multi_light.energy import Fit, evaluated, first_fit, reset_scale
from rakelight.methods.multi_light.equal_intensity import equal_intensity_energy
from rakelight.methods.multi_light.factored_start import factored_start
from rakelight.methods.multi_light.initial_lights import lamps_of_prior
from rakelight.methods.multi_light.options import MultiLight
from rakelight.methods.multi_light.steps import Descent, descend, refine_lights
from rakelight.model import ProgressCallback
from rakelight.photometry.images import Lamps

# Factors of the first depth weight that are tried at the coarsest level.  The sensor's errors are
# correlated over an unknown area, and count as that many times fewer.
WEIGHT_FACTORS = (1e-3, 1e-2, 1e-1)
# A factor is taken where it lowers the residuals' scale by more than its power of this: a
# thousandth where it halves them (ablation.md: halved 0.84, doubled 1.07, one draw of 12 each).
FACTOR_EXPONENT = np.log(2) / np.log(1e3)
# Pixels of the object: a level of more is halved before the second start is sought, which is as
# good there and faster (docs/results/random-captures.md).
FACTORED_PIXELS = 2000
# Near or coloured lights are taken where they lower the energy by more than this, as a fraction,
# over the number of photographs: the fewer these are, the more of anything more numbers explain.
LEAST_GAIN = 0.5
# The object's radius over the distance at which all near lights begin.
FIRST_CLOSENESS = 0.15
# Largest interquartile range of the lights' inverse distances, as a fraction of their median, of a
# lamp in a hand.
MOST_VARIED_DISTANCES = 0.5


def select_model(
    level: Level, options: MultiLight, progress: ProgressCallback, stage: str
) -> tuple[float, Descent]:
    """The factor of the level's depth weight that fits best, and the descent with it.

    From distant white lights with the same share of ambient light; near and coloured ones where
    they explain much more.  Where near ones come out implausible, all is chosen again without.
    """
    fit = first_fit(level, level.prior, lamps_of_prior(level), shared_ambient=True)
    simple = descend(level, fit, options, progress, stage)
    factored = factored_fit(level)
    simple = second_start(level, simple, factored, options, progress)
    for distance in (options.distance, "distant"):
        these = replace(options, distance=distance)
        descent = select_lights(level, simple, these, progress)
        factor, descent = search_depth_weight(level, descent, these, progress, factored)
        if factor < 1:
            descent = select_lights(level.weighted(factor), descent, these, progress)
        if acceptable(level, descent.fit.lamps, options):
            break
    fit = replace(descent.fit, shared_ambient=False)
    return factor, replace(descent, fits=(*descent.fits[:-1], fit))


def search_depth_weight(
    level: Level,
    descent: Descent,
    options: MultiLight,
    progress: ProgressCallback,
    factored: Fit | None = None,
) -> tuple[float, Descent]:
    """The factor of the level's depth weight, and the descent with it, that explain the
    photographs best for their price.

    factored : another fit to start from, where its residuals are smaller: under the whole weight
        the descent may have been bent to the sensor's noise

    Correlated errors of the depth count less than their number.  How far they are correlated, only
    a surface shows that follows the photographs, and too large a weight prevents it.
    """
    chosen, fit = (1.0, descent), descent.fit
    if options.depth_weight is not None:
        return chosen
    least = penalised_noise(level, fit) if acceptable(level, fit.lamps, options) else np.inf
    floor = 0.0
    if fit.near:
        fit = with_near_lights(level, fit)
    for factor in WEIGHT_FACTORS:
        price = factor**-FACTOR_EXPONENT
        if floor * price >= least:
            continue  # residuals under a smaller weight still are too large for this price
        loose = level.weighted(factor)
        words = "try a smaller depth weight"
        start = reset_scale(loose, fit)
        if factored is not None and not fit.near:
            start = min(
                start, reset_scale(loose, factored), key=lambda each: each.explanation.spread
            )
        tried = descend(loose, start, options, progress, words)
        left = penalised_noise(level, tried.fit)
        floor = max(floor, left)
        if left * price < least and acceptable(level, tried.fit.lamps, options):
            chosen, least = (factor, tried), left * price
    return chosen


def penalised_noise(level: Level, fit: Fit) -> float:
    """The residuals' scale, times more the less alike the lights' intensities and the nearer they.

    On low relief a flat surface explains photographs nearly as well as the right one, under lights
    of very different intensity, or so near that their fall-off makes the shading.
    """
    alike = equal_intensity_energy(fit.lamps.vector) / (4 * len(fit.lamps.vector))
    near = 1 + radius_over_distance(level, fit.lamps) ** 2
    return float(fit.explanation.spread * np.exp(alike) * near)


def factored_fit(level: Level) -> Fit | None:
    """The fit where the photographs' factors lead, or None; see `factored_start`."""
    small = level if np.count_nonzero(level.mask) <= FACTORED_PIXELS else level.halved()
    found = factored_start(small)
    if found is None:
        return None
    log_depth, lamps = found
    if small is not level:
        log_depth = level.carried(small, log_depth)
    return first_fit(level, log_depth, lamps, shared_ambient=True)


def second_start(
    level: Level,
    descent: Descent,
    factored: Fit | None,
    options: MultiLight,
    progress: ProgressCallback,
) -> Descent:
    """The descent, or the one from another fit, if that ends lower."""
    if factored is None:
        return descent
    tried = descend(level, factored, options, progress, "try the photographs' lamps")
    before = evaluated(level, tried.fit, descent.fit.log_depth, descent.fit.lamps)
    return tried if tried.fit.energy < before.energy else descent


def select_lights(
    level: Level, descent: Descent, options: MultiLight, progress: ProgressCallback
) -> Descent:
    """The descent with coloured or near lamps, where these explain the photographs much better."""
    for wanted, free, already in (
        (options.distance, "near", descent.fit.near),
        (options.lamps, "coloured", descent.fit.lamps.ambient.shape[1] > 1),
    ):
        before = descent.fit
        if wanted not in ("auto", free) or already:
            continue
        freer = with_near_lights(level, before) if free == "near" else with_coloured_lights(before)
        # Both under the loss of the simpler lights.
        alike = replace(before, near=freer.near)
        enough = LEAST_GAIN / len(level.photographs) * before.energy
        tried = descend(level, freer, options, progress, f"try {free} lamps")
        after = evaluated(level, alike, tried.fit.log_depth, tried.fit.lamps)
        gain = before.energy - after.energy
        if wanted == free or (gain > enough and distances_alike(after.lamps)):
            descent = tried
    return descent


def acceptable(level: Level, lamps: Lamps, options: MultiLight) -> bool:
    """Whether near lights are asked for or, if there are any, plausible."""
    return options.distance == "near" or plausible(level, lamps)


def plausible(level: Level, lamps: Lamps) -> bool:
    """Whether distances, if any, are those of a lamp in a hand: alike, and outside the object.

    Where they only make up for another error of the model they come out at random, or tiny.
    """
    return distances_alike(lamps) and radius_over_distance(level, lamps) <= 1


def radius_over_distance(level: Level, lamps: Lamps) -> float:
    """The object's radius as a part of the lamps' distance."""
    return float(np.median(lamps.closeness)) * object_radius(level)


def object_radius(level: Level) -> float:
    """Of the object about its middle, metres."""
    return float(np.linalg.norm(level.points[level.mask], axis=-1).max())


def distances_alike(lamps: Lamps) -> bool:
    """Whether distances, if any, differ little."""
    low, middle, high = np.quantile(lamps.closeness, [0.25, 0.5, 0.75])
    return bool(high - low <= MOST_VARIED_DISTANCES * middle)


def with_near_lights(level: Level, fit: Fit) -> Fit:
    """The fit with all lights at one distance, from which each may find its own.

    Descents from infinity fail where fall-off makes most of a flat object's shading.
    """
    closeness = np.full_like(fit.lamps.closeness, FIRST_CLOSENESS / object_radius(level))
    lamps = replace(fit.lamps, closeness=closeness)
    alike = first_fit(level, fit.log_depth, lamps, shared_ambient=fit.shared_ambient)
    return replace(refine_lights(level, alike), near=True)


def with_coloured_lights(fit: Fit) -> Fit:
    """The fit with a light of its own for each channel."""
    lamps = fit.lamps
    each = (np.repeat(part, 3, axis=1) for part in (lamps.vector, lamps.ambient, lamps.closeness))
    return replace(fit, lamps=Lamps(*each))
