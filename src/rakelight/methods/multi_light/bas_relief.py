"""The bas-relief transform of a surface and its lights that fits the sensor best.

Photographs under distant lights leave four numbers of a surface open.  The sensor's depth
determines them, but for its errors over the whole object; lights of equal intensity three of them.
"""

from __future__ import annotations

import numpy as np

from rakelight.methods.levels import Level
from rakelight.methods.multi_light.equal_intensity import equal_intensity_slope
from rakelight.model import Floats
from rakelight.photometry.images import LightParameters
from rakelight.solve.robust import BY_CHANCE


def nearest_bas_relief(
    level: Level, log_depth: Floats, lights: LightParameters, equal_intensity_weight: float = 0.0
) -> tuple[Floats, Floats]:
    """(h, w) log depth after the bas-relief transform nearest to the sensor's, and (3, 3) lights'.

    Planes stay planes where  1/z' = a/z + g . r,  r = ((u - cx) / fx, (v - cy) / fy, 1)  being the
    viewing ray and g three numbers, 1/metre:  normals become (a + g X^T) n at a point X, and lights
    (a + X g^T)^-1 s, with an albedo to match, leave the photographs nearly the same (Belhumeur,
    Kriegman and Yuille 1999).

    equal_intensity_weight : W, of `equal_intensity_energy`
    """
    columns, measured = sensed_columns(level, log_depth)
    root = np.sqrt(level.sensor_weight) / measured
    weighed = columns * root[:, None]
    # LAPACK's iterations need not end on values that are not finite.
    left, size, axes = np.linalg.svd(np.asarray_chkfinite(weighed), full_matrices=False)
    determined = size > 1e-12 * size[0]
    # At `basis @ offset` from the nearest, the sensor's sum of squares is |offset|^2 larger.
    basis = axes[determined].T / size[determined]
    nearest = basis @ (left[:, determined].T @ (measured * root))

    transform = nearest
    if equal_intensity_weight:
        from scipy.optimize import minimize

        def cost(offset: Floats) -> tuple[float, Floats]:
            energy, slope = intensity_energy_after(level, lights, nearest + basis @ offset)
            sensor = offset / equal_intensity_weight
            return float(offset @ sensor) + energy, 2 * sensor + basis.T @ slope

        as_it_is = size[determined] * (axes[determined] @ ([1.0, 0.0, 0.0, 0.0] - nearest))
        starts = (np.zeros(len(basis.T)), as_it_is)
        # Not SciPy's "BFGS": see factored_start.py.
        both = (minimize(cost, start, method="L-BFGS-B", jac=True) for start in starts)
        offset = min(both, key=lambda found: found.fun).x
        transform = nearest + basis @ offset
    # Where the sensor shows no relief, a is 0 within its noise.
    turned = nearest[0] < -BY_CHANCE * np.linalg.norm(basis[0])
    return transformed(level, log_depth, transform, turned)


def relief_scaling(level: Level, log_depth: Floats) -> Floats:
    """(h, w) derivative of log depth with the scale of the relief above the object's mean plane.

    With the logarithm of the scale; a plane stays where it is.  The relief is that of inverse
    depth, which a bas-relief transform scales and adds a plane to.
    """
    nearer, rays = np.exp(-log_depth), level.rays
    inside = np.asarray_chkfinite(nearer[level.mask])
    plane = np.linalg.lstsq(rays[level.mask], inside, rcond=None)[0]
    return np.where(level.mask, rays @ plane / nearer - 1, 0.0)


def transformed(
    level: Level, log_depth: Floats, transform: Floats, turned: bool = False
) -> tuple[Floats, Floats]:
    """(h, w) log depth after the transform (a, g), and the (3, 3) one of the lights.

    Unchanged where that would lie behind the camera, and where no normal depends on the depth.

    turned : whether a may be below 0: dents and bumps change places then, and lights come from the
        other side, which leaves the photographs the same, too
    """
    from scipy.ndimage import binary_dilation

    nearer = np.exp(-log_depth)
    inverse = np.where(level.mask, transform[0] * nearer + level.rays @ transform[1:], nearer)
    if not ((transform[0] > 0 or turned) and inverse.min() > 0):
        return log_depth, np.eye(3)
    seen = binary_dilation(level.photographs.active)
    return np.where(seen, -np.log(inverse), log_depth), lights_transform(level, transform)


def lights_transform(level: Level, transform: Floats) -> Floats:
    """(3, 3) matrix of the transform for light vectors at the object's middle."""
    return np.linalg.inv(transform[0] * np.eye(3) + np.outer(level.middle_m, transform[1:]))


def intensity_energy_after(
    level: Level, lights: LightParameters, transform: Floats
) -> tuple[float, Floats]:
    """`equal_intensity_energy` of lights after a transform (a, g), and its derivatives with that.

    With L the lights' matrix, a change dB of its inverse moves a light's vector v by -L dB v.
    """
    matrix = lights_transform(level, transform)
    vectors = lights.vector @ matrix.T
    energy, slope = equal_intensity_slope(vectors, level.photographs.exposures)
    mean, slope = vectors.mean(axis=1), slope @ matrix
    return energy, -np.append(np.vdot(slope, mean), (slope @ level.middle_m) @ mean)


def sensed_columns(level: Level, log_depth: Floats) -> tuple[Floats, Floats]:
    """(M, 4) what a and g multiply in 1/z', as the sensor sees it, and (M,) its own 1/z: 1/metre.

    log_depth : (h, w), log z
    """
    parts = (np.exp(-log_depth), *np.moveaxis(level.rays, -1, 0))
    columns = np.stack([level.sensed(each) for each in parts], axis=-1)
    return columns, level.sensed(np.exp(-level.unbiased_prior))
