"""Which numbers of the lights and of the gloss are free, and how the others follow from them.

A step is found in the free parameters alone: J being the derivatives of the lights' numbers with
them (`LightModel.jacobian`), the energy's are  J' grad  and  J' H J.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rakelight.model import Floats
from rakelight.photometry.images import LightParameters


@dataclass(frozen=True, eq=False)
class LightModel:
    """Which numbers of the lights the steps move; the other ones stay or follow.

    near : inverse distances, too
    beam : the lamps' beams, too, of which all have one width w
    shared_ambient : one ratio of ambient light to irradiance, of all lights; on a nearly flat
        surface all normals see the same of a light, and only that separates it from ambient light
    ambient_direction : d of the ambient light, which all photographs share
    directions : (N, 1, 3) unit vectors that the lights keep, as they do their distances; None where
        they are free
    """

    near: bool = False
    beam: bool = False
    shared_ambient: bool = False
    ambient_direction: bool = False
    directions: Floats | None = None

    @property
    def numbers(self) -> int:
        """How many numbers each light has: vector, [inverse distance, [beam,]] ambient."""
        return 8 if self.beam else 5 if self.near else 4

    def own_numbers(self, numbers: Floats) -> Floats:
        """(N, C, 4, 5 or 8) of `LightParameters.numbers` (N, C, 8)."""
        kept = self.numbers - 1
        return np.concatenate([numbers[..., :kept], numbers[..., -1:]], axis=-1)

    def jacobian(self, lights: LightParameters) -> Any:
        """Sparse (K, F): derivatives of the lights' K numbers with the F free parameters.

        Light by light: the vector, or its length where directions are given; the inverse distance
        where near; b of a beam; the ambient light.  Once, after all: of beams the width w, the
        ratio of ambient light where it is shared; the gloss, unless it is 0; the ambient light's
        direction.
        """
        from scipy.sparse import block_diag, csr_array, eye_array

        vector = lights.vector.reshape(-1, 3)
        size = np.maximum(lights.irradiance.ravel(), np.finfo(float).tiny)
        own = np.tile(np.eye(self.numbers), (len(vector), 1, 1))
        shared = []
        if self.beam:
            shared.append(own[..., 6].copy())
            own = np.delete(own, [6] if self.near else [3, 6], axis=-1)
        if self.shared_ambient:
            shared.append(size[:, None] * own[..., -1])
            own[:, -1, :3] = lights.ambient_share * vector / size[:, None]
            own = own[..., :-1]
        if self.directions is not None:
            along = np.broadcast_to(self.directions, lights.vector.shape).reshape(-1, 3, 1)
            own = np.concatenate([own[..., :3] @ along, own[..., 3:]], axis=-1)
        # Blocks beside each other and then a column for each number that is shared: row by row.
        count, rows, columns = own.shape
        own_columns = np.arange(count * columns).reshape(count, columns)
        last_columns = count * columns + np.tile(np.arange(len(shared)), (count, 1))
        where = np.hstack([own_columns, last_columns]).repeat(rows, axis=0)
        values = np.concatenate([own, *(each[..., None] for each in shared)], axis=-1)
        starts = np.arange(0, values.size + 1, where.shape[1])
        jacobian = csr_array((values.ravel(), where.ravel(), starts))
        jacobian.eliminate_zeros()
        if shared_numbers := self.gloss_numbers(lights) + 3 * self.ambient_direction:
            jacobian = block_diag([jacobian, eye_array(shared_numbers)], format="csr")
        return jacobian

    def gloss_numbers(self, lights: LightParameters) -> int:
        """How many free numbers the gloss has: none where there is none."""
        return len(lights.gloss) if lights.gloss.any() else 0

    def moved(self, lights: LightParameters, step: Floats) -> LightParameters:
        """The lights after a step (F,) of the free parameters."""
        numbers = self.jacobian(lights) @ step
        places = np.cumsum([lights.ambient.size * self.numbers, self.gloss_numbers(lights)])
        own, gloss, direction = np.split(numbers, places)
        step = own.reshape(*lights.ambient.shape, self.numbers)
        after = lights.moved(
            step, gloss if gloss.size else 0.0, direction if direction.size else 0.0
        )
        if self.directions is not None:  # without rounding, and never from the other side
            along = (after.vector * self.directions).sum(axis=-1, keepdims=True)
            after = replace(after, vector=np.maximum(along, 0.0) * self.directions)
        if self.shared_ambient:
            after = replace(after, ambient=after.ambient_share * after.irradiance)
        return after


FREE = LightModel()
"""Distant lights of which all numbers are free."""
