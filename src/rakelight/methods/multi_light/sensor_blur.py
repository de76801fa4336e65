"""The sensor's blur: over how many of its pixels it smooths its depth.

Cameras and their software smooth depth: matching windows, spatial filters, learned depth.  Relief
comes out lower than it is, and lights and surface that are held to that with it.  The photographs
show the relief's form, if not its height, so that the blur is seen: B K p' is nearest to the
sensor, B the Gaussian means over its pixels, p' a bas-relief transform of the surface p.  What the
blur takes away is then given back to log depth,

    p_0 + U (K p' - B K p'),

U being the upsampling to the level's pixels; above the coarsest level p' is the surface with which
the level begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rakelight.geometry.blur import blurred
from rakelight.methods.base import scatter
from rakelight.methods.levels import Level, held_to_measurements
from rakelight.methods.multi_light.bas_relief import transformed
from rakelight.methods.multi_light.energy import Fit, evaluated
from rakelight.methods.multi_light.model_selection import Search, cost_of_errors
from rakelight.methods.multi_light.outliers import remove_outliers
from rakelight.methods.multi_light.steps import Descent, descend, project_bas_relief
from rakelight.model import Floats
from rakelight.prepare import Prepared

# Standard deviations of the Gaussians that are tried first, the sensor's pixels, each twice as wide
# as the one before; and to which part of a factor of two the best is found.
BLURS_PX, ACCURACY = (0.5, 1.0, 2.0, 4.0), 0.05
# By how much a blur has to cost less, minus twice a log likelihood: a model that costs 10 more has
# next to no support (Burnham and Anderson 2002).
LEAST_GAIN = 10.0
# Steps that find the bas-relief transform beside a blur, and the least 1/z on the way, 1/metre.
NEWTON_STEPS, LEAST_INVERSE_DEPTH = 3, 1e-9


def find_blur(level: Level, fit: Fit, weight: float) -> tuple[float, Floats]:
    """Standard deviation of the sensor's blur, its pixels, 0 for none; and the surface under it.

    That is the log depth (h, w) after the bas-relief transform by which it is nearest to the
    sensor's once blurred.  The costs are those by which descents are chosen, of N photographs and
    as many values of the sensor.

    level : its p_0 the sensor's own, its depth weight of one sensor pixel's noise
    weight : a multiple of that, under which the fit was found
    """
    from scipy.optimize import minimize_scalar

    # As the sensor sees them: what a and g multiply in 1/z', and its own log depth.
    rays = (level.sensed(each) for each in np.moveaxis(level.rays, -1, 0))
    columns = np.stack([np.exp(-level.sensed(fit.log_depth)), *rays], axis=-1)
    measured, root = level.sensed(level.unbiased_prior), np.sqrt(level.sensor_weight)

    def fitted(blur_px: float) -> tuple[float, Floats]:
        """The cost with a blur, and the transform (a, g) nearest to the sensor's: Gauss-Newton."""
        transform = np.array([1.0, 0.0, 0.0, 0.0])
        for _ in range(NEWTON_STEPS):
            nearer = np.maximum(columns @ transform, LEAST_INVERSE_DEPTH)
            errors = measured + blurred_sensor(level, np.log(nearer), blur_px)
            slopes = blurred_sensor(level, columns / nearer[:, None], blur_px)
            transform -= np.linalg.lstsq(slopes * root[:, None], errors * root, rcond=1e-12)[0]
        nearer = np.maximum(columns @ transform, LEAST_INVERSE_DEPTH)
        errors = measured + blurred_sensor(level, np.log(nearer), blur_px)
        return len(level.photographs) * cost_of_errors(level, fit, weight, errors), transform

    costs = [fitted(blur_px)[0] for blur_px in (0.0, *BLURS_PX)]
    best = int(np.argmin(costs))
    if costs[best] > costs[0] - LEAST_GAIN:
        return 0.0, fit.log_depth
    exponent = np.log2(BLURS_PX[best - 1])
    found = minimize_scalar(
        lambda exponent: fitted(2.0**exponent)[0],
        bounds=(exponent - 1, exponent + 1),
        method="bounded",
        options={"xatol": ACCURACY},
    )
    blur_px = 2.0 ** float(found.x)
    return blur_px, transformed(level, fit.log_depth, fitted(blur_px)[1])[0]


def blurred_sensor(level: Level, values: Floats, blur_px: float) -> Floats:
    """Values (M[, C]) of the sensor's pixels, blurred over those measured, by so many pixels.

    As they are where it did not measure.
    """
    if not blur_px:
        return values
    # Where this level's pixels are wider than the sensor's, they stand for them.
    side_px = blur_px * (level.sensor_pixel if level.averaging is None else 1.0)
    image = scatter(values, level.seen)
    image[level.measured] = blurred(image, side_px, level.measured)[level.measured]
    return image[level.seen]


def lost_detail(level: Level, log_depth: Floats, blur_px: float) -> Floats:
    """(hs, ws) K p - B K p of a log depth (h, w): what the sensor's blur takes away."""
    sensed = level.sensed(log_depth)
    return scatter(sensed - blurred_sensor(level, sensed, blur_px), level.seen)


def sharpened(level: Level, log_depth: Floats, blur_px: float) -> Level:
    """The level with what the blur takes away from this log depth (h, w) given back to p_0."""
    if not blur_px:
        return level
    lost = lost_detail(level, log_depth, blur_px)
    if level.averaging is not None:
        lost = level.averaging.upsampled(lost)
    return replace(level, unbiased_prior=level.unbiased_prior + np.where(level.mask, lost, 0.0))


def select_sharpened(
    search: Search, levels: Sequence[Level], descent: Descent, prepared: Prepared
) -> tuple[float, Descent]:
    """The blur found at the coarsest level, and the descent to where p_0 is without it.

    levels : finest first; the coarsest is that of the search, weights aside
    """
    own = held_to_measurements(levels[0], prepared).unbiased_prior
    for level in levels[:-1]:
        own = level.means(own)
    measured = replace(search.level, unbiased_prior=own)
    blur_px, surface = find_blur(measured, descent.fit, descent.weight)
    if not blur_px:
        return blur_px, descent
    log_depth, lights = descent.fit.log_depth, descent.fit.lights
    level, lights = remove_outliers(search.level, log_depth, lights)
    level = sharpened(level, surface, blur_px).weighted(descent.weight)
    fit = project_bas_relief(level, evaluated(level, descent.fit, log_depth, lights, True))
    found = descend(level, fit, search.options, search.progress, "sharpen the depth")
    return blur_px, replace(found, weight=descent.weight)


def sharpened_measurements(
    prepared: Prepared, level: Level, fit: Fit, weight: float
) -> tuple[float, Prepared]:
    """The blur found at the finest level, and the measurements without it.

    level : the finest, its depth weight of one sensor pixel's noise; weight : as in `find_blur`
    """
    measured = held_to_measurements(level, prepared)
    blur_px, surface = find_blur(measured, fit, weight)
    if not blur_px:
        return blur_px, prepared
    sensor = prepared.sensor
    lost = lost_detail(measured, surface, blur_px)
    if level.averaging is None:  # on the output's pixels, which may be wider than the sensor's
        lost = sensor.averaging(prepared.mask).down(lost)
    return blur_px, replace(prepared, sensor=replace(sensor, depth_m=sensor.depth_m * np.exp(lost)))
