"""What equation (3) leaves out: cast shadows and specular highlights, removed from the photographs.

Both are predicted from the present surface and lights: cast shadows by marching the ray to each
light over the depth map, highlights as Blinn-Phong lobes.  Whether there are any, and the lobes'
coefficients, is estimated from the photographs; where they show none, nothing is changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.levels import Level
from rakelight.model import Floats, Lights, Mask
from rakelight.photometry.cast_shadows import in_sight
from rakelight.photometry.forward import arriving
from rakelight.photometry.images import LightParameters
from rakelight.photometry.specular import lobe_coefficients, lobes
from rakelight.prepare.inpaint import nearest_fill

# Pixels in the sample that decides whether there are highlights and shadows.
SAMPLE_PIXELS = 500
# Pixels at which rays to the lights are marched; every other pixel takes the nearest one's result.
SHADOW_PIXELS = 10_000
# Least fraction of the sampled values in cast shadow for which shadows are removed.
LEAST_HIDDEN = 0.002
# Least fraction of the squared residuals that the lobes have to explain (ablation.md: off 1.01; on
# the scenes of accuracy.py hard, which have highlights, 3.23 degrees instead of 1.78).
LEAST_EXPLAINED = 0.02
# Fraction of each pixel's values that rank trimming leaves out, the brightest (ablation.md: doubled
# 0.99), and the number of values that always remain.
TRIMMED_SHARE, FEWEST_VALUES = 1 / 3, 6
# Largest specular fraction of a value that is used; raised until half of the values, and at least
# `FEWEST_VALUES`, remain in this fraction of the pixels.  (No draw of ablation.md changes by 5 %.)
SPECULAR_FRACTION, KEPT_PIXELS = 0.05, 0.9
# Least value that is divided by; white is 1.
TINY = 1e-6
# Length of the ray that is marched towards a distant light, metres.
FAR_M = 100.0


@dataclass(frozen=True, eq=False)
class Outliers:
    """What a surface and lights predict that equation (3) leaves out.

    hidden : (N, h, w, C) values in cast shadow; None for none
    coefficients : (E,) of the highlights, of `photometry.specular`'s lobes, 0 where there are none
    largest_fraction : of a value that may be specular for it to be used; 1 without highlights
    """

    hidden: Mask | None
    coefficients: Floats
    largest_fraction: float

    def __bool__(self) -> bool:
        return self.hidden is not None or bool(self.coefficients.any())

    def removed(self, level: Level, log_depth: Floats, lights: LightParameters) -> Level:
        """The level with photographs as a Lambertian object without cast shadows would show them.

        log_depth (h, w), lights : the present estimates; the level itself where there is nothing
        """
        if not self:
            return level
        photographs, physical = level.photographs, lights.as_lights(level.middle_m)
        normals, points = _geometry(level, log_depth)
        active = photographs.active

        def specular(photograph: int) -> Floats:
            """(P, C) the specular light of the active pixels in a photograph."""
            incident = arriving(physical.of(photograph), points[active])
            unit = lobes(normals[active], points[active], incident)[:, 0]
            return np.tensordot(self.coefficients, unit, 1)

        highlights = specular if self.coefficients.any() else None
        cleared = photographs.cleared(self.hidden, highlights, self.largest_fraction)
        return replace(level, photographs=cleared)


def remove_outliers(
    level: Level, log_depth: Floats, lights: LightParameters
) -> tuple[Level, Floats]:
    """The level with photographs as a Lambertian object without cast shadows would show them.

    log_depth (h, w), lights : the present estimates.  Also the coefficients (E,) of the highlights
    that were subtracted, of `photometry.specular`'s lobes, 0 where there are none; values with more
    than `specular_limit` of them are left out.  The level itself where nothing was found.
    """
    found = find_outliers(level, log_depth, lights)
    return found.removed(level, log_depth, lights), found.coefficients


def find_outliers(level: Level, log_depth: Floats, lights: LightParameters) -> Outliers:
    """The highlights and cast shadows that the present estimates predict, if there are any."""
    photographs, physical = level.photographs, lights.as_lights(level.middle_m)
    normals, points = _geometry(level, log_depth)
    sample = photographs.subsample(SAMPLE_PIXELS)
    values, incident = photographs.light(sample), arriving(physical, points[sample])
    hidden_sample = in_shadow(level, points, sample, physical)
    hidden = None
    if hidden_sample.mean() >= LEAST_HIDDEN and are_dark(
        values, hidden_sample, normals[sample], incident, physical
    ):
        hidden = all_shadows(level, points, physical)
        values[np.broadcast_to(hidden_sample, values.shape)] = -1.0
    unit = lobes(normals[sample], points[sample], incident)
    coefficients, explained = lobe_coefficients(
        values, normals[sample], incident, physical.ambient, unit
    )
    if explained < LEAST_EXPLAINED:
        coefficients = np.zeros_like(coefficients)
    largest = 1.0
    if coefficients.any():
        largest = specular_limit(values, np.tensordot(coefficients, unit, 1))
    return Outliers(hidden, coefficients, largest)


def _geometry(level: Level, log_depth: Floats) -> tuple[Floats, Floats]:
    """Normals and points, each (h, w, 3), of a log depth (h, w)."""
    camera, gradient = level.camera, level.surface(log_depth).gradient
    normals, _ = normals_from_gradient(gradient[..., 0], gradient[..., 1], camera)
    return normals, back_project(np.exp(log_depth), camera)


def specular_limit(values: Floats, specular: Floats) -> float:
    """The largest fraction of a value (N, P, 3) that may be specular (N, P, C) for it to be used.

    A narrow highlight changes more with the normal than the shading does, so that what is left of a
    value after subtraction depends on the normal.  But a wide one is in most photographs: the limit
    is raised so that enough values remain.

    >>> narrow = np.array([0.3] + 7 * [0.0]).reshape(8, 1, 1)
    >>> specular_limit(np.full((8, 1, 3), 0.6), narrow)
    0.05
    >>> round(specular_limit(np.full((8, 1, 3), 0.6), narrow + 0.1), 3)
    0.167
    """
    fraction = np.where(values > 0, specular / np.maximum(values, TINY), np.inf)
    enough = max(len(values) // 2, min(len(values), FEWEST_VALUES))
    last = np.sort(fraction, axis=0)[enough - 1]
    return max(SPECULAR_FRACTION, float(np.quantile(last, KEPT_PIXELS, method="higher")))


def trim_brightest(level: Level) -> Level:
    """The level without the brightest values of each pixel (rank trimming), most highlights.

    Normals lose little by it, and gain where there are highlights.
    """
    return replace(
        level, photographs=level.photographs.trim_brightest(TRIMMED_SHARE, FEWEST_VALUES)
    )


def in_shadow(level: Level, points_m: Floats, where: Mask, lights: Lights) -> Mask:
    """(N, P, C) whether the surface itself hides the lights from the P pixels of a mask.

    points_m : (h, w, 3) of the surface, camera frame; where : (h, w)
    """
    points = points_m[where]
    start = np.broadcast_to(points[:, None], (len(lights), len(points), *lights.vector.shape[1:]))
    to_light = np.broadcast_to(FAR_M * lights.direction[:, None], start.shape)
    if lights.position_m is not None:
        to_light = lights.position_m[:, None] - start
    solid = np.where(level.mask, points_m[..., 2], np.nan)
    free = in_sight(solid, level.camera, start.reshape(-1, 3), to_light.reshape(-1, 3))
    return ~free.reshape(to_light.shape[:3])


def all_shadows(level: Level, points_m: Floats, lights: Lights) -> Mask:
    """(N, h, w, C) `in_shadow` of every pixel, from the nearest of `SHADOW_PIXELS`."""
    where = level.photographs.subsample(SHADOW_PIXELS)
    number = np.zeros(where.shape)
    number[where] = np.arange(np.count_nonzero(where))
    nearest = nearest_fill(number, where).astype(int)
    return in_shadow(level, points_m, where, lights)[:, nearest]


def are_dark(
    values: Floats, hidden: Mask, normals: Floats, incident: Floats, lights: Lights
) -> bool:
    """Whether the values (N, P, 3) that should lie in shadow do: hidden (N, P, C).

    Only ambient light reaches a cast shadow.  The direct light there has to be, by least squares,
    less than half of that of an unshadowed surface with the albedo of the other photographs.
    """
    lit = np.maximum(np.einsum("npck,pk->npc", incident, normals), 0)
    usable = values >= 0
    seen = np.where(usable & ~hidden, lit + lights.ambient[:, None], 0.0)
    albedo = (seen * values).sum(axis=0) / np.maximum((seen**2).sum(axis=0), 1e-12)
    direct = np.where(usable & hidden, albedo * lit, 0.0)
    found = direct * (values - albedo * lights.ambient[:, None])
    return bool(found.sum() < 0.5 * (direct**2).sum())
