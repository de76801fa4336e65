"""What the coarsest level decides: where to start, what lights there are, what the depth weighs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rakelight.methods.levels import Level
from rakelight.methods.multi_light.energy import Fit, begun_anew, first_fit, moved
from rakelight.methods.multi_light.equal_intensity import unlikeness
from rakelight.methods.multi_light.factored_start import factored_start
from rakelight.methods.multi_light.initial_lights import lamps_of_prior
from rakelight.methods.multi_light.options import Options
from rakelight.methods.multi_light.steps import Descent, descend, settled
from rakelight.model import ProgressCallback
from rakelight.shading.photographs import Lamps

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
