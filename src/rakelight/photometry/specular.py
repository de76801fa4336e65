"""Specular highlights, which a glossy surface adds to equation (3): Blinn-Phong lobes.

Light that arrives at a point as s adds, white whatever the albedo,

    |s| sum_e k_e max(0, n . h)^e

(Blinn 1977), h being halfway between the light and the camera.  A few lobes of fixed exponents e
make up most materials' highlights; their coefficients k_e, the gloss, are estimated from the
photographs: here at first, from what neither albedo nor normals explain, and then with the lights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.model import Floats
from rakelight.solve.robust import CAUCHY, NOTABLE, ROUNDS

# Exponents of the lobes, each half as wide as the one before: 24, 12 and 6 degrees at half of their
# maximum (ablation.md: halved 1.02, doubled 0.99).  The kernels, too, take fourth powers.
EXPONENTS = (8, 32, 128)
TINY = 1e-12


@dataclass(frozen=True, eq=False)
class Highlights:
    """How glossy an object is; false where it shows no highlights.

    coefficients : (E,) of `lobes`, 0 where there are none
    largest_fraction : of a value that may be specular for it to be used; 1 without highlights
    """

    coefficients: Floats
    largest_fraction: float

    @classmethod
    def none(cls) -> Highlights:
        """Those of a Lambertian object."""
        return cls(np.zeros(len(EXPONENTS)), 1.0)

    @classmethod
    def find(
        cls, values: Floats, normals: Floats, points_m: Floats, arriving: Floats, ambient: Floats
    ) -> Highlights:
        """Those that explain enough of the values, which are as in `lobe_coefficients`.

        points_m : (P, 3) camera frame
        """
        unit = lobes(normals, points_m, arriving)
        coefficients, explained = lobe_coefficients(values, normals, arriving, ambient, unit)
        if explained < NOTABLE or not coefficients.any():
            return cls.none()
        return cls(coefficients, specular_limit(values, np.tensordot(coefficients, unit, 1)))

    def __bool__(self) -> bool:
        return bool(self.coefficients.any())

    def light(self, normals: Floats, points_m: Floats, arriving: Floats) -> Floats:
        """(N, P, C) specular light, of what `lobes` takes."""
        return np.asarray(np.tensordot(self.coefficients, lobes(normals, points_m, arriving), 1))


def lobes(normals: Floats, points_m: Floats, arriving: Floats) -> Floats:
    """(E, N, P, C) highlights of unit coefficient: |s| max(0, n . h)^e for every exponent.

    normals, points_m : (P, 3) camera frame; arriving : (N, P, C, 3) light vectors s at the points

    >>> mirror = np.array([[0.0, 0.0, -1.0]])
    >>> lobes(mirror, -mirror, np.array([0.0, 0.0, -2.0]).reshape(1, 1, 1, 3)).ravel().tolist()
    [2.0, 2.0, 2.0]
    """
    strength = np.linalg.norm(arriving, axis=-1)
    toward = arriving / np.maximum(strength, TINY)[..., None]
    camera = -points_m / np.linalg.norm(points_m, axis=-1, keepdims=True)
    halfway = toward + camera[:, None]
    along, facing = (
        np.maximum(np.einsum("npck,pk->npc", way, normals), 0) for way in (halfway, toward)
    )
    cosine = along / np.maximum(np.linalg.norm(halfway, axis=-1), TINY)
    # `EXPONENTS` by squaring: the eighth power, then fourth powers of the one before.
    power = np.square(np.square(np.square(cosine))) * (facing > 0)
    found = [strength * power]
    for _ in EXPONENTS[1:]:
        power = np.square(np.square(power))
        found.append(strength * power)
    return np.stack(found)


def lobe_coefficients(
    values: Floats, normals: Floats, arriving: Floats, ambient: Floats, unit: Floats
) -> tuple[Floats, float]:
    """(E,) the lobes' coefficients, at least 0, and the fraction of squared residuals they explain.

    values : (N, P, 3) linear light, negative where it is not usable
    normals : (P, 3); arriving : (N, P, C, 3); ambient : (N, P or 1, C)
    unit : (E, N, P, C) `lobes`

    Each pixel's albedo and normal are eliminated (to first order).  Non-negative least squares,
    with less weight on pixels that nothing explains.
    """
    usable, (count, pixels) = values >= 0, values.shape[:2]
    dot = np.einsum("npck,pk->npc", arriving, normals)
    shading = np.maximum(dot, 0) + ambient
    tangents = np.linalg.svd(normals[:, None])[2][:, 1:]
    shading_by_normal = np.einsum("npck,ptk->tnpc", arriving, tangents) * (dot > 0)

    def per_pixel(each: Floats) -> Floats:
        """(P, N 3) of (N, P, C or 3), 0 where no value counts."""
        whole = np.where(usable, np.broadcast_to(each, values.shape), 0.0)
        return whole.transpose(1, 0, 2).reshape(pixels, count * 3)

    albedo = (usable * shading * values).sum(axis=0)
    albedo /= np.maximum((usable * shading**2).sum(axis=0), TINY)
    # Free at each pixel: the albedo of three channels, and two rotations of the normal.
    channels = np.eye(3)[:, None, None, :]
    own = [per_pixel(shading * channel) for channel in channels]
    own += [per_pixel(albedo * by_tangent) for by_tangent in shading_by_normal]
    free = np.stack(own, axis=-1)
    observed = np.stack([per_pixel(each) for each in (*unit, values)], axis=-1)
    # Lobes and values, projected on the complement of these.
    matrix = free.swapaxes(1, 2) @ free
    trace = np.trace(matrix, axis1=1, axis2=2)[:, None, None]
    matrix += (1e-9 * trace + TINY) * np.eye(free.shape[-1])
    observed -= free @ np.linalg.solve(matrix, free.swapaxes(1, 2) @ observed)
    lobe, unexplained = observed[..., :-1], observed[..., -1]
    weight = np.ones(pixels)
    for _ in range(ROUNDS):
        coefficients = _least_squares(lobe, unexplained, weight)
        residual = np.square(unexplained - lobe @ coefficients).mean(axis=1)
        weight = 1 / (1 + residual / max(CAUCHY**2 * float(np.median(residual)), TINY))
    before, after = float(weight @ np.square(unexplained).mean(axis=1)), float(weight @ residual)
    return coefficients, (before - after) / max(before, TINY)


def _least_squares(lobe: Floats, unexplained: Floats, weight: Floats) -> Floats:
    """(E,) non-negative coefficients of lobes (P, V, E) that fit `unexplained` (P, V) best."""
    from scipy.optimize import nnls

    root = np.sqrt(weight)[:, None]
    columns = (lobe * root[..., None]).reshape(-1, lobe.shape[-1])
    matrix, rhs = columns.T @ columns, columns.T @ (unexplained * root).ravel()
    matrix += (1e-9 * np.trace(matrix) + TINY) * np.eye(len(matrix))
    lower = np.linalg.cholesky(matrix)
    return np.asarray(nnls(lower.T, np.linalg.solve(lower, rhs))[0])


def specular_limit(values: Floats, specular: Floats) -> float:
    """The largest fraction of a value (N, P, 3) that may be specular (N, P, C) for it to be used.

    `NOTABLE`, since a narrow highlight changes more with the normal than the shading does, and is
    not quite of this shape.  But a wide one is in most photographs: the limit is raised until half
    of the values remain, and at least three, as many as a scaled normal has numbers, in all but
    the fraction `NOTABLE` of the pixels.

    >>> narrow = np.array([0.3] + 7 * [0.0]).reshape(8, 1, 1)
    >>> specular_limit(np.full((8, 1, 3), 0.6), narrow)
    0.05
    >>> round(specular_limit(np.full((8, 1, 3), 0.6), narrow + 0.1), 3)
    0.167
    """
    fraction = np.where(values > 0, specular / np.maximum(values, TINY), np.inf)
    enough = max(len(values) // 2, min(len(values), 3))
    last = np.sort(fraction, axis=0)[enough - 1]
    # On 30 glossy draws three times this limit has 1.03 times the angle, no limit 1.05 times
    # (docs/results/changes.md).
    return max(NOTABLE, float(np.quantile(last, 1 - NOTABLE, method="higher")))
