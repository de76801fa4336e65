"""How well photographs that are held back are predicted: by a refined surface, by the prepared one.

A photograph's own influence on a pixel's albedo and normal is removed without refining again.  To
first order the residuals e of a photograph that is left out of a least-squares fit are

    (1 - H)^-1 e,    H = J (J^T J)^-1 J^T                                     (PRESS, Allen 1974)

H its own block of the hat matrix.  With rho eliminated, J~ being the derivatives with the gradient
of log depth less their projection on the shading a, and L the precision of that gradient by the
prepared depth,

    H = diag(a_c^2 / sum a_c^2) + J~ (sum J~^T J~ + L)^-1 J~^T

A surface that only explains noise predicts worse than the prepared depth, whose normals no
photograph has changed: there H is its first term alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import (
    normal_derivatives,
    squared_normal_derivative,
    surface_normals,
    towards_camera,
)
from rakelight.methods.base import Estimate, brightest
from rakelight.model import MAD_TO_SIGMA, TINY, Array, Camera, Finding, Floats, Lights, Mask
from rakelight.photometry.forward import arriving, least_squares_albedo, shadings
from rakelight.photometry.images import SAMPLE_PIXELS
from rakelight.photometry.lighting import estimate_light
from rakelight.pipeline.prediction import sampled_pixels
from rakelight.prepare import Prepared
from rakelight.solve.robust import ROUNDS

# Least number of photographs: from two, a normal and an albedo are undetermined.
FEWEST = 4
# Least precision of a gradient over its largest: below is rounding.
ROUNDING = 1e-12

NO_BETTER = Finding(
    "warning",
    "photographs-say-nothing",
    "the photographs, held back one by one, are not predicted better by a refined surface than by "
    "the depth as it was: the depth is kept",
    "take photographs of this object with the lamp in other places, the camera and the room light "
    "unchanged",
)

NO_BETTER_SO_LIT = Finding(
    "warning",
    "photographs-say-nothing",
    "under the given lights no refined surface predicts the photographs better than the depth as "
    "it was: the depth is kept",
    "correct the given lights, or leave them away",
)

ONE_PLACE = Finding(
    "warning",
    "photographs-say-nothing",
    "the lights found are in nearly one place, from which slopes and paint look alike: the depth "
    "is kept",
    "move the lamp around the object; if it was moved, the object is too flat to tell where it "
    "was: state that in [lights], fixed",
)


@dataclass(frozen=True)
class Prediction:
    """Errors of the photographs that are predicted from the others, light of white = 1.

    refined, prepared : (N,) median absolute error by the refined surface, by the prepared depth;
        NaN for a photograph without usable values
    brightness, variation : (N,) mean of the usable values, and their median deviation from their
        median
    """

    refined: Floats
    prepared: Floats
    brightness: Floats
    variation: Floats

    @property
    def gain(self) -> float:
        """Typical error by the refined surface over that by the prepared depth."""
        before = float(np.nanmedian(self.prepared))
        return float(np.nanmedian(self.refined)) / max(before, np.finfo(float).tiny)


@dataclass(frozen=True)
class Sample:
    """Values of some pixels: images (N, P, 3) linear light, good (N, P, 3) usable ones.

    chosen : (P,) indices of the pixels in the window, row by row
    """

    images: Floats
    good: Mask
    chosen: Array

    def of(self, image: Floats) -> Floats:
        """An image (h, w, ...) at these pixels, (P, ...)."""
        return np.asarray(image.reshape(-1, *image.shape[2:])[self.chosen])


def predict(
    prepared: Prepared, depth_m: Floats, normals: Floats, lights: Lights
) -> Prediction | None:
    """How well each photograph is predicted from the others.

    depth_m, normals : (h, w), (h, w, 3) the refined surface in the prepared window

    None for fewer than four photographs, or a method that used but one of them.
    """
    if len(prepared) < FEWEST or len(lights) != len(prepared):
        return None
    before = surface_normals(prepared.depth_m, prepared.mask, prepared.camera)
    finite = prepared.mask & np.isfinite(normals).all(axis=-1) & np.isfinite(before).all(axis=-1)
    sample = _sample(prepared, finite)
    if not sample.good.any():
        return None
    shape = sample.images.shape
    points = sample.of(back_project(depth_m, prepared.camera))
    after = sample.of(normals)
    shading = np.broadcast_to(shadings(after, points, lights), shape)
    toward = arriving(lights, points)
    lit = np.einsum("npck,pk->npc", toward, after) > 0
    length, derivatives = _derivatives(normals, prepared.camera, sample)
    slopes = np.einsum("npck,pkj->npcj", toward, derivatives) * lit[..., None]
    there, here = (_gradient(each, prepared.camera, sample) for each in (before, normals))
    refined = _left_out(
        sample, shading, np.broadcast_to(slopes, (*shape, 2)), there - here,
        squared_normal_derivative(length, prepared.camera),
    )  # fmt: skip
    lights = lights_of(sample, sample.of(before))
    plain = np.broadcast_to(shadings(sample.of(before), points, lights), shape)
    errors = _left_out(sample, plain)
    return Prediction(
        refined=_of_each(refined, sample.good, np.median),
        prepared=_of_each(errors, sample.good, np.median),
        brightness=_of_each(sample.images, sample.good, np.mean),
        variation=_of_each(sample.images, sample.good, _deviation),
    )


def prepared_lights(prepared: Prepared) -> Lights:
    """White distant lights (N, 1) that explain the photographs best by the prepared depth."""
    return lights_of(*sampled(prepared))


def sampled(prepared: Prepared, pixels: int = SAMPLE_PIXELS) -> tuple[Sample, Floats]:
    """Values of some pixels that have normals by the prepared depth, and these (P, 3) normals.

    pixels : how many, about
    """
    normals = surface_normals(prepared.depth_m, prepared.mask, prepared.camera)
    sample = _sample(prepared, prepared.mask & np.isfinite(normals).all(axis=-1), pixels)
    return sample, sample.of(normals)


def kept(prepared: Prepared, reason: Finding) -> Estimate:
    """The prepared depth as an estimate, with the lights and albedo that explain the photographs.

    reason : why it is kept.  The confidence is 0: the photographs determine nothing.
    """
    lights = prepared_lights(prepared)
    normals = surface_normals(prepared.depth_m, prepared.mask, prepared.camera)[prepared.mask]
    points = back_project(prepared.depth_m, prepared.camera)[prepared.mask]
    albedo = np.zeros((*prepared.mask.shape, 3))
    albedo[prepared.mask], _ = least_squares_albedo(
        (*prepared.pixels(i), shadings(normals, points, lights.of(i))[0])
        for i in range(len(prepared))
    )
    gain = brightest(albedo[prepared.mask])
    return Estimate(
        log_depth=np.log(prepared.depth_m),
        albedo=albedo / gain,
        confidence=np.zeros(prepared.mask.shape),
        lights=replace(lights, vector=gain * lights.vector, ambient=gain * lights.ambient),
        converged=True,
        findings=(reason,),
    )


def _sample(prepared: Prepared, finite: Mask, pixels: int = SAMPLE_PIXELS) -> Sample:
    """Values of about so many of the pixels (h, w) that have normals, evenly spaced."""
    chosen, images, good = sampled_pixels(prepared, finite, pixels)
    return Sample(images.astype(np.float64), good, chosen)


def _derivatives(normals: Floats, camera: Camera, sample: Sample) -> tuple[Floats, Floats]:
    """|m| (P,) and the derivatives (P, 3, 2) of the normals (h, w, 3) at a sample."""
    normals = np.nan_to_num(normals)
    length = 1 / np.maximum(towards_camera(normals, camera), 1e-3)
    each = normal_derivatives(normals, length, camera)
    return sample.of(length), np.stack([sample.of(one) for one in each], axis=-1)


def _gradient(normals: Floats, camera: Camera, sample: Sample) -> Floats:
    """(P, 2) gradient of log depth that normals (h, w, 3) belong to, at a sample."""
    facing = towards_camera(np.nan_to_num(normals), camera)
    slope = normals[..., :2] / np.maximum(facing, 1e-3)[..., None]
    return np.asarray(sample.of(slope) / np.array([camera.fx, camera.fy]))


def _left_out(
    sample: Sample,
    shading: Floats,
    slopes: Floats | None = None,
    change: Floats | None = None,
    dn_dg2: Floats | None = None,
) -> Floats:
    """(N, P, 3) absolute error of every photograph, left out of its pixels' albedo and normals.

    shading : (N, P, 3) a of equation (3)
    slopes : (N, P, 3, 2) its derivatives with the gradient of log depth; None where that is fixed
    change : (P, 2) from the gradient to the prepared depth's; dn_dg2 : (P,) squared angle of a
        normal over that change
    """
    images, good = sample.images, sample.good
    albedo, squares = least_squares_albedo(zip(images, good, shading, strict=True))
    error = good * (images - albedo * shading)
    own = good * shading**2 / squares
    if slopes is None or change is None or dn_dg2 is None:
        return np.asarray(np.abs(error) / np.maximum(1 - own, 1e-6))

    projected = good[..., None] * albedo[..., None] * slopes
    along = (good[..., None] * shading[..., None] * projected).sum(axis=0) / squares[..., None]
    projected -= good[..., None] * shading[..., None] * along
    tensor = np.einsum("npci,npcj->pij", projected, projected)
    # Precision of the prepared depth's normals: their error is about the refined ones' change.
    noise = MAD_TO_SIGMA * float(np.median(np.abs(error[good]))) + 1e-6
    values = good.sum() / error.shape[1]
    noise *= np.sqrt(values / max(values - 5, 1.0))  # 3 albedos and 2 slopes a pixel are fitted
    change_variance = float(np.mean(dn_dg2 * (change**2).sum(axis=-1))) / 2
    precision = noise**2 / max(change_variance, 1e-12) * dn_dg2
    matrix = tensor + precision[:, None, None] * np.eye(2)
    right = np.einsum("npci,npc->pi", projected, error) + precision[:, None] * change
    # Invertible, too, where one direction is told by nothing but such a depth.
    matrix += (ROUNDING * tensor.trace(axis1=1, axis2=2)[:, None, None] + TINY) * np.eye(2)
    inverse = np.linalg.inv(matrix)
    error = error - np.einsum("npci,pij,pj->npc", projected, inverse, right)
    hat = np.einsum("npci,pij,npdj->npcd", projected, inverse, projected)
    hat[..., range(3), range(3)] += own
    return np.abs(np.linalg.solve((1 + 1e-6) * np.eye(3) - hat, error[..., None])[..., 0])


def lights_of(sample: Sample, normals: Floats) -> Lights:
    """White distant lights (N, 1) that explain a sample best by normals (P, 3)."""
    images, good = sample.images, sample.good
    albedo = np.sum(good * images, axis=0) / np.maximum(good.sum(axis=0), 1)
    lights = np.tile([0.0, 0.0, -1.0, 0.0], (len(images), 1))
    for _ in range(ROUNDS):
        lights = np.array(
            [
                estimate_light(image, use, albedo, normals, light[:3])
                for image, use, light in zip(images, good, lights, strict=True)
            ]
        )
        shading = (np.maximum(lights[:, :3] @ normals.T, 0) + lights[:, 3:])[..., None]
        albedo, _ = least_squares_albedo(zip(images, good, shading, strict=True))
    return Lights(lights[:, None, :3], lights[:, 3:])


def _of_each(values: Floats, good: Mask, figure: Callable[[Floats], Any]) -> Floats:
    """(N,) a figure of each photograph's usable values (N, P, 3), NaN where there are none."""
    return np.array(
        [float(figure(each[use])) if use.any() else np.nan
         for each, use in zip(values, good, strict=True)]
    )  # fmt: skip


def _deviation(values: Floats) -> float:
    """Median deviation from the median."""
    return float(np.median(np.abs(values - np.median(values))))
