"""What equation (3) leaves out: cast shadows, and specular highlights.

Both are predicted from the present surface and lights: cast shadows by marching the ray to each
light over the depth map, highlights by `photometry.specular`.  Whether there are any is estimated
from the photographs; where they show none, nothing is changed.  Values in shadow are left out, and
those of which a highlight is predicted to make more than a twentieth; weaker highlights are a part
of the energy, as the gloss in `LightParameters`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.fill import nearest_fill
from rakelight.methods.levels import Level
from rakelight.model import FARTHEST_M, Floats, Lights, Mask
from rakelight.photometry.cast_shadows import in_sight
from rakelight.photometry.forward import arriving
from rakelight.photometry.images import SAMPLE_PIXELS, LightParameters
from rakelight.photometry.specular import Highlights


@dataclass(frozen=True, eq=False)
class LitSurface:
    """A surface under lights, from which outliers are predicted.

    log_depth (h, w), parameters : the present estimates
    """

    level: Level
    log_depth: Floats
    parameters: LightParameters

    @cached_property
    def lights(self) -> Lights:
        """The same lights, where they stand."""
        return self.parameters.as_lights(self.level.middle_m)

    @cached_property
    def normals(self) -> Floats:
        """(h, w, 3) camera frame."""
        return self.level.normals(self.log_depth)[0]

    @cached_property
    def points_m(self) -> Floats:
        """(h, w, 3) camera frame."""
        points: Floats = back_project(np.exp(self.log_depth), self.level.camera)
        return points


@dataclass(frozen=True, eq=False)
class Outliers:
    """What a surface and lights predict that equation (3) leaves out.

    hidden : (N, h, w, C) values in cast shadow; None for none
    """

    hidden: Mask | None
    highlights: Highlights

    def __bool__(self) -> bool:
        return self.hidden is not None or bool(self.highlights)

    def carried(self, carry: Callable[[Mask], Mask]) -> Outliers:
        """The same in another window or resolution: `carry` makes its images of (h, w, ...)."""
        if self.hidden is None:
            return self
        hidden: Mask = np.moveaxis(carry(np.moveaxis(self.hidden, 0, 2)), 2, 0)
        return replace(self, hidden=hidden)

    def removed(self, surface: LitSurface) -> Level:
        """Its level without the values that are left out; the level itself where none are."""
        level, photographs, shiny = surface.level, surface.level.photographs, self.highlights
        if not self:
            return level
        active = photographs.active
        normals, points = surface.normals[active], surface.points_m[active]

        def left_out(photograph: int) -> Mask:
            """(h, w, C or 3) the values of a photograph that are not used."""
            hidden = np.zeros((*active.shape, 3), bool)
            if shiny:
                incident = arriving(surface.lights.of(photograph), points)
                specular = shiny.light(normals, points, incident)[0]
                light = photographs.decoded(photograph)[active]
                hidden[active] = specular > shiny.largest_fraction * light
            return hidden if self.hidden is None else hidden | self.hidden[photograph]

        clear = photographs.without(map(left_out, range(len(photographs))))
        return replace(level, photographs=clear)


def remove_outliers(
    level: Level, log_depth: Floats, lights: LightParameters
) -> tuple[Level, LightParameters]:
    """The level without the values that are left out, and the lights with the gloss found.

    log_depth (h, w), lights : the present estimates
    The level itself where nothing is left out.
    """
    surface = LitSurface(level, log_depth, lights)
    found = find_outliers(surface)
    return found.removed(surface), replace(lights, gloss=found.highlights.coefficients)


def find_outliers(surface: LitSurface) -> Outliers:
    """The highlights and cast shadows that the present estimates predict, if there are any.

    Whether there are any is decided by `SAMPLE_PIXELS` pixels of all photographs together.
    """
    photographs, lights = surface.level.photographs, surface.lights
    sample = photographs.subsample(max(SAMPLE_PIXELS // len(photographs), 1))
    normals, points = surface.normals[sample], surface.points_m[sample]
    values, hidden = photographs.light(sample), None
    shadows = predicted_shadows(surface, sample)
    if shadows.shown:
        hidden = all_shadows(surface)
        values[shadows.values] = -1.0
    highlights = Highlights.find(
        values, normals, points, arriving(lights, points), lights.ambient_on(normals)
    )
    return Outliers(hidden, highlights)


@dataclass(frozen=True, eq=False)
class Shadows:
    """Which values of N photographs at P pixels lie in cast shadow.

    hidden : (N, P, 3) whether the surface hides the light, as far as surface and lights are known
    dark : (N, P, 3) whether the value is nearer to ambient light alone than to what would be lit
    weight : (N, P, 3) square of the direct light where nothing hid it; 0 for values not usable
    """

    hidden: Mask
    dark: Mask
    weight: Floats

    @classmethod
    def of(cls, values: Floats, hidden: Mask, lit: Floats, ambient: Floats) -> Shadows:
        """Those of values (N, P, 3), with the albedo that the ones not hidden show.

        hidden (N, P, C), as here; lit (N, P, C) direct light on albedo 1; ambient (N, P, C)
        """
        usable, hidden = values >= 0, np.broadcast_to(hidden, values.shape)
        seen = np.where(usable & ~hidden, lit + ambient, 0.0)
        albedo = (seen * values).sum(axis=0) / np.maximum((seen**2).sum(axis=0), 1e-12)
        direct = np.where(usable, albedo * lit, 0.0)
        return cls(hidden, usable & (values - albedo * ambient < direct / 2), direct**2)

    @property
    def values(self) -> Mask:
        """(N, P, 3) the values in shadow: all hidden ones if most of them are dark, else the dark.

        Where most are dark the others are half in shadow, at its edge.  Where few are, the shadows
        are predicted too large, by lights that were found with them in the photographs: the others
        are lit.
        """
        return self.hidden if self._dark_share(self.hidden) > 0.5 else self.hidden & self.dark

    @property
    def shown(self) -> bool:
        """Whether a hidden value is dark more than twice as often as another.

        Then most of the values that are hidden and dark are so by a shadow.
        """
        return self._dark_share(self.hidden) > 2 * self._dark_share(~self.hidden)

    def _dark_share(self, part: Mask) -> float:
        """How much of a part of the values is dark, by weight."""
        weight = self.weight * part
        return float((weight * self.dark).sum() / max(weight.sum(), np.finfo(float).tiny))


def in_shadow(surface: LitSurface, where: Mask) -> Mask:
    """(N, P, C) whether the surface itself hides the lights from its P pixels of a mask (h, w)."""
    level, lights, points = surface.level, surface.lights, surface.points_m[where]
    start = np.broadcast_to(points[:, None], (len(lights), len(points), *lights.vector.shape[1:]))
    to_light = np.broadcast_to(FARTHEST_M * lights.direction[:, None], start.shape)
    if lights.position_m is not None:
        to_light = lights.position_m[:, None] - start
    solid = np.where(level.mask, surface.points_m[..., 2], np.nan)
    free = in_sight(solid, level.camera, start.reshape(-1, 3), to_light.reshape(-1, 3))
    return ~free.reshape(to_light.shape[:3])


def predicted_shadows(surface: LitSurface, where: Mask) -> Shadows:
    """The shadows at the P pixels of a mask (h, w)."""
    values, lights = surface.level.photographs.light(where), surface.lights
    incident = arriving(lights, surface.points_m[where])
    lit = np.maximum(np.einsum("npck,pk->npc", incident, surface.normals[where]), 0)
    return Shadows.of(
        values, in_shadow(surface, where), lit, lights.ambient_on(surface.normals[where])
    )


def all_shadows(surface: LitSurface) -> Mask:
    """(N, h, w, 3) the values in cast shadow: at each pixel those of the nearest of a sample."""
    where = surface.level.photographs.subsample(SAMPLE_PIXELS)
    number = np.zeros(where.shape)
    number[where] = np.arange(np.count_nonzero(where))
    nearest = nearest_fill(number, where).astype(int)
    return predicted_shadows(surface, where).values[:, nearest]
