"""Both error models: how far the sensor's errors and the photographs' are correlated.

From that the weights of the energy's priors.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rakelight.geometry.cells import cell_sums
from rakelight.geometry.derivatives import gradient_image
from rakelight.jit import side_by_side, worth_side_by_side
from rakelight.methods.base import in_one_plane, scatter
from rakelight.methods.levels import CORRELATION_PX, Level, sensor_error
from rakelight.methods.multi_light.energy import Fit
from rakelight.model import MAD_TO_SIGMA, TINY, Floats, Mask
from rakelight.photometry.forward import arriving, shadings
from rakelight.photometry.specular import Highlights
from rakelight.prepare import Prepared
from rakelight.solve.robust import BY_CHANCE

# Share of steps between the depth's errors that are more than rounding, below which pixels repeat
# others: of blocks of two by two half are, of depth in whole millimetres nearly all.
REPEATED = 0.75
# Least number of blocks over which errors are summed (ablation.md: halved 0.97, doubled 0.98).
FEWEST_BLOCKS = 16


def estimate_depth_weight(fit: Fit, prepared: Prepared, least: float = 1.0) -> float:
    """The depth weight, 1/variance relative to white noise's, from the errors of both sides.

    Depth errors e that are correlated over an area of r^2 = <e^2> / <|de|^2> of the sensor's pixels
    count r^2 times less (medians, so that jumps do not count; of white noise r^2 is 1/2).  Depth
    that was enlarged by repeating pixels has steps of 0 inside its blocks: of blocks of b by b, 1/b
    of all steps are others, and r^2 is b^2 times that of those.  The photographs' residuals are
    correlated, too: over `assumed_correlation_area`.

    least : of the variance of e over the one that the sensor is taken to have; below 1 where the
        sensor was found to be more precise than that
    """
    error, seen = sensor_error(prepared, fit.log_depth)
    alone = np.where(seen, error, np.nan)
    steps = np.concatenate([np.diff(alone, axis=axis).ravel() for axis in (1, 0)])
    steps = steps[np.isfinite(steps)]
    different = np.abs(steps) > np.finfo(np.float32).eps  # by more than rounding
    if not different.any():
        return CORRELATION_PX**2  # no two depth pixels are neighbours, or there are no errors
    share = float(np.mean(different))
    if share < REPEATED:
        steps = steps[different]
    else:
        share = 1.0
    error = error[seen] - np.median(error[seen])
    correlation_area = np.median(error**2) / np.median(steps**2) / share**2
    relative = (prepared.sensor.depth_m / prepared.sensor.sigma_m)[seen]
    variance = MAD_TO_SIGMA**2 * float(np.median((error * relative) ** 2))
    independent = float(correlation_area) * min(max(variance, least), 1.0)
    return assumed_correlation_area(fit) / max(independent, TINY)


def assumed_correlation_area(fit: Fit) -> float:
    """Area, pixels, over which the photographs' residuals are taken to be correlated.

    A square of side `CORRELATION_PX` where the model holds, and the more, the heavier the tails of
    the residuals, since shadows, highlights and edges are not white noise.
    """
    tail_ratio = fit.linearization.rms / fit.linearization.noise_sigma
    return float(CORRELATION_PX**2 * max(tail_ratio, 1.0))


def estimate_equal_intensity_weight(level: Level, log_depth: Floats, prepared: Prepared) -> float:
    """The weight of the equal-intensity term relative to the sensor term, with the level's weight.

    The sensor's error of the whole shape is that of independent pixels of a larger variance: the
    largest, over blocks of all sizes, of  (sum of a block)^2 / pixels.
    """
    error, seen = sensor_error(prepared, log_depth)
    variance = max(block_variances(error, seen).values())
    return float(np.median(level.sensor_weight) * variance)


def estimate_laplacian_weight(level: Level, fit: Fit) -> float:
    """c, the weight of the Laplacian of the change from the prepared depth; 0 but in one plane.

    Lights in one plane do not show the slope across it, and rows of pixels part.  In the direction
    in which photographs show the slope best, the second derivative of the change is known; it is
    taken to be as large in all.  1 / c is its variance, pixels^-4: the largest, over blocks of all
    sizes, of  (sum of a block)^2 / pixels.
    """
    if not in_one_plane(fit.lights.as_lights(level.middle_m)):
        return 0.0
    active = level.photographs.active
    uu, uv, vv = fit.linearization.jtwj[active].sum(axis=0)
    best = np.linalg.eigh([[uu, uv], [uv, vv]])[1][:, -1]
    slope = gradient_image(fit.log_depth - level.prior, level.grid) @ best
    curvature = gradient_image(slope, level.grid) @ best
    variance = max(block_variances(curvature, active).values())
    # A surface that has moved by no more than rounding says nothing of how far it may.
    return 1 / variance if variance > np.finfo(np.float32).eps ** 2 else 0.0


def correlation_ratio(level: Level, fit: Fit) -> float:
    """How many residuals count as one independent value, over `assumed_correlation_area`.

    The largest, over blocks of all sizes, of  (sum of a block's residuals)^2 / values,  over
    sigma^2: errors of the model are alike over large parts of an object.
    """
    photographs, active = level.photographs, level.photographs.active
    lights = fit.lights.as_lights(level.middle_m)
    normals, points = level.normals(fit.log_depth)[0][active], level.points[active] + level.middle_m
    albedo, highlights = fit.linearization.albedo[active], Highlights(fit.lights.gloss, 1.0)

    def variances(photograph: int, check: Callable[[], None]) -> list[float]:
        check()
        shading = shadings(normals, points, lights.of(photograph))[0]
        residual = albedo * shading - photographs.decoded(photograph)[active]
        if highlights:
            incident = arriving(lights.of(photograph), points)
            residual += highlights.light(normals, points, incident)[0]
        residual *= photographs.usable(photograph)[active]
        error = scatter(residual.sum(axis=-1) / np.sqrt(residual.shape[-1]), active)
        return [*block_variances(error, active).values()]

    each = list(side_by_side(variances, range(len(photographs)), worth_side_by_side()))
    # The median of the photographs: one of something else is no error of the model.
    correlated = float(np.median(each, axis=0).max()) / fit.linearization.noise_sigma**2
    return correlated / assumed_correlation_area(fit)


def variances_by_scale(error: Floats, seen: Mask) -> list[tuple[int, int, float]]:
    """Sides S = 1, 2, 4 ... of square blocks, how many modes differ at that scale, their variance.

    Haar's modes: what the means over blocks of side S differ by within blocks of side 2 S, times
    the root of the pixels of each.  White noise has the same variance at all scales.

    error : (h, w), 0 where it is not seen; seen : (h, w)

    >>> noise = np.random.default_rng(0).standard_normal((64, 64))
    >>> [(side, modes) for side, modes, _ in variances_by_scale(noise, np.ones((64, 64), bool))][:3]
    [(1, 3072), (2, 768), (4, 192)]
    """
    total, pixels, side, found = error, seen.astype(float), 1, []
    energy, count = float(np.vdot(error, error)), int(np.count_nonzero(seen))
    while count > 1:
        total, pixels = cell_sums(total, 2), cell_sums(pixels, 2)
        coarser = float((total**2 / np.maximum(pixels, 1)).sum())
        modes = count - int(np.count_nonzero(pixels))
        if modes:
            found.append((side, modes, max(energy - coarser, 0.0) / modes))
        energy, count, side = coarser, count - modes, 2 * side
    return found


def block_variances(error: Floats, seen: Mask) -> dict[int, float]:
    """Side 1, 2, 4 ... of square blocks -> their (sum of a block)^2, added up, over all pixels.

    error : (h, w) of the sensor or of a photograph, of which the median is taken off; beyond
        `BY_CHANCE` deviations it counts as these
    seen : (h, w) where it counts

    Of single pixels the variance comes from the median; larger blocks are taken as long as the
    pixels would fill `FEWEST_BLOCKS`.  0 where nothing is seen.

    >>> list(block_variances(np.ones((8, 8)), np.ones((8, 8), bool)))
    [1, 2]
    """
    if not seen.any():
        return {1: 0.0}
    error = np.where(seen, error - np.median(error[seen]), 0.0)
    deviation = MAD_TO_SIGMA * float(np.median(np.abs(error[seen])))
    if deviation:  # 0 where most errors are 0, which does not make outliers of the others
        error = np.clip(error, -BY_CHANCE * deviation, BY_CHANCE * deviation)
    count, side = int(np.count_nonzero(seen)), 2
    found = {1: deviation**2}
    while count >= FEWEST_BLOCKS * side**2:
        error = cell_sums(error, 2)
        found[side] = float(np.vdot(error, error)) / count
        side *= 2
    return found
