"""The bas-relief transform that a surface and its lamps need, from what else is known.

Photographs under distant lamps leave four numbers of a surface open.  The sensor's depth tells
them, but for its errors over the whole object; the lamps' brightness tells three where it is alike.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.methods.levels import Level
from rakelight.methods.multi_light.equal_intensity import equal_intensity_energy
from rakelight.model import Floats
from rakelight.photometry.images import Lamps


def nearest_bas_relief(
    level: Level, log_depth: Floats, lamps: Lamps, equal_intensity_weight: float = 0.0
) -> tuple[Floats, Floats]:
    """(h, w) log depth after the bas-relief transform nearest to the sensor's, and (3, 3) lights'.

    Planes stay planes where  1/z' = a/z + g . (x, y, 1):  normals become (a + g X^T) n at a point
    X, and lights (a + X g^T)^-1 s, with an albedo to match, leave the photographs nearly the same
    (Belhumeur, Kriegman and Yuille 1999).  `equal_intensity_weight` is that
    of lamps of one brightness.
    """
    nearer, aim = np.exp(-log_depth), level.sensed(np.exp(-level.aim))
    rays = rays_of(level)
    columns = [level.sensed(each) for each in (nearer, *np.moveaxis(rays, -1, 0))]
    root = np.sqrt(level.sensor_weight) / aim
    weighed = np.stack(columns, axis=-1) * root[:, None]
    # LAPACK's iterations need not end on what is not finite.
    left, size, axes = np.linalg.svd(np.asarray_chkfinite(weighed), full_matrices=False)
    told = size > 1e-12 * size[0]
    # Away from the nearest by `solved @ off`, the sensor's misfit is |off|^2 more.
    solved = axes[told].T / size[told]
    nearest = solved @ (left[:, told].T @ (aim * root))

    relief = nearest
    if equal_intensity_weight:
        from scipy.optimize import minimize

        def cost(off: Floats) -> float:
            vectors = lamps.vector @ lights_turn(level, nearest + solved @ off).T
            return float(off @ off) / equal_intensity_weight + equal_intensity_energy(vectors)

        as_it_is = size[told] * (axes[told] @ ([1.0, 0.0, 0.0, 0.0] - nearest))
        starts = (np.zeros(len(solved.T)), as_it_is)
        off = min((minimize(cost, start) for start in starts), key=lambda found: found.fun).x
        relief = nearest + solved @ off
    return _transformed(level, log_depth, rays, relief)


def relief_scaling(level: Level, log_depth: Floats) -> Floats:
    """(h, w) by how much log depth grows where the relief above its middle plane becomes deeper.

    Per part by which it does; a plane stays where it is.  In inverse depth, of which a bas-relief
    transform makes a multiple and a plane.
    """
    nearer, rays = np.exp(-log_depth), rays_of(level)
    plane = np.linalg.lstsq(rays[level.mask], np.asarray_chkfinite(nearer[level.mask]), rcond=None)[
        0
    ]
    return np.where(level.mask, rays @ plane / nearer - 1, 0.0)


def _transformed(
    level: Level, log_depth: Floats, rays: Floats, relief: Floats
) -> tuple[Floats, Floats]:
    """(h, w) log depth after the transform (a, g), `relief`, and the (3, 3) one of the lights.

    Unchanged where that would turn the surface around, and where no normal depends on the depth.
    """
    from scipy.ndimage import binary_dilation

    nearer = np.exp(-log_depth)
    inverse = np.where(level.mask, relief[0] * nearer + rays @ relief[1:], nearer)
    if not (relief[0] > 0 and inverse.min() > 0):
        return log_depth, np.eye(3)
    seen = binary_dilation(level.photographs.active)
    return np.where(seen, -np.log(inverse), log_depth), lights_turn(level, relief)


def lights_turn(level: Level, relief: Floats) -> Floats:
    """(3, 3) what light vectors at the object's middle are multiplied by."""
    return np.linalg.inv(relief[0] * np.eye(3) + np.outer(level.middle_m, relief[1:]))


def rays_of(level: Level) -> Floats:
    """(h, w, 3) points of the viewing rays at depth 1 metre."""
    return back_project(np.ones(level.mask.shape), level.photographs.camera)
