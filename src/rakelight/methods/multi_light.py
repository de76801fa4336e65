"""Multi-light, solved jointly: Gauss-Newton on log depth and all lights, albedo eliminated.

    I_ic = rho_c (max(0, s_i . n) + phi_i)                                       equation (3)

The albedo is linear given the shading and is eliminated per pixel and channel (variable
projection).  The lights are few and are eliminated by a Schur complement.  Alternation (3.4)
creeps along the bas-relief valley, in which lights and depth have to move together; the joint
step does not.  Coarse to fine; Cauchy weights per photograph, pixel and channel; cast shadows and
highlights left out where they are to be expected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rakelight.geometry.grid import Grid, differences, neighbours
from rakelight.geometry.normals import normal_lengths
from rakelight.methods.bas_relief_variance import bas_relief_variance, sensor_moment
from rakelight.methods.brightness import unlikeness
from rakelight.methods.estimate import (
    Estimate,
    brightest,
    lamp_findings,
    photometric_confidence,
    require_options,
    require_photographs,
)
from rakelight.methods.expected_errors import depth_sigma, photometric_variance
from rakelight.methods.factored_start import factored_start
from rakelight.methods.fine_normals import fine_normals
from rakelight.methods.fit import (
    NOISIEST,
    Fit,
    begun_anew,
    depth_step,
    first_fit,
    moved,
    relief_step,
    rescaled,
    settled,
    stride,
)
from rakelight.methods.joint import joint_step
from rakelight.methods.levels import Level, finest_level, pyramid
from rakelight.methods.matte import dimmed, matte
from rakelight.methods.start import lamps_of_prior
from rakelight.methods.weights import deserved_steadiness, deserved_trust
from rakelight.model import Finding, Floats, Progress, ProgressCallback
from rakelight.prepare import Prepared
from rakelight.shading.photographs import Lamps
from rakelight.solve.robust import variance_beyond

# The depth's weight, in white noise's, until its errors are known; the more the fewer pixels the
# sensor has for what the photographs, together, get wrong.
FIRST_TRUST = 10.0
# A coarse level explains averaged photographs, and only roughly: the depth holds it the more.
COARSER = 2.0
# Steps at a level that is not the last; its end is not worth waiting for.
ON_THE_WAY = 3
# The loss is settled when the noise falls by less than this factor from one step to the next.
SETTLED = 0.95
# A thousandth of the trust is right where it halves what is left unexplained: the depth's errors
# hang together.  A tenth, where it is a third of that, in logarithms.
LESS_TRUST = (1e-3, 1e-2, 1e-1)
HALVED = np.log(2) / np.log(1e3)
# A level of more pixels is halved before the second start is sought: as good there, and faster
# (docs/results/random-captures.md).
FACTORED_PIXELS = 2000
# Lamps get more freedom where that lowers the energy by more than this fraction over their number:
# the fewer photographs, the more of anything it explains.
WORTH_IT = 0.5
# Near lamps begin where the object's radius is this part of their distance, all alike.
BROUGHT_NEAR = 0.15
# Largest quartile distance of the lamps' inverse distances, as a fraction of their median.
MOST_VARIED = 0.5


@dataclass(frozen=True, slots=True)
class Options:
    """What can be set; a good result needs none of it.

    depth_weight : weight of the sensor's depth, as a multiple of what white noise of the sensor's
        size would have; None chooses it from the data.  Raised, the surface keeps to the
        sensor's shape, its faults included; lowered, it follows the photographs and may slide
        along the bas-relief valley.
    lamps : "white" for one light in all channels, "coloured" for one per channel, "auto"
    distance : "distant" for parallel light, "near" for lamps at a place, "auto"
    max_iterations : most Gauss-Newton steps at the coarsest level and, twice, at the finest; the
        others take at most three
    tolerance : a level ends when a step lowers the energy by less than this fraction
    coarse_pixels : size of the coarsest level, where lights and depth move together exactly
    """

    depth_weight: float | None = None
    lamps: Literal["auto", "white", "coloured"] = "auto"
    distance: Literal["auto", "distant", "near"] = "auto"
    max_iterations: int = 40
    tolerance: float = 2e-3
    coarse_pixels: int = 4000

    def __post_init__(self) -> None:
        require_options(
            self,
            depth_weight=(self.depth_weight is None or 0 < self.depth_weight < np.inf, "above 0"),
            lamps=(self.lamps in ("auto", "white", "coloured"), "auto, white or coloured"),
            distance=(self.distance in ("auto", "distant", "near"), "auto, distant or near"),
            max_iterations=(self.max_iterations >= 1, "at least 1"),
            tolerance=(0 < self.tolerance < 1, "above 0, below 1"),
            coarse_pixels=(self.coarse_pixels >= 100, "at least 100"),
        )


def multi_light(prepared: Prepared, options: Options, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by all photographs at once.

    Raises MethodError for fewer than 3 photographs.
    """
    require_photographs(prepared, "multi-light", 3)
    trust = options.depth_weight or FIRST_TRUST * prepared.factor**2
    finest = finest_level(prepared, cut=True, unbiased=True)
    levels = [
        level.trusting(trust * COARSER**k)
        for k, level in enumerate(pyramid(finest, options.coarse_pixels))
    ]

    # The coarsest level: how much the depth is to be trusted, and what lamps there are.
    coarsest = len(levels) - 1
    share, descent = first_look(levels[-1], options, progress, stage(coarsest))
    trust *= share
    levels = [level.trusting(share) for level in levels]
    level, fit, shine = matted(levels[-1], descent.fit)
    if shine.any():
        level, fit, _ = matted(levels[-1], past_highlights(levels[-1], fit, options, progress))
    if fit is not descent.fit:
        descent = descend(level, fit, options, progress, stage(coarsest))

    # Coarse to fine: the depth's detail, then lights and depth together, until both rest.
    for index in reversed(range(coarsest)):
        log_depth = levels[index].carried(levels[index + 1], descent.fit.log_depth)
        level, _ = matte(levels[index], log_depth, descent.fit.lamps)
        fit = begun_anew(level, descent.fit, log_depth)
        # The finest level's detail first: its lights and depth move together when they are weighed.
        together = index > 0
        descent = descend(level, fit, briefly(options), progress, stage(index), together=together)

    # What is left of the sensor's depth says how its errors hang together, and what they count.
    first_trust = trust
    if options.depth_weight is None:
        trust = deserved_trust(descent.fit, prepared)
    # Highlights and shadows are where the detail puts them; jumps that the sensor blurred, or its
    # noise hid, are steep by now.
    level, fit, shine = matted(levels[0], descent.fit)
    level = level.trusting(trust / first_trust).cut(fit.log_depth)
    fit = replace(fit, steadiness=deserved_steadiness(level, fit.log_depth, prepared))
    again = descend(level, fit, options, progress, "refine, weighed", noisiest=1.0, thorough=True)
    descent = replace(again, steps=descent.steps + again.steps)
    return finished(prepared, level, descent, trust, shine)


