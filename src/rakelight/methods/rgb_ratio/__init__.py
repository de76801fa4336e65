"""RGB ratio model (3.3): one photograph under a red, a green and a blue lamp.

Each channel sees its own lamp (l_c, phi_c), so that one photograph is three:

    I_c = rho_c (l_c . n + phi_c)

Light, albedo and depth in turn.  For the depth, the normalisation of n = m / |m| cancels in the
ratio of two channels c, d, which leaves an equation that is linear in the gradient of log depth:

    (I_c - rho_c phi_c) rho_d l_d . m = (I_d - rho_d phi_d) rho_c l_c . m

Beyond the paper: lamps may be near (lights.py), the albedo has a prior of the few colours that most
objects have, and the weight of an equation depends on its residual around the pixel.  Where albedo
is taken for shape or the reverse, neighbouring equations contradict each other, and the sensor's
depth stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.averaging import data_terms
from rakelight.geometry.grid import has_gradient, mean_gradient
from rakelight.methods.base import (
    AMBIGUOUS,
    Estimate,
    Method,
    brightest,
    first_only,
    photometric_confidence,
    require_ranges,
    require_types,
    scatter,
)
from rakelight.methods.levels import Level, first_photograph
from rakelight.methods.rgb_ratio.findings import dark_channels, rgb_findings
from rakelight.methods.rgb_ratio.lights import (
    arriving_lights,
    as_lights,
    distance_step,
    lights_step,
    shading_by,
)
from rakelight.methods.rgb_ratio.ratios import Ratios
from rakelight.model import MAD_TO_SIGMA, TINY, Floats, Mask, Progress, ProgressCallback
from rakelight.photometry.color_modes import nearest_colors
from rakelight.photometry.piecewise_albedo import edge_weights, piecewise_smooth
from rakelight.prepare import Prepared
from rakelight.solve import Solution, assemble, solve
from rakelight.solve.robust import NOTABLE

# Least standard deviation of a value (white is 1): with less the ratios' weights would be absurd.
SMALLEST_NOISE = 1e-2
# Bounds of the depth weight, 1/variance relative to white noise's, and the factor by which it has
# to grow for another solve.
LEAST_WEIGHT, MOST_WEIGHT, LEAST_INCREASE = 0.03, 3.0, 1.5
# Area, pixels, over which errors of the ratios are correlated, whatever those of the depth.
CORRELATION_AREA_PX = 0.2
# Mean square of the depth's change, relative to what its first and second differences predict,
# beyond which the change is a drift by misread albedo.
DRIFT = 15.0
# Weight of the sensor's slopes, over 1 / mean square of their change.
SLOPE_WEIGHT = 0.01
# Least shading and albedo, where both are divided by.
LEAST_SHADING, LEAST_ALBEDO = 0.02, 0.01
# Rounds of light and albedo before the first depth step; and of these and the lamps' distance: it
# stays where the depth moves, which would take up what it is off by.
FIRST_ROUNDS, DISTANCE_ROUNDS = 2, 8


@dataclass(frozen=True, slots=True)
class RgbRatio:
    """What can be set; a good result needs none of it.

    lambda_rho : smoothness of the albedo within an area of paint, relative to the photograph.
        Raised, areas become even; lowered, the albedo takes up shading, and relief is lost.
    sigma_c : albedo difference (root sum of squares over the channels, white is 1) that is an
        edge of the paint.  Raised, faint edges become relief; lowered, noise breaks up the areas.
    sigma_d : depth difference between neighbours, metres, that is an edge of the paint too.
        Raised, areas reach across depth edges; lowered, steep slopes break them up.
    lambda_palette : weight of the commonest colours, of those around the albedo, relative to
        the photograph.  Raised, faint paint becomes relief; 0 is the paper's albedo.
    laplacian : weight of the squared second differences of log depth, relative to the prior's
        weight in the middle.  Raised, noise and fine relief are smoothed away; 0 smooths nothing.
    depth_weight : weight of the sensor's depth, as a multiple of what white noise of the sensor's
        size would have; None chooses it from the data.  Raised, the surface keeps to the
        sensor's shape, its faults included; lowered, it follows the photograph, its misread paint
        included.
    max_iterations : rounds of light, albedo and depth.
    tolerance : the rounds end when one moves the depth by less than this (root mean square),
        as a multiple of the sensor's noise.  Lowered, there are more rounds.
    """

    lambda_rho: float = 30.0
    sigma_c: float = 0.03
    sigma_d: float = 0.02
    lambda_palette: float = 7.5
    laplacian: float = 0.0
    depth_weight: float | None = None
    max_iterations: int = 20
    tolerance: float = 0.3

    def __post_init__(self) -> None:
        require_types(self)
        require_ranges(
            self,
            from_0=("lambda_rho", "lambda_palette", "laplacian", "max_iterations", "tolerance"),
            above_0=("sigma_c", "sigma_d", "depth_weight"),
        )


@dataclass(frozen=True, slots=True)
class Fit:
    """What light, albedo and depth have come to.

    log_depth : (h, w); albedo : (h, w, 3); light : (3, 4) at the object's middle, phi last
    inverse_distance : of the lamps from there, 1/metre, 0 for distant ones
    tensor : (h, w, 3) of the last equations of depth; energies : before each round, and at the end
    moved : by the last round, root mean square, in the sensor's deviations; infinite without one
    refused : whether the last round found no depth
    """

    log_depth: Floats
    albedo: Floats
    light: Floats
    inverse_distance: float
    tensor: Floats
    energies: tuple[float, ...]
    moved: float
    refused: bool


def rgb_ratio(prepared: Prepared, options: RgbRatio, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by the RGB ratio model (3.3), from the first photograph.

    Under distant lamps, and under near ones, which are taken where the equations then fit notably
    better: with paint of many colours their distance is uncertain.
    """
    level, mask = first_photograph(prepared), prepared.mask
    # Two channels make one equation, which nothing can contradict: then the depth is kept.
    rounds = 0 if dark_channels(level.image[mask]) else options.max_iterations
    fit = alternated(level, prepared, options, rounds, progress)
    if rounds and not fit.refused:
        inverse_distance = found_distance(level, options)
        if inverse_distance * level.radius_m > NOTABLE:
            near = alternated(level, prepared, options, rounds, progress, inverse_distance)
            if near.energies[-1] < (1 - NOTABLE) * fit.energies[-1]:
                fit = near
    _, length = level.normals(fit.log_depth)
    confidence = photometric_confidence(fit.tensor, 1.0, length, prepared.camera, mask)
    return Estimate(
        log_depth=fit.log_depth,
        albedo=np.where(mask[..., None], fit.albedo, 0.0),
        confidence=np.where(has_gradient(level.links), confidence, 0.0),
        lights=as_lights(level, fit.light, fit.inverse_distance),
        energy=fit.energies,
        converged=rounds == 0 or fit.moved <= options.tolerance,
        findings=(
            *((AMBIGUOUS,) if rounds else ()),
            *first_only(prepared, "rgb-ratio"),
            *rgb_findings(prepared, level.image[mask], fit.light),
        ),
    )


