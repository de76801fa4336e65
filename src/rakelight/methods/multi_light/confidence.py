"""Expected errors of the refined depth and normals, in metres and degrees.

The variance of a normal has three parts: the photographs' noise, the curvature that differences of
a depth map miss, and the bas-relief transform of the whole surface.

Depth follows the sensor over lengths beyond L and the photographs within it,

    L^2 = M / (sigma^2 w)   pixels^2,

where the sensor's weight w equals the photographs' information on the gradient, M (see
`Linearization`).  So its error has three parts as well: the sensor's error of the whole shape, the
sensor's mean error over L x L, and the normals' errors, a random walk over L pixels.  No constant
is tuned: how often errors stay within one deviation is printed by benchmarks/random_captures.py.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.camera import focal_px
from rakelight.geometry.grid import Grid, differences, neighbours
from rakelight.methods.base import UNDETERMINED_RAD, photometric_confidence
from rakelight.methods.levels import Level, sensor_error
from rakelight.methods.multi_light.bas_relief_variance import quadratic_form
from rakelight.methods.multi_light.energy import Fit
from rakelight.methods.multi_light.noise import block_variances
from rakelight.model import TINY, Floats
from rakelight.prepare import Prepared
from rakelight.solve.robust import variance_beyond


def normal_errors(
    level: Level, fit: Fit, normals: Floats, bas_relief: Floats
) -> tuple[Floats, Floats, Floats]:
    """(h, w) confidence; expected error of each normal, degrees; and its square, radians^2.

    The square is without the part of the whole shape.  The confidence is `photometric_confidence`.
    normals : (h, w, 3) the refined ones; bas_relief : (h, w) squared error, radians^2, by the
        whole shape's transform
    """
    active, length = level.photographs.active, level.normals(fit.log_depth)[1]
    curvature, noise = missed_curvature(normals, level.grid), shared_noise(level, fit)
    local = photometric_variance(level, fit, noise) + curvature
    confidence = photometric_confidence(
        fit.linearization.jtwj, noise, length, level.camera, active, curvature + bas_relief
    )
    return np.where(active, confidence, 0.0), normal_sigma(local + bas_relief), local


def photometric_variance(level: Level, fit: Fit, noise: Floats) -> Floats:
    """(h, w) expected squared angle, radians^2, of the error of a normal by the photographs' noise.

    noise : (h, w) standard deviation of a pixel value

    Of both directions, the trace of the covariance, halved: a surface has one unknown per pixel for
    two slopes, and the half of their noise that is not a gradient drops out.  The square of
    `UNDETERMINED_RAD` where the photographs have no information.
    """
    uu, uv, vv = np.moveaxis(fit.linearization.jtwj, -1, 0)
    determinant = np.maximum(uu * vv - uv**2, TINY)
    trace = level.squared_normal_derivative(fit.surface) * noise**2 * (uu + vv) / determinant
    variance = np.minimum(trace / 2, UNDETERMINED_RAD**2)
    return np.where(level.photographs.active, variance, UNDETERMINED_RAD**2)


def normal_sigma(variance: Floats) -> Floats:
    """(h, w) expected error of each normal, degrees, of its variance, radians^2.

    The variance is of the step beside the unit normal, tangential to the sphere; where nothing
    determines it, it is larger than any angle, and the error goes to 90 degrees.

    >>> normal_sigma(np.array([0.01, 1e6])).round(1).tolist()
    [5.7, 89.9]
    """
    return np.degrees(np.arctan(np.sqrt(variance)))


def depth_sigma(
    level: Level, fit: Fit, prepared: Prepared, local: Floats, moment: Floats, start: Floats
) -> Floats:
    """(h, w) expected error of the refined depth, metres.

    local : (h, w) expected squared error of each normal, radians^2, without the whole shape's
    moment : (4, 4) of the whole shape, see `sensor_moment`
    start : (h, w) log depth where the last descents began: against it the sensor's errors show,
        which the refined surface has followed
    """
    depth_m = np.exp(fit.log_depth)
    # 1/z' = a/z + g . ray: derivatives of 1/z' with a and g.
    derivatives = np.concatenate([1 / depth_m[..., None], level.rays], axis=-1)
    whole = depth_m**4 * quadratic_form(derivatives[..., None, :], moment)

    length_px = sensor_length(level, fit)
    pixel_m = depth_m / focal_px(level.camera)
    walk = local * length_px * pixel_m**2
    shared = depth_m**2 * mean_error_variance(prepared, start, length_px)
    return np.asarray(np.sqrt(whole + shared + walk))


def sensor_length(level: Level, fit: Fit) -> float:
    """L, pixels: below it the photographs determine the surface, above it the sensor.

    Of the median pixel; from 1 to the size of the object.
    """
    precision = fit.noise**2 * float(np.median(level.prior_weight[level.photographs.active]))
    length = np.sqrt(fit.linearization.typical_information(2.0) / max(precision, 1e-300))
    return float(np.clip(length, 1, np.sqrt(np.count_nonzero(level.mask))))


def mean_error_variance(prepared: Prepared, log_depth: Floats, length_px: float) -> float:
    """Variance of the mean of the sensor's error over blocks of that length, in log depth.

    Of the next smaller size, in powers of two of the sensor's pixels, that has enough blocks.
    """
    error, seen = sensor_error(prepared, log_depth)
    found = 0.0
    for side, variance in block_variances(error, seen).items():
        if side > max(length_px / prepared.factor, 1):
            break
        found = variance / side**2
    return found


def shared_noise(level: Level, fit: Fit) -> Floats:
    """(h, w) standard deviation of a value, so that averaging over N gives the variance of a pixel.

    Noise averages out over the photographs.  A pixel's residuals beyond it are errors of the model,
    such as shadows and highlights, which all photographs share: they count N times.
    """
    shared = variance_beyond(fit.noise, fit.linearization.mean_abs_residual)
    return np.asarray(np.sqrt(fit.noise**2 + len(level.photographs) * shared))


def missed_curvature(normals: Floats, grid: Grid) -> Floats:
    """(h, w) squared angle, radians, that a depth map's differences miss where normals curve.

    The mean of the differences to both sides is the slope over two pixels, which differs from the
    slope in the middle by a sixth of its second difference.

    >>> normals = np.array([[[-0.08, 0, -1], [0, 0, -1], [-0.08, 0, -1]]])
    >>> missed_curvature(normals, np.ones((1, 3), bool)).round(6).tolist()
    [[0.0, 0.000711, 0.0]]
    """
    total = np.zeros(normals.shape[:2])
    for axis in (0, 1):
        both = np.logical_and(*neighbours(grid, axis))
        for component in np.moveaxis(normals, -1, 0):
            ahead, behind = differences(component, grid, axis)
            total += np.where(both, (ahead - behind) ** 2, 0.0) / 36
    return np.nan_to_num(total)  # 0 beside a pixel without a normal
