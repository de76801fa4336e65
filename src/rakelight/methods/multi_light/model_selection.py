"""What is chosen at the coarsest level: the start, the light model, the depth weight.

Each is tried by a descent of its own, and the one of the least `cost` is taken.  A light per
channel is tried where that explains more, near lights count where they are near enough to matter,
beams are tried where they explain more.  At the finest level near lights are tried once more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rakelight.methods.base import scatter
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.energy import Fit, first_fit, reset_scale
from rakelight.methods.multi_light.equal_intensity import equal_intensity_energy
from rakelight.methods.multi_light.factored_start import factored_start
from rakelight.methods.multi_light.initial_lights import lights_of_given, lights_of_prior
from rakelight.methods.multi_light.light_model import LightModel
from rakelight.methods.multi_light.noise import variances_by_scale
from rakelight.methods.multi_light.options import MultiLight
from rakelight.methods.multi_light.steps import Descent, descend, refine_lights
from rakelight.model import TINY, Floats, GivenLights, ProgressCallback
from rakelight.photometry.images import LightParameters
from rakelight.solve.robust import NOTABLE, ROUNDS

# The object's radius over the distance at which all near lights start (ablation.md: halved 1.02,
# doubled 1.04), and the least at which they are near: descents are slower than with distant ones
# (halved 1.00, doubled 1.00; on lamps at 26 radii 0.05 has 1.10).
FIRST_RADIUS_OVER_DISTANCE, LEAST_RADIUS_OVER_DISTANCE = 0.15, 0.03
# Interquartile range of the lights' inverse distances, over their median, up to which they are a
# lamp's in a hand; wider ones have to be earned (ablation.md: all of them free 0.95, by one draw
# of 50).
MOST_VARIED_DISTANCES = 0.5
# Least deviation of ambient light over the surface, over its mean, from which it has a side: on
# nearly flat reliefs one is found at 0.05 to 0.16 where there is none, beside windows at 0.26 to
# 0.54 (15 scenes of an independent renderer, 40 draws with and without a window; changes.md).  On
# 50 draws halved and doubled do alike (ablation.md).
LEAST_UNEVEN = 0.2
# Of the lights at the coarsest level: they are determined on low relief, too.
SHARED_AMBIENT = LightModel(shared_ambient=True)


@dataclass(frozen=True, eq=False)
class Search:
    """What all descents at the coarsest level share.

    level : the coarsest; its depth weight is of one sensor pixel's noise
    weights : the depth weights to choose from, multiples of that, the least first
    stage : the level's name in the progress
    """

    level: Level
    weights: Sequence[float]
    options: MultiLight
    progress: ProgressCallback
    stage: str

    def select(self, given: GivenLights | None = None) -> Descent:
        """The descent of the least cost.

        given : lights that are one more start or, fixed, the only one
        """
        options = self.options
        begins = list(starts(self.level, given))
        # Under the least weight correlated errors of the sensor's depth bend the lights least.
        least, larger = self.weights[:1], self.weights[1:]
        best = self.cheapest([each for fit in begins for each in self.descents(least, fit)])
        if options.lights != "white":
            # At this depth the lights alone show already whether one per channel explains more.
            coloured = refine_lights(self.level, with_coloured_lights(best.fit))
            if options.lights == "coloured" or explains_more(self.level, coloured, best.fit):
                best = self.descents(least, coloured, "try coloured lights")[0]
                begins = [with_coloured_lights(fit) for fit in begins]
        choices = [best, *self.descents(larger, best.fit, "try a larger depth weight")]
        if options.distance != "distant" and best.fit.model.directions is None:
            near = self.near_choices(begins)
            if options.distance == "near":
                choices = near
            else:
                choices += [each for each in near if are_near(self.level, each.fit.lights)]
        choices += self.uneven_choices(begins, choices)
        if options.beam != "wide" and best.fit.model.directions is None:
            beams = self.beam_choices(begins, choices)
            choices = beams if options.beam == "narrow" else choices + beams
        best = self.with_larger_weights(self.cheapest(choices))
        own_ambient = replace(best.fit.model, shared_ambient=False)
        return replace(best, fit=replace(best.fit, model=own_ambient))

    def descents(self, weights: Sequence[float], fit: Fit, stage: str = "") -> list[Descent]:
        """A descent under each of these depth weights, begun where the one before has ended."""
        found = []
        for weight in weights:
            level = self.level.weighted(weight)
            descent = descend(level, fit, self.options, self.progress, stage or self.stage)
            found.append(replace(descent, weight=weight))
            fit = descent.fit
        return found

    def near_choices(self, begins: Sequence[Fit]) -> list[Descent]:
        """Descents with near lights, from the largest depth weight to the least.

        Their fall-off determines the relief, and finds it from a surface that is near the sensor's.
        If that surface has no relief, the lights come out so near that all shading is fall-off;
        therefore each start has a descent under the least weight as well.  If the lights come out
        far away, no smaller weight is tried, unless `options` ask for near ones.
        """
        along = partial(self.descents, stage="try near lights")
        begun = [with_near_lights(self.level, fit) for fit in begins]
        best = self.cheapest([each for fit in begun for each in along(self.weights[-1:], fit)])
        if not are_near(self.level, best.fit.lights) and self.options.distance != "near":
            return [best]
        smaller = along(self.weights[:-1][::-1], best.fit)
        again = [each for fit in begun for each in along(self.weights[:1], fit)]
        return [best, *smaller, *again]

    def uneven_choices(self, begins: Sequence[Fit], choices: Sequence[Descent]) -> list[Descent]:
        """Descents with ambient light from one side, where those explain notably more.

        They begin with the best of the choices, and where these began, under the least depth
        weight: with even ambient light a surface and near lights bend to explain it.  None where
        the best has no ambient light.
        """
        best = self.cheapest(choices)
        if not best.fit.lights.ambient.any():
            return []
        if best.fit.model.near:
            begins = [with_near_lights(self.level, fit) for fit in begins]
        same = reset_scale(self.level.weighted(best.weight), best.fit)
        found = []
        for weight, fit in [(best.weight, same), *((self.weights[0], fit) for fit in begins)]:
            uneven = replace(fit, model=replace(fit.model, ambient_direction=True))
            found += self.descents([weight], uneven, "try ambient light from one side")
        found = [each for each in found if is_uneven(self.level, each.fit)]
        return [each for each in found if explains_more(self.level, each.fit, best.fit)]

    def beam_choices(self, begins: Sequence[Fit], choices: Sequence[Descent]) -> list[Descent]:
        """Descents with beams, where those explain notably more than the best of `choices`.

        They begin with the best of distant and of near lights, under all depth weights, and where
        the choices began, under the least: without beams a surface bends to explain them.
        """
        best, along = self.cheapest(choices), partial(self.descents, stage="try beams")
        distant = [each for each in choices if not each.fit.model.near]
        near = [each for each in choices if each.fit.model.near]
        kinds = [self.cheapest(each).fit for each in (distant, near) if each]
        fits = [with_beams(self.level, each) for each in kinds]
        if self.options.beam == "auto":
            fits = [each for each in fits if explains_more(self.level, each, best.fit)]
        if not fits:
            return []
        begun = [replace(fit, model=replace(fit.model, beam=True)) for fit in begins]
        found = [each for fit in fits for each in along(self.weights, fit)]
        return [*found, *(each for fit in begun for each in along(self.weights[:1], fit))]

    def with_larger_weights(self, best: Descent) -> Descent:
        """The best descent; where its weight is the largest, one under ten times that, and so on.

        While it costs less, and at most until the weight is of the sensor's noise from pixel to
        pixel: a sensor can be more precise than its model says.
        """
        if self.options.depth_weight is not None:
            return best
        largest, relative = self.weights[-1], self.level.relative_noise_variance
        while best.weight >= largest and largest * relative < self.weights[-1]:
            largest = 10 * best.weight
            more = self.descents([largest], best.fit, "try a larger depth weight")
            best = self.cheapest([best, *more])
        return best

    def cheapest(self, choices: Sequence[Descent]) -> Descent:
        """The descent of the least cost."""
        return min(choices, key=lambda each: cost(self.level, each.fit, each.weight))


def cost(level: Level, fit: Fit, weight: float) -> float:
    """Minus twice the logarithm of the likelihood of photographs, depth and lights.

        N log(sigma^2 (1 + F^2)^2 V^2)  +  N (`sensor_cost`)
            +  (N - 4) log(variance of log |s_i|)  +  `grazing_cost`

    each with the variance that makes it most likely.  Errors are correlated within a photograph and
    within the depth map, over areas that are not known: each photograph counts as one value, the
    depth map as many as all photographs.  Lights that fall off much across the object, F of
    `squared_falloff`, would make all shading, and so would distances that vary more than a hand's,
    V times.
    Lights in given directions have none of these penalties.

    level : its depth weight is of one sensor pixel's noise
    weight : a multiple of that, under which the fit was found
    """
    photographs = 2 * np.log(penalised_sigma(level, fit)) + sensor_cost(level, fit, weight)
    total = len(level.photographs) * photographs
    if fit.model.directions is None:
        total += equal_intensity_energy(fit.lights.vector, level.photographs.exposures)
        total += grazing_cost(level, fit)
    return float(total)


def grazing_cost(level: Level, fit: Fit) -> float:
    """sum log max(1, `NOTABLE` / a_i^2), a_i the mean of max(0, n . s_i / |s_i|).

    A lamp is held to where it lights the object.  Else the flatter a surface the better: whatever
    the photographs show, lights of any strength in its plane make that of next to no relief.
    """
    normals = level.normals(fit.log_depth)[0][level.photographs.active]
    vectors = fit.lights.vector.mean(axis=1)
    size = np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny)
    arriving = np.maximum(normals @ (vectors / size).T, 0.0).mean(axis=0)
    return float(np.log(np.maximum(NOTABLE / np.maximum(arriving**2, TINY), 1.0)).sum())


def penalised_sigma(level: Level, fit: Fit) -> float:
    """sigma (1 + F^2) V, as in `cost`; sigma alone under lights in given directions."""
    sigma = fit.linearization.noise_sigma
    if fit.model.directions is not None:
        return sigma
    varied = variation_of_distances(fit.lights) / MOST_VARIED_DISTANCES
    return sigma * (1 + squared_falloff(level, fit.lights)) * max(varied, 1.0)


def explains_more(level: Level, freer: Fit, fit: Fit) -> bool:
    """Whether a state under freer lights has notably smaller residuals: `penalised_sigma`."""
    return penalised_sigma(level, freer) < (1 - NOTABLE) * penalised_sigma(level, fit)


def is_uneven(level: Level, fit: Fit) -> bool:
    """Whether ambient light differs notably from normal to normal, and is below 0 on none.

    Where normals are nearly alike, its direction follows other errors of the model.
    """
    normals = level.normals(fit.log_depth)[0][level.photographs.active]
    around = 1 + normals @ fit.lights.ambient_direction
    return bool(around.min() >= 0 and around.std() >= LEAST_UNEVEN * around.mean())


def sensor_cost(level: Level, fit: Fit, weight: float) -> float:
    """`cost_of_errors` of the sensor less the surface of a fit, found under this depth weight."""
    return cost_of_errors(level, fit, weight, level.sensed(fit.log_depth - level.unbiased_prior))


def cost_of_errors(level: Level, fit: Fit, weight: float, errors: Floats) -> float:
    """Mean over all scales of log(v_0 + 1/m + v (1 + w'/m)^2), in one sensor pixel's noise.

    v is the variance, at a scale, of sensor less surface (`variances_by_scale`); m what photographs
    say of a mode there, 1 / variance.  A surface that is held to the sensor by w has followed its
    errors, and shows m / (m + w) of what sensor and photographs differ by.  That has the sensor's
    variance, whatever makes it most likely but no less than its pixel-to-pixel noise v_0, and the
    photographs', 1/m.  Blocks of side S differ at wavelengths of 2 S to 4 S, so that
    m = M (2 pi / sqrt(8) S)^2 / sigma^2; w' is w with the noise by which the descent weighed it.

    errors : (M,) log depth of the sensor less the surface's, or the other way round
    """
    error = scatter(errors * np.sqrt(level.sensor_weight), level.seen)
    scales = variances_by_scale(error, level.seen)
    if not scales:
        return 0.0  # a single sensor pixel, to which any surface is moved
    side, modes, variance = np.transpose(scales)
    information = (np.pi / side) ** 2 / 2 * fit.linearization.typical_information(2.0)
    information = np.maximum(information / float(np.median(level.sensor_weight)), TINY)
    sigma = fit.linearization.noise_sigma
    followed = 1 + weight * fit.noise**2 / information
    each = level.relative_noise_variance + sigma**2 / information + variance * followed**2
    return float(modes @ np.log(each) / modes.sum())


def try_near_lights(level: Level, fit: Fit, options: MultiLight, progress: ProgressCallback) -> Fit:
    """The state at the finest level, or one under near lights, where these explain more.

    After `ROUNDS` steps from either.  At the coarsest level jumps and cast shadows can be most of
    the residuals, so that distant lights explain as much there.
    """
    if fit.model.near or fit.model.directions is not None or options.distance != "auto":
        return fit
    briefly, weight = replace(options, max_iterations=ROUNDS), fit.equal_intensity_weight

    def after(start: Fit) -> Fit:
        return descend(level, start, briefly, progress, "try near lights", last=True).fit

    near = after(replace(with_near_lights(level, fit), equal_intensity_weight=weight))
    if not are_near(level, near.lights) or not explains_more(level, near, fit):
        return fit
    return near if explains_more(level, near, after(fit)) else fit


def starts(level: Level, given: GivenLights | None) -> Iterator[Fit]:
    """The states to begin with: distant lights, white unless given otherwise, one ambient ratio."""
    if given is None or not given.fixed:
        yield first_fit(level, level.prior, lights_of_prior(level), SHARED_AMBIENT)
        if factored := factored_start(level):
            yield first_fit(level, *factored, SHARED_AMBIENT)
    if given is not None:
        yield given_fit(level, given)


def given_fit(level: Level, given: GivenLights) -> Fit:
    """The state at the prior under given lights, which keep their directions if they are fixed.

    Near ones are distant at first, unless they are fixed: `with_near_lights` is tried later.
    """
    lights = lights_of_given(level, given)
    toward = lights.vector.mean(axis=1, keepdims=True)
    directions = toward / np.linalg.norm(toward, axis=-1, keepdims=True)
    if not given.fixed:
        lights = replace(lights, inverse_distance=np.zeros_like(lights.inverse_distance))
    held = replace(SHARED_AMBIENT, directions=directions)
    fit = refine_lights(level, first_fit(level, level.prior, lights, held))
    return fit if given.fixed else replace(fit, model=SHARED_AMBIENT)


def are_near(level: Level, lights: LightParameters) -> bool:
    """Whether lights are near enough to matter."""
    return radius_over_distance(level, lights) >= LEAST_RADIUS_OVER_DISTANCE


def variation_of_distances(lights: LightParameters) -> float:
    """The interquartile range of the lights' inverse distances over their median; 0 if distant.

    Where distances only make up for another error of the model, they are random, tiny or huge.
    """
    low, middle, high = np.quantile(lights.inverse_distance, [0.25, 0.5, 0.75])
    return float((high - low) / max(middle, np.finfo(float).eps))


def radius_over_distance(level: Level, lights: LightParameters) -> float:
    """The object's radius over the lights' median distance."""
    return float(np.median(lights.inverse_distance)) * level.radius_m


def squared_falloff(level: Level, lights: LightParameters) -> float:
    """F^2 = (R/D)^2 + (R b/2)^2: R is the object's radius, D and b = |(b_x, b_y)| are medians.

    The logarithm of a near light falls off by 2/D per metre, that of a beam by b.
    """
    beam = float(np.median(np.linalg.norm(lights.beams[..., :2], axis=-1)))
    return radius_over_distance(level, lights) ** 2 + (level.radius_m * beam / 2) ** 2


def with_near_lights(level: Level, fit: Fit) -> Fit:
    """The state with all lights at one distance, from where each finds its own.

    Descents from infinity fail where fall-off makes most of a flat object's shading.
    """
    inverse_distance = np.full_like(
        fit.lights.inverse_distance, FIRST_RADIUS_OVER_DISTANCE / level.radius_m
    )
    lights = replace(fit.lights, inverse_distance=inverse_distance)
    distant, near = (replace(fit.model, near=each) for each in (False, True))
    start = first_fit(level, fit.log_depth, lights, distant)
    return replace(refine_lights(level, start), model=near)


def with_beams(level: Level, fit: Fit) -> Fit:
    """The state with a beam for each lamp, which they find at this depth."""
    return refine_lights(level, replace(fit, model=replace(fit.model, beam=True)))


def with_coloured_lights(fit: Fit) -> Fit:
    """The state with a light of its own for each channel."""
    lights = fit.lights
    if lights.ambient.shape[1] > 1:
        return fit
    vector, ambient, inverse_distance = (
        np.repeat(part, 3, axis=1)
        for part in (lights.vector, lights.ambient, lights.inverse_distance)
    )
    lights = replace(lights, vector=vector, ambient=ambient, inverse_distance=inverse_distance)
    # The residuals are the same; the derivatives, of one light, are to be found again for three.
    return replace(fit, lights=lights, linearization=replace(fit.linearization, light_slope=None))
