"""The paper's robust multi-light model, as published (3.4): light, albedo and depth in turn.

Photographs under a moving lamp see one albedo, so light, albedo and depth follow from the image
model alone, without a regulariser:

    I_ic = rho_c (max(0, s_i . n) + phi_i)                                       equation (3)

for photograph i and channel c.  The albedo starts at 1 and the lights start frontal.  This is the
published procedure, kept as the baseline for the joint method.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.methods.base import (
    Estimate,
    Method,
    brightest,
    photometric_confidence,
    require_options,
    require_photographs,
    require_ranges,
    require_types,
)
from rakelight.methods.levels import Level, finest_level
from rakelight.model import Floats, Progress, ProgressCallback
from rakelight.photometry.images import LightParameters, Linearization, Surface
from rakelight.photometry.lighting import frontal_lights, without_negative_ambient
from rakelight.prepare import Prepared
from rakelight.solve import Solution, assemble, solve
from rakelight.solve.robust import SMALLEST_NOISE

# Rounds of least squares for the lights: the set of lit pixels depends on the light.
HORIZON_ROUNDS = 2


@dataclass(frozen=True, slots=True)
class MultiLightAlternating:
    """What can be set; a good result needs none of it.

    max_iterations : rounds of light, albedo and depth.  More rounds sharpen the detail and let
        the surface as a whole drift along the bas-relief valley.
    tolerance : the rounds end when the energy per observation falls by less than this in one.
    depth_weight : weight of the sensor's depth, as a multiple of what white noise of the sensor's
        size would have.  Raised, the surface keeps to the sensor's shape, its faults included;
        lowered, it follows the photographs and may lose the metric shape.
    min_photographs : fewer are refused.
    """

    max_iterations: int = 15
    tolerance: float = 1e-2
    depth_weight: float = 1.0
    min_photographs: int = 4

    def __post_init__(self) -> None:
        require_types(self)
        require_ranges(self, above_0=("depth_weight",))
        require_options(
            self,
            max_iterations=(self.max_iterations >= 0, "at least 0"),
            tolerance=(self.tolerance < np.inf, "a number"),
            min_photographs=(self.min_photographs >= 3, "at least 3"),
        )


@dataclass(frozen=True, slots=True)
class Fit:
    """The state: a log depth (h, w), lights fitted to it, and the photographs' linearization."""

    log_depth: Floats
    lights: LightParameters
    surface: Surface
    linearization: Linearization
    noise: float
    energy: float


def multi_light_alternating(
    prepared: Prepared, options: MultiLightAlternating, progress: ProgressCallback
) -> Estimate:
    """Refine the prepared depth by the paper's robust multi-light model (3.4).

    Raises MethodError for fewer photographs than `options.min_photographs`.
    """
    require_photographs(
        prepared, "multi-light-alternating", options.min_photographs, for_the_scale=True
    )
    level = finest_level(prepared).weighted(options.depth_weight)

    # The start: the sensor's shape, albedo 1, frontal lights (3.4).
    albedo = np.ones((*level.mask.shape, 3))
    now = best = light_and_albedo(level, level.prior, albedo, lights_at_camera(len(prepared)))
    energies, gain, solve_s = [now.energy], np.inf, 0.0
    while len(energies) <= options.max_iterations and gain > options.tolerance:
        progress(Progress("refine", len(energies), options.max_iterations, now.energy))
        solution = depth(level, now)
        solve_s += solution.seconds
        if not solution.converged:
            break  # refused: the depth stays, and has not come to rest
        now = light_and_albedo(level, solution.value, now.linearization.albedo, now.lights)
        gain = energies[-1] - now.energy
        energies.append(now.energy)
        if now.energy < best.energy:  # lagging can overshoot: a worse iterate is never returned
            best = now
    estimate = finished(level, best, energies, converged=abs(gain) <= options.tolerance)
    return replace(estimate, timings_s={"solve": solve_s})


def lights_at_camera(count: int) -> LightParameters:
    """White lights of unit intensity at the camera, no ambient light: the paper's start."""
    lights = frontal_lights(count)
    return LightParameters.distant(lights.vector, lights.ambient)


def light_and_albedo(
    level: Level, log_depth: Floats, albedo: Floats, lights: LightParameters
) -> Fit:
    """1. Each photograph's light, rho and n fixed; 2. the albedo, s and n fixed: equation (3).

    The photographs determine the product of light and albedo; it is divided so that
    the albedo's 99th percentile is 1.
    """
    photographs, surface = level.photographs, level.surface(log_depth)
    subsampling = photographs.subsampling()
    for _ in range(HORIZON_ROUNDS):
        hessian, slope, _ = photographs.light_terms(
            surface, lights, albedo, project=False, subsampling=subsampling
        )
        each_light = [slice(first, first + 4) for first in range(0, len(slope), 4)]
        before = np.concatenate([lights.vector, lights.ambient[..., None]], axis=-1)[:, 0]
        solved = [
            without_negative_ambient(hessian[k, k], hessian[k, k] @ light - slope[k])
            for k, light in zip(each_light, before, strict=True)
        ]
        lights = lights.moved((np.array(solved) - before)[:, None])
    linearization = photographs.linearize(surface, lights, lagged=True, project=False)
    gain = brightest(linearization.albedo[photographs.active])
    lights, linearization = lights.brighter(gain), linearization.darker(gain)

    # Negative log-likelihood per observation, the photographs' noise being estimated too.
    noise = max(linearization.rms, SMALLEST_NOISE)
    sum_of_squares = level.sensor_sum_of_squares(log_depth)
    energy = float(np.log(noise)) + sum_of_squares / (2 * linearization.observations)
    return Fit(log_depth, lights, surface, linearization, noise, energy)


def depth(level: Level, fit: Fit) -> Solution:
    """3. The log depth, s and rho fixed: with |m| lagged, (3) is linear in its gradient."""
    tensor, rhs = fit.linearization.normal_equations(fit.surface)
    system = assemble(
        level.mask,
        tensor / fit.noise**2,
        rhs / fit.noise**2,
        **level.sensor_terms(np.zeros(level.mask.shape)),
    )
    return solve(system, start=fit.log_depth, origin=level.prior, tolerance=1e-4)


def finished(level: Level, fit: Fit, energies: list[float], converged: bool) -> Estimate:
    """The estimate that `fit` is."""
    _, length = level.normals(fit.log_depth)
    confidence = photometric_confidence(fit.linearization.jtwj, fit.noise, length, level.camera)
    return Estimate(
        log_depth=fit.log_depth,
        albedo=fit.linearization.albedo,
        confidence=np.where(level.photographs.active, confidence, 0.0),
        lights=fit.lights.as_lights(level.middle_m),
        energy=tuple(energies),
        converged=converged,
    )


METHOD = Method(
    "multi-light-alternating",
    multi_light_alternating,
    MultiLightAlternating,
    starts_from_depth=True,
    given_lights="find",
)
