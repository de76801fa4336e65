"""What equation (3) leaves out, taken from the photographs: highlights and cast shadows.

Both follow from the surface and the lamps, as well as these are known: whether the way to a lamp
is free, and how a highlight lies about the direction halfway to the camera.  Whether there are any,
and how high the highlights are, the photographs tell; where they show none nothing is changed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.levels import Level
from rakelight.model import Floats, Lights, Mask
from rakelight.photometry.cast_shadows import in_sight
from rakelight.photometry.images import Lamps
from rakelight.photometry.lighting import arriving
from rakelight.photometry.specular import heights, lobes
from rakelight.prepare.inpaint import nearest_fill

# Pixels that are enough to know whether there are highlights and shadows.
SAMPLE = 500
# Pixels from which lamps are looked for; the others are like those beside them.
LOOKING = 10_000
# Where fewer pixels than this part lie in shadow, that is not worth while.
LEAST_HIDDEN = 0.002
# Highlights that explain a smaller part of the residuals are something else.
LEAST_SHARE = 0.02
# Highlights are among the brightest of a pixel's values; these are enough without.
BRIGHTEST, FEW = 1 / 3, 6
# A value that is a highlight to this part is left out; but of this part of the pixels, half of the
# values are kept, and no fewer than these.
MUCH_SHINE, MOST_PIXELS = 0.05, 0.9
TINY = 1e-6
# The way to a distant lamp is free after so many metres.
FAR_M = 100.0


def remove_outliers(level: Level, log_depth: Floats, lamps: Lamps) -> tuple[Level, Floats]:
    """The level with its photographs as a matte object without cast shadows would show them.

    log_depth (h, w), lamps : as well as they are known.  Also the heights (E,) of the highlights
    that were taken away, in `shading.highlights`' lobes, 0 where there are none; values that are
    highlights to more than `most_shine` are left out.  The level itself where nothing was found.
    """
    photographs, lights = level.photographs, lamps.as_lights(level.middle_m)
    camera, gradient = photographs.camera, level.surface(log_depth).gradient
    normals, _ = normals_from_gradient(gradient[..., 0], gradient[..., 1], camera)
    points = back_project(np.exp(log_depth), camera)

    some = photographs.some(SAMPLE)
    values, arrived = photographs.light(some), arriving(lights, points[some])
    dark = in_shadow(level, points, some, lights)
    hidden = None
    if dark.mean() >= LEAST_HIDDEN and are_dark(values, dark, normals[some], arrived, lights):
        hidden = all_shadows(level, points, lights)
        values[np.broadcast_to(dark, values.shape)] = -1.0
    unit = lobes(normals[some], points[some], arrived)
    height, share = heights(values, normals[some], arrived, lights.ambient, unit)
    if share < LEAST_SHARE:
        height = np.zeros_like(height)
    if hidden is None and not height.any():
        return level, height

    active = photographs.active

    def shine(photograph: int) -> Floats:
        """(P, C) the highlights of the active pixels."""
        arrived = arriving(lights.of(photograph), points[active])
        return np.tensordot(height, lobes(normals[active], points[active], arrived)[:, 0], 1)

    cleared = photographs.cleared(
        hidden, shine if height.any() else None, most_shine(values, np.tensordot(height, unit, 1))
    )
    return replace(level, photographs=cleared), height


def most_shine(values: Floats, shine: Floats) -> float:
    """The part of a value (N, P, 3) that may be a highlight (N, P, C) for it to be used.

    With the normal, a highlight changes more than the shading does: what is left of a value after
    the one is taken away is as uncertain as the normal.  But a wide one is in most photographs.

    >>> narrow = np.array([0.3] + 7 * [0.0]).reshape(8, 1, 1)
    >>> most_shine(np.full((8, 1, 3), 0.6), narrow)
    0.05
    >>> round(most_shine(np.full((8, 1, 3), 0.6), narrow + 0.1), 3)
    0.167
    """
    part = np.where(values > 0, shine / np.maximum(values, TINY), np.inf)
    enough = max(len(values) // 2, min(len(values), FEW))
    last = np.sort(part, axis=0)[enough - 1]
    return max(MUCH_SHINE, float(np.quantile(last, MOST_PIXELS, method="higher")))


def dimmed(level: Level) -> Level:
    """The level without the brightest values of each pixel: without most highlights.

    Those that are left tell normals nearly as well, and better where there are highlights.
    """
    return replace(level, photographs=level.photographs.dimmed(BRIGHTEST, FEW))


def in_shadow(level: Level, points_m: Floats, where: Mask, lights: Lights) -> Mask:
    """(N, P, C) whether another part of the surface hides the lamps from the P pixels of a mask.

    points_m : (h, w, 3) of the surface, camera frame; where : (h, w)
    """
    points = points_m[where]
    start = np.broadcast_to(points[:, None], (len(lights), len(points), *lights.vector.shape[1:]))
    way = np.broadcast_to(FAR_M * lights.direction[:, None], start.shape)
    if lights.position_m is not None:
        way = lights.position_m[:, None] - start
    solid = np.where(level.mask, points_m[..., 2], np.nan)
    free = in_sight(solid, level.photographs.camera, start.reshape(-1, 3), way.reshape(-1, 3))
    return ~free.reshape(way.shape[:3])


def all_shadows(level: Level, points_m: Floats, lights: Lights) -> Mask:
    """(N, h, w, C) `in_shadow` of every pixel, from the nearest of some of them."""
    where = level.photographs.some(LOOKING)
    number = np.zeros(where.shape)
    number[where] = np.arange(np.count_nonzero(where))
    nearest = nearest_fill(number, where).astype(int)
    return in_shadow(level, points_m, where, lights)[:, nearest]


def are_dark(
    values: Floats, hidden: Mask, normals: Floats, arrived: Floats, lights: Lights
) -> bool:
    """Whether the values (N, P, 3) that should lie in shadow do: hidden (N, P, C).

    In a shadow there is the ambient light alone: less than half of the lamps' by least squares.
    The albedo is what the other photographs show.
    """
    lit = np.maximum(np.einsum("npck,pk->npc", arrived, normals), 0)
    usable = values >= 0
    seen = np.where(usable & ~hidden, lit + lights.ambient[:, None], 0.0)
    albedo = (seen * values).sum(axis=0) / np.maximum((seen**2).sum(axis=0), 1e-12)
    lamps = np.where(usable & hidden, albedo * lit, 0.0)
    found = lamps * (values - albedo * lights.ambient[:, None])
    return bool(found.sum() < 0.5 * (lamps**2).sum())