def alternated(
    level: Level, prepared: Prepared, options: RgbRatio, rounds: int, progress: ProgressCallback,
    inverse_distance: float = 0.0,
) -> Fit:  # fmt: skip
    """Light, albedo and depth in turn, so many rounds at most.

    inverse_distance : of the lamps, as in `arriving_lights`
    """
    mask, noise = level.mask, noise_sigma(level.image, level.mask)
    depth_weight = options.depth_weight or LEAST_WEIGHT
    most = options.depth_weight or MOST_WEIGHT
    log_depth = level.prior
    albedo: Floats = np.ones((*mask.shape, 3))
    light: Floats = np.tile([0.0, 0.0, -1.0, 0.0], (3, 1))
    tensor: Floats = np.zeros((*mask.shape, 3))
    moved, refused = np.inf, False
    energies: list[float] = []
    for done in range(rounds + 1):
        normals, _ = level.normals(log_depth)
        depth_m = np.exp(log_depth)
        for again in range(1 if done else FIRST_ROUNDS):
            first = done == again == 0
            albedo, light = light_and_albedo(
                level, normals, depth_m, albedo, light, inverse_distance, options, first
            )
        arriving = arriving_lights(level, light, inverse_distance)
        equations = Ratios(level.image, level.shaded, noise, albedo, arriving)
        energies.append(equations.energy(normals))
        if done == rounds or moved <= options.tolerance:
            break
        stage = "refine, near lamps" if inverse_distance else "refine"
        progress(Progress(stage, done + 1, rounds, energies[-1]))
        found = weighed_depth(level, equations, depth_weight, most, log_depth, options.laplacian)
        refused = found is None
        if found is None:
            break  # the depth stays, and has not come to rest
        before = log_depth
        log_depth, tensor, depth_weight = found
        step = (log_depth - before) * prepared.depth_m / prepared.sigma_m
        moved = float(np.sqrt(np.mean(step[mask] ** 2)))
    return Fit(
        log_depth, albedo, light, inverse_distance, tensor, tuple(energies), moved, refused
    )  # fmt: skip


