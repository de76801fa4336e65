"""The paper's robust multi-light model, as published (3.4): light, albedo and depth in turn.

Photographs under a moving lamp see one albedo, so light, albedo and depth follow from the image
model alone, without a regulariser:

    I_ic = rho_c (max(0, s_i . n) + phi_i)                                       equation (3)

for photograph i and channel c.  The albedo starts at 1 and the lights start frontal.  This is the
published procedure, kept as the baseline for the joint method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.grid import has_gradient, mean_gradient
from rakelight.geometry.normals import gradient_directions, normals_from_gradient
from rakelight.methods.estimate import (
    Estimate,
    photometric_confidence,
    require_photographs,
    scatter,
)
from rakelight.model import Floats, Lights, Progress, ProgressCallback
from rakelight.prepare import Prepared
from rakelight.shading.albedo import AlbedoFit
from rakelight.shading.harmonics import lit, shading
from rakelight.shading.lighting import estimate_light, frontal_lights
from rakelight.solve import assemble, solve

# No photograph is better than this (white is 1), even if the model explains it exactly.
SMALLEST_NOISE = 1e-5


@dataclass(frozen=True, slots=True)
class Options:
    """What can be set; a good result needs none of it.

    max_iterations : rounds of light, albedo and depth.  More rounds sharpen the detail and let
        the surface as a whole drift along the bas-relief valley.
    tolerance : the rounds end when the energy per observation falls by less than this in one.
    depth_trust : weight of the sensor's depth, as a multiple of what white noise of the sensor's
        size would have.  Raised, the surface keeps to the sensor's shape, its faults included;
        lowered, it follows the photographs and may lose the metric shape.
    min_photographs : fewer are refused.
    """

    max_iterations: int = 25
    tolerance: float = 5e-3
    depth_trust: float = 1.0
    min_photographs: int = 4


def multi_light_alternating(
    prepared: Prepared, options: Options, progress: ProgressCallback
) -> Estimate:
    """Refine the prepared depth by the paper's robust multi-light model (3.4).

    Raises MethodError for fewer photographs than `options.min_photographs`.
    """
    require_photographs(prepared, "multi-light-alternating", options.min_photographs)
    prior = np.log(prepared.depth_m)
    prior_weight = options.depth_trust * (prepared.depth_m / prepared.sigma_m) ** 2

    def explain(log_depth: Floats, albedo: Floats, lights: Lights) -> Explanation:
        normals, length = _normals(log_depth, prepared)
        # 1. Light of each photograph, 2. albedo from all of them: least squares on equation (3).
        lights, albedo = light_and_albedo(prepared, normals, albedo, lights)
        terms = depth_terms(prepared, normals, length, albedo, lights)
        # Negative log-likelihood per observation, the photographs' noise being estimated too.
        misfit = float((prior_weight * (log_depth - prior) ** 2)[prepared.mask].sum())
        energy = float(np.log(terms.noise)) + misfit / (2 * terms.observations)
        return Explanation(log_depth, albedo, lights, length, terms, energy)

    # The start: the sensor's shape, albedo 1, frontal lights (3.4).
    now = explain(
        prior,
        albedo=np.ones((int(prepared.mask.sum()), 3)),
        lights=frontal_lights(len(prepared.photographs)),
    )
    best, energies, gain = now, [now.energy], np.inf
    while len(energies) <= options.max_iterations and gain > options.tolerance:
        progress(Progress("refine", len(energies), options.max_iterations, now.energy))
        # 3. Depth: with its normalisation |m| lagged, (3) is linear in the gradient of log depth.
        system = assemble(
            prepared.mask,
            tensor=scatter(now.terms.tensor / now.terms.noise**2, prepared.mask),
            vector=scatter(now.terms.vector / now.terms.noise**2, prepared.mask),
            data_weight=prior_weight,
            data_target=prior,
        )
        now = explain(solve(system, start=now.log_depth).value, now.albedo, now.lights)
        gain = energies[-1] - now.energy
        energies.append(now.energy)
        if now.energy < best.energy:  # lagging can overshoot: a worse iterate is never returned
            best = now
    confidence = photometric_confidence(
        best.terms.tensor, best.terms.noise, best.length, prepared.camera
    )
    return Estimate(
        log_depth=best.log_depth,
        albedo=scatter(best.albedo, prepared.mask),
        confidence=scatter(confidence, prepared.mask),
        lights=best.lights,
        energy=tuple(energies),
        converged=abs(gain) <= options.tolerance,
    )


@dataclass(frozen=True, slots=True)
class Explanation:
    """A log depth (h, w), the albedo (P, 3) and lights that fit it, and how well they do.

    length : (P,) |m| of the normals; terms : what the photographs ask of the depth next
    """

    log_depth: Floats
    albedo: Floats
    lights: Lights
    length: Floats
    terms: DepthTerms
    energy: float


def light_and_albedo(
    prepared: Prepared, normals: Floats, albedo: Floats, lights: Lights
) -> tuple[Lights, Floats]:
    """White lights given the albedo (P, 3), then the albedo given those lights.

    The product of the two is what the photographs determine; it is shared out so that the 99th
    percentile of the albedo is 1.
    """
    fitted = np.empty((len(lights), 4))
    inner = has_gradient(prepared.mask)[prepared.mask]  # the pixels that have a normal
    fit = AlbedoFit(len(albedo))
    for i in range(len(lights)):
        image, good = prepared.pixels(i)
        weight = good & inner[:, None]
        fitted[i] = estimate_light(image, weight, albedo, normals, lights.vector[i, 0])
        fit.add(image, shading(normals, fitted[i, :3], fitted[i, 3]), weight)
    albedo = fit.albedo()
    scale = max(float(np.percentile(albedo[inner], 99)), 1e-6)
    return Lights(fitted[:, None, :3] * scale, fitted[:, 3:] * scale), albedo / scale


@dataclass(frozen=True, slots=True)
class DepthTerms:
    """The photographs' say on the gradient g = (p_u, p_v) of log depth, summed per pixel.

    Their squared residuals are  g^T M g - 2 b . g + const:  M is `tensor` (P, 3) as uu, uv, vv and
    b is `vector` (P, 2).  noise : rms residual of a pixel value at the present surface;
    observations : how many values were counted.
    """

    tensor: Floats
    vector: Floats
    noise: float
    observations: int


def depth_terms(
    prepared: Prepared,
    normals: Floats,
    length: Floats,
    albedo: Floats,
    lights: Lights,
) -> DepthTerms:
    """Equation (3) as a least squares problem in the gradient of log depth, |m| lagged.

    Where the lamp is above the horizon, s . n = (g . (s . dm/dg) - s_z) / |m|; elsewhere the
    photograph sees ambient light only and says nothing about the surface.
    """
    along_u, along_v = (d[prepared.mask] for d in gradient_directions(prepared.camera))
    tensor, vector = np.zeros((len(albedo), 3)), np.zeros((len(albedo), 2))
    squares, observations = 0.0, 0
    inner = has_gradient(prepared.mask)[prepared.mask]
    for i in range(len(lights)):
        image, good = prepared.pixels(i)
        weight = good & inner[:, None]
        s, phi = lights.vector[i, 0], float(lights.ambient[i, 0])
        residual = albedo * shading(normals, s, phi)[:, None] - image
        squares += float((residual[weight] ** 2).sum())
        observations += int(weight.sum())

        over_length = lit(normals, s) / length
        j_u, j_v = over_length * (along_u @ s), over_length * (along_v @ s)
        constant = albedo * (phi - s[2] * over_length)[:, None] - image
        rho_squared = (weight * albedo**2).sum(axis=1)
        pull = (weight * albedo * constant).sum(axis=1)
        tensor += rho_squared[:, None] * np.column_stack([j_u * j_u, j_u * j_v, j_v * j_v])
        vector -= pull[:, None] * np.column_stack([j_u, j_v])
    noise = max(float(np.sqrt(squares / observations)), SMALLEST_NOISE)
    return DepthTerms(tensor, vector, noise, observations)


def _normals(log_depth: Floats, prepared: Prepared) -> tuple[Floats, Floats]:
    """Normals (P, 3) and |m| (P,) on the mask."""
    gradient = mean_gradient(log_depth, prepared.mask)
    normals, length = normals_from_gradient(*gradient, prepared.camera)
    return normals[prepared.mask], length[prepared.mask]