def matted(level: Level, fit: Fit) -> tuple[Level, Fit, Floats]:
    """`matte` where the fit is, and the fit to photographs that this changed: its loss anew."""
    clear, shine = matte(level, fit.log_depth, fit.lamps)
    if clear is not level:
        fit = begun_anew(clear, fit)
    return clear, fit, shine


def past_highlights(level: Level, fit: Fit, options: Options, progress: ProgressCallback) -> Fit:
    """The fit to all values after steps without each pixel's brightest.

    Where highlights bent the surface it says little of where they are.
    """
    dim = dimmed(level)
    found = descend(dim, begun_anew(dim, fit), options, progress, "try without the brightest")
    return begun_anew(level, found.fit)


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
    options: Options,
    progress: ProgressCallback,
    stage: str,
    noisiest: float = NOISIEST,
    together: bool = True,
    thorough: bool = False,
) -> Descent:
    """Gauss-Newton steps at one level until the energy rests.

    together : whether lights move with the depth; thorough : whether to rest where strides do, too
    """
    fits: list[Fit] = []
    settled = converged = False
    for step in range(options.max_iterations):
        progress(Progress(stage, step + 1, options.max_iterations, fit.energy))
        if not settled:
            # The residuals' scale falls as they do; once it rests, one energy is lowered.
            noise, fit = fit.noise, rescaled(level, fit, noisiest)
            settled = step > 0 and fit.noise > SETTLED * noise
            fits = [fit]
        before = fit
        fit = depth_step(level, fit)
        if together:
            fit = joint_step(level, fit, options.coarse_pixels)
        fit = relief_step(level, fit)
        small = options.tolerance * before.energy
        if settled and (thorough or before.energy - fit.energy >= small):
            fit = stride(level, before, fit)
        converged = settled and before.energy - fit.energy < small
        if converged and fit.energy > before.energy:
            break  # what the photographs gained was a bas-relief that the sensor contradicts
        fits.append(fit)
        if converged:
            break
    return Descent(tuple(fits), converged, step + 1)