def found_distance(level: Level, options: RgbRatio) -> float:
    """The lamps' inverse distance, 1/metre, found with light and albedo by the prepared depth."""
    depth_m, (normals, _) = np.exp(level.prior), level.normals(level.prior)
    albedo: Floats = np.ones((*level.mask.shape, 3))
    light: Floats = np.tile([0.0, 0.0, -1.0, 0.0], (3, 1))
    found = 0.0
    for again in range(DISTANCE_ROUNDS):
        albedo, light = light_and_albedo(
            level, normals, depth_m, albedo, light, found, options, again == 0
        )
        found = distance_step(level, normals, albedo, light, found)
    return found


def light_and_albedo(
    level: Level, normals: Floats, depth_m: Floats, albedo: Floats, light: Floats,
    inverse_distance: float, options: RgbRatio, first: bool,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Steps 1 and 2: albedo (h, w, 3) and light (3, 4), n fixed."""
    light = lights_step(level, normals, albedo, light, inverse_distance)
    shading = shading_by(arriving_lights(level, light, inverse_distance), normals)
    albedo, gain = albedo_step(level, shading, depth_m, albedo, options, first)
    return albedo, light * gain[:, None]


def noise_sigma(image: Floats, mask: Mask) -> float:
    """Standard deviation of a value of `image` (h, w, 3), at least `SMALLEST_NOISE`.

    Of mixed second differences, in which neither slopes nor straight edges along an axis are.
    """
    mixed = np.diff(np.diff(np.where(mask[..., None], image, np.nan), axis=0), axis=1) / 2
    mixed = np.abs(mixed[np.isfinite(mixed)])
    noise = MAD_TO_SIGMA * float(np.median(mixed)) if mixed.size else 0.0
    return max(noise, SMALLEST_NOISE)


def albedo_step(
    level: Level, shading: Floats, depth_m: Floats, albedo: Floats, options: RgbRatio, first: bool
) -> tuple[Floats, Floats]:
    """2. The albedo (h, w, 3), light and n fixed; (3,) what its 99th percentiles were, now 1.

    shading : (h, w, 3) of the light and n
    Edges and colours are those of the albedo before; at first, of the photograph over its shading.
    """
    from scipy.ndimage import gaussian_filter

    mask = level.mask
    shading = np.maximum(shading, LEAST_SHADING)
    weight = np.where(level.shaded, shading**2, 0.0)
    target = level.image / shading

    def smoothed(like: Floats, target: Floats, weight: Floats) -> Floats:
        edges = edge_weights(like, depth_m, mask, sigma_c=options.sigma_c, sigma_d=options.sigma_d)
        smooth = piecewise_smooth(target, weight, edges, options.lambda_rho, mask, tolerance=1e-2)
        return np.maximum(smooth, LEAST_ALBEDO)

    if first:
        albedo = gaussian_filter(level.image, 1.0, axes=(0, 1)) / shading
    albedo = smoothed(albedo, target, weight)
    if options.lambda_palette > 0:
        color, alike = nearest_colors(np.log(albedo[mask]))
        palette_weight = options.lambda_palette * scatter(alike, mask)[..., None]
        common = scatter(np.exp(color), mask)
        total = weight + palette_weight
        target = (weight * target + palette_weight * common) / np.maximum(
            total, np.finfo(float).tiny
        )
        albedo = smoothed(albedo, target, total)
    gain = np.array([brightest(albedo[mask, c]) for c in range(3)])
    return albedo / gain, gain


def weighed_depth(
    level: Level,
    equations: Ratios,
    depth_weight: float,
    most: float,
    log_depth: Floats,
    laplacian: float,
) -> tuple[Floats, Floats, float] | None:
    """3. The log depth, the tensor of its equations, and the depth weight as it is estimated then.

    None where the solver does not find the depth.
    """
    # First least squares, then a robust loss about that surface.
    for robust in (False, True):
        solution, tensor = depth_step(level, equations, depth_weight, log_depth, robust, laplacian)
        if not solution.converged:
            return None
        log_depth = solution.value
    while (
        estimated := min(depth_weight_from_change(level, log_depth, depth_weight), most)
    ) > LEAST_INCREASE * depth_weight:
        depth_weight = estimated
        solution, tensor = depth_step(level, equations, depth_weight, log_depth, True, laplacian)
        if not solution.converged:
            return None
        log_depth = solution.value
    return log_depth, tensor, depth_weight


def depth_step(
    level: Level,
    equations: Ratios,
    depth_weight: float,
    log_depth: Floats,
    robust: bool,
    laplacian: float,
) -> tuple[Solution, Floats]:
    """The log depth (h, w), light and rho fixed, and the tensor (h, w, 3) of its equations.

    robust : whether equations have less weight where their residual at `log_depth` is large
    """
    camera, mask = level.camera, level.mask
    ratios, rhs = equations.terms(*level.normals(log_depth), camera, robust)
    tensor = ratios
    if robust:  # where the equations have little weight, the sensor's slopes stay
        slopes, changed = (
            np.stack(mean_gradient(image, level.links), axis=-1)
            for image in (level.prior, log_depth - level.prior)
        )
        weight = SLOPE_WEIGHT / max(float(np.median(changed[mask] ** 2)), 1e-12)
        tensor, rhs = ratios + weight * np.array([1.0, 0.0, 1.0]), rhs + weight * slopes
    weighted = depth_weight * level.prior_weight
    smooth = laplacian * float(np.median(weighted[mask])) or None
    sensor = data_terms(level.averaging, weighted, level.prior)
    system = assemble(
        mask, tensor, rhs, pair_weights=level.links.pairs, laplacian_weight=smooth, **sensor
    )
    return solve(system, start=log_depth, origin=level.prior, tolerance=1e-3), ratios


def depth_weight_from_change(level: Level, log_depth: Floats, depth_weight: float) -> float:
    """The weight of the sensor's depth, from the depth's change under `depth_weight`.

    Errors e of the sensor that are correlated over l pixels count l^2 times less than independent
    ones.  If there is one such length, <e^2> / <|de|^2> and <|de|^2> / <|dde|^2> are about l^2; of
    a surface that follows misread albedo the first is much larger, and the weight has to grow.
    White noise, l = 1/2 after preparation, has hardly an error in the shape as a whole: hence the
    second term.  (Medians, so that jumps do not count.)
    """
    change = np.where(level.mask, log_depth - level.prior, np.nan)
    steps = [np.diff(change, axis=axis) for axis in (0, 1)]
    bends = [np.diff(step, axis=axis) for axis, step in enumerate(steps)]
    whole, steep, bent = (
        _median(np.concatenate([each.ravel() for each in images]) ** 2)
        for images in ([change - np.nanmedian(change)], steps, bends)
    )
    if whole * bent > DRIFT * steep**2:
        depth_weight = 3 * depth_weight
    rough = bent / max(steep, TINY)
    return max(depth_weight, CORRELATION_AREA_PX * rough, 1.5 * CORRELATION_AREA_PX * rough**2)


def _median(values: Floats) -> float:
    """Median of the finite values; 0 where there are none, as on an object one pixel wide."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else 0.0


METHOD = Method("rgb-ratio", rgb_ratio, RgbRatio, lighting="rgb-leds")
