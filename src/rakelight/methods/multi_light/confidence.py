"""How far the refined depth and normals are expected to be off, in metres and degrees.

A normal errs by what its photographs leave open, by the part of a bend that differences of a depth
map miss, and by the bas-relief transform of the whole surface.

Depth is the sensor's over lengths beyond L and the photographs' within it,

    L^2 = M / (sigma^2 w)   pixels^2,

where the sensor's weight w equals what the photographs say of the gradient, M (`Explanation`).  So
it errs by the sensor's error of the whole shape, by the sensor's mean error over L x L, and by the
normals' errors, a random walk over L pixels.  No constant is chosen: how often errors stay within
one deviation is printed by benchmarks/random_captures.py.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import Grid, differences, neighbours
from rakelight.geometry.normals import normal_lengths, squared_turn
from rakelight.methods.base import NO_IDEA_RAD, photometric_confidence
from rakelight.methods.levels import Level, sensor_error
from rakelight.methods.multi_light.bas_relief import rays_of
from rakelight.methods.multi_light.energy import Fit
from rakelight.methods.multi_light.noise import block_variances
from rakelight.model import Floats
from rakelight.prepare import Prepared
from rakelight.solve.robust import variance_beyond

# Least determinant of a tensor: its inverse does not overflow.
TINY = 1e-30


def photometric_variance(level: Level, fit: Fit, noise: Floats) -> Floats:
    """(h, w) expected squared angle, radians^2, that noise of the photographs turns a normal by.

    noise : (h, w) standard deviation of a pixel value

    In both directions, so the trace of the covariance, of which half is left: a surface has one
    number a pixel for two slopes, and the half of their noise that is no gradient drops out.  Half
    a radian's square where the photographs say nothing.
    """
    gradient, camera = fit.surface.gradient, level.photographs.camera
    turn = squared_turn(normal_lengths(gradient[..., 0], gradient[..., 1], camera), camera)
    uu, uv, vv = np.moveaxis(fit.explanation.tensor, -1, 0)
    determinant = np.maximum(uu * vv - uv**2, TINY)
    both = turn * noise**2 * (uu + vv) / determinant
    variance = np.minimum(both / 2, NO_IDEA_RAD**2)
    return np.where(level.photographs.active, variance, NO_IDEA_RAD**2)


def depth_sigma(
    level: Level, fit: Fit, prepared: Prepared, local: Floats, moment: Floats
) -> Floats:
    """(h, w) expected error of the refined depth, metres.

    local : (h, w) expected squared error of each normal, radians^2, but for the whole shape's
    moment : (4, 4) of the whole shape, see `sensor_moment`
    """
    depth_m = np.exp(fit.log_depth)
    # 1/z' = a/z + g . ray: by how much depth changes with a and g.
    ways = np.concatenate([1 / depth_m[..., None], rays_of(level)], axis=-1)
    whole = depth_m**4 * np.einsum("hwi,ij,hwj->hw", ways, moment, ways)

    length_px = sensor_length(level, fit)
    pixel_m = depth_m / level.photographs.camera.fx
    walk = local * length_px * pixel_m**2
    shared = depth_m**2 * mean_error_variance(prepared, fit.log_depth, length_px)
    return np.asarray(np.sqrt(whole + shared + walk))


def sensor_length(level: Level, fit: Fit) -> float:
    """L, pixels: over shorter lengths the surface is the photographs', over longer the sensor's.

    Of the typical pixel; from 1 to the size of the object.
    """
    active, tensor = level.photographs.active, fit.explanation.tensor
    typical = float(np.median((tensor[..., 0] + tensor[..., 2])[active])) / 2
    held = fit.noise**2 * float(np.median(level.prior_weight[active]))
    largest = np.sqrt(np.count_nonzero(level.mask))
    return float(np.clip(np.sqrt(typical / max(held, 1e-300)), 1, largest))


def mean_error_variance(prepared: Prepared, log_depth: Floats, length_px: float) -> float:
    """Variance of the mean of the sensor's error over blocks of that length, in log depth.

    Of the nearest smaller size, in powers of two of the sensor's pixels, of which there are enough
    blocks to tell.
    """
    error, seen = sensor_error(prepared, log_depth)
    found = 0.0
    for side, variance in block_variances(error, seen):
        if side > max(length_px / prepared.factor, 1):
            break
        found = variance / side**2
    return found


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