def first_look(
    level: Level, options: Options, progress: ProgressCallback, stage: str
) -> tuple[float, Descent]:
    """The share of the trust that the depth deserves, and the descent with that.

    From distant white lamps with as much ambient light each; more freedom where it is worth it.
    """
    fit = first_fit(level, level.prior, lamps_of_prior(level), one_ambient=True)
    simple = descend(level, fit, options, progress, stage)
    factored = from_factors(level)
    simple = second_start(level, simple, factored, options, progress)
    for distance in (options.distance, "distant"):
        these = replace(options, distance=distance)
        descent = freer_lamps(level, simple, these, progress)
        share, descent = less_trust(level, descent, these, progress, factored)
        if share < 1:
            descent = freer_lamps(level.trusting(share), descent, these, progress)
        if accepted(level, descent.fit.lamps, options):
            break
    fit = replace(descent.fit, one_ambient=False)
    return share, replace(descent, fits=(*descent.fits[:-1], fit))


def less_trust(
    level: Level,
    descent: Descent,
    options: Options,
    progress: ProgressCallback,
    factored: Fit | None = None,
) -> tuple[float, Descent]:
    """The share of the level's trust, and the descent with it, that explain the photographs best.

    factored : another fit to start from, where it leaves less unexplained: with all its trust, the
        descent may be bent to the sensor's noise

    Errors of the depth that hang together count as less than they are many.  How they do, nobody
    knows before the photographs have shown them, which too large a weight prevents.
    """
    chosen, fit = (1.0, descent), descent.fit
    if options.depth_weight is not None:
        return chosen
    least = unexplained(level, fit) if accepted(level, fit.lamps, options) else np.inf
    floor = 0.0
    if fit.near:
        fit = brought_near(level, fit)
    for share in LESS_TRUST:
        price = share**-HALVED
        if floor * price >= least:
            continue  # what even less trust leaves unexplained is too much
        loose = level.trusting(share)
        words = "try less trust in the depth"
        start = begun_anew(loose, fit)
        if factored is not None and not fit.near:
            start = min(
                start, begun_anew(loose, factored), key=lambda each: each.explanation.spread
            )
        tried = descend(loose, start, options, progress, words)
        left = unexplained(level, tried.fit)
        floor = max(floor, left)
        if left * price < least and accepted(level, tried.fit.lamps, options):
            chosen, least = (share, tried), left * price
    return chosen


def unexplained(level: Level, fit: Fit) -> float:
    """The residuals' scale, the larger the less alike the lamps' brightness, and the nearer they.

    On low relief a flat surface explains photographs nearly as well as the right one, by lamps that
    are bright here and dark there, or so near that light falls off like anything.
    """
    alike = unlikeness(fit.lamps.vector) / (4 * len(fit.lamps.vector))
    near = 1 + reach(level, fit.lamps) ** 2
    return float(fit.explanation.spread * np.exp(alike) * near)


def from_factors(level: Level) -> Fit | None:
    """The fit where the photographs' factors lead, or None; see `factored_start`."""
    small = level if np.count_nonzero(level.mask) <= FACTORED_PIXELS else level.halved()
    found = factored_start(small)
    if found is None:
        return None
    log_depth, lamps = found
    if small is not level:
        log_depth = level.carried(small, log_depth)
    return first_fit(level, log_depth, lamps, one_ambient=True)


def second_start(
    level: Level,
    descent: Descent,
    factored: Fit | None,
    options: Options,
    progress: ProgressCallback,
) -> Descent:
    """The descent, or the one from another fit, if that ends lower."""
    if factored is None:
        return descent
    tried = descend(level, factored, options, progress, "try the photographs' lamps")
    before = moved(level, tried.fit, descent.fit.log_depth, descent.fit.lamps)
    return tried if tried.fit.energy < before.energy else descent


def briefly(options: Options) -> Options:
    """The options with no more steps than a level on the way takes."""
    return replace(options, max_iterations=min(options.max_iterations, ON_THE_WAY))


def freer_lamps(
    level: Level, descent: Descent, options: Options, progress: ProgressCallback
) -> Descent:
    """The descent with coloured or near lamps, where these explain the photographs much better."""
    for wanted, free, already in (
        (options.distance, "near", descent.fit.near),
        (options.lamps, "coloured", descent.fit.lamps.ambient.shape[1] > 1),
    ):
        before = descent.fit
        if wanted not in ("auto", free) or already:
            continue
        freer = brought_near(level, before) if free == "near" else coloured(before)
        # All under the loss of the simpler lamps.
        alike = replace(before, near=freer.near)
        enough = WORTH_IT / len(level.photographs) * before.energy
        tried = descend(level, freer, options, progress, f"try {free} lamps")
        after = moved(level, alike, tried.fit.log_depth, tried.fit.lamps)
        gain = before.energy - after.energy
        if wanted == free or (gain > enough and similar(after.lamps)):
            descent = tried
    return descent


def accepted(level: Level, lamps: Lamps, options: Options) -> bool:
    """Whether distances are asked for or, if there are any, sound."""
    return options.distance == "near" or sound(level, lamps)


def sound(level: Level, lamps: Lamps) -> bool:
    """Whether distances, if any, are those of lamps in a hand: alike, and outside the object.

    Where they only make up for another fault of the model they come out at random, or tiny.
    """
    return similar(lamps) and reach(level, lamps) <= 1


def reach(level: Level, lamps: Lamps) -> float:
    """The object's radius as a part of the lamps' distance."""
    return float(np.median(lamps.closeness)) * object_radius(level)


def object_radius(level: Level) -> float:
    """Of the object about its middle, metres."""
    return float(np.linalg.norm(level.points[level.mask], axis=-1).max())


def similar(lamps: Lamps) -> bool:
    """Whether distances, if any, differ little."""
    low, middle, high = np.quantile(lamps.closeness, [0.25, 0.5, 0.75])
    return bool(high - low <= MOST_VARIED * middle)


def brought_near(level: Level, fit: Fit) -> Fit:
    """The fit with all lamps at one distance, from which each may find its own.

    From infinity they go astray where fall-off is most of what a flat object shows.
    """
    closeness = np.full_like(fit.lamps.closeness, BROUGHT_NEAR / object_radius(level))
    lamps = replace(fit.lamps, closeness=closeness)
    alike = first_fit(level, fit.log_depth, lamps, one_ambient=fit.one_ambient)
    return replace(settled(level, alike), near=True)


def coloured(fit: Fit) -> Fit:
    """The fit with a light of its own for each channel."""
    lamps = fit.lamps
    each = (np.repeat(part, 3, axis=1) for part in (lamps.vector, lamps.ambient, lamps.closeness))
    return replace(fit, lamps=Lamps(*each))


def stage(index: int) -> str:
    """What the progress says of a level."""
    return f"refine 1/{2**index}" if index else "refine"


def finished(
    prepared: Prepared, level: Level, descent: Descent, trust: float, shine: Floats
) -> Estimate:
    """The estimate of the finest level, the albedo's 99th percentile set to 1.

    trust : of the depth; shine : (E,) heights of the highlights, for the notes
    """
    fit, active = descent.fit, level.photographs.active
    normals, explanation = fine_normals(level, fit)
    albedo = explanation.albedo
    gain = brightest(albedo[active])
    lights = fit.lamps.brighter(gain).as_lights(level.middle_m)
    notes = [Finding("note", "depth-weight", f"depth weight {trust:.3g} times white noise's")]
    if shine.any():
        height = f"{shine.sum() / gain:.2f} of white paint's brightness"
        notes.append(Finding("note", "highlights", f"highlights up to {height}, left out"))
    moment = sensor_moment(level, fit.log_depth)
    relief = bas_relief_variance(level, fit.log_depth, fit.lamps, moment)
    bend, noise = missed_bend(normals, level.grid), shared_noise(level, fit)
    local = photometric_variance(level, fit, noise) + bend
    return Estimate(
        log_depth=fit.log_depth,
        albedo=albedo / gain,
        confidence=np.where(active, confidence(level, fit, noise, bend + relief), 0.0),
        lights=lights,
        normals=normals,
        energy=tuple(each.energy for each in descent.fits),
        steps=descent.steps,
        converged=descent.converged,
        findings=(*lamp_findings(lights, prepared.names), *notes),
        depth_sigma=depth_sigma(level, fit, prepared, local, moment),
        normal_sigma=np.degrees(np.sqrt(local + relief)),
    )


def shared_noise(level: Level, fit: Fit) -> Floats:
    """(h, w) standard deviation of a value as if the photographs shared nothing.

    Noise averages over the photographs.  Residuals of a pixel beyond it are the model's errors,
    shadows and highlights, which the photographs share.
    """
    shared = variance_beyond(fit.noise, fit.explanation.misfit)
    return np.asarray(np.sqrt(fit.noise**2 + len(level.photographs) * shared))


def confidence(level: Level, fit: Fit, noise: Floats, beside: Floats) -> Floats:
    """(h, w) how well each normal is known; see `photometric_confidence`.

    What is not known of a normal is averaged with its neighbours', which share its errors.  What is
    not known of the whole surface's shape is not known of any normal.
    """
    gradient, photographs = fit.surface.gradient, level.photographs
    length = normal_lengths(gradient[..., 0], gradient[..., 1], photographs.camera)
    return photometric_confidence(
        fit.explanation.tensor, noise, length, photographs.camera, photographs.active, beside
    )


def missed_bend(normals: Floats, grid: Grid) -> Floats:
    """(h, w) squared angle, radians, that a depth map's differences miss where normals bend.

    The mean of those to both sides is the slope's over two pixels, which is off the slope in the
    middle by a sixth of its second difference.

    >>> bend = np.array([[[-0.08, 0, -1], [0, 0, -1], [-0.08, 0, -1]]])
    >>> missed_bend(bend, np.ones((1, 3), bool)).round(6).tolist()
    [[0.0, 0.000711, 0.0]]
    """
    total = np.zeros(normals.shape[:2])
    for axis in (0, 1):
        both = np.logical_and(*neighbours(grid, axis))
        for component in np.moveaxis(normals, -1, 0):
            ahead, behind = differences(component, grid, axis)
            total += np.where(both, (ahead - behind) ** 2, 0.0) / 36
    return np.nan_to_num(total)  # what is beside a pixel without a normal is not seen
