"""A method of one's own: the residuals are yours, the depth is solved for by `rakelight.solve`.

    python examples/04_own_method.py

A photograph i shows a matte surface of albedo rho and normal n under light s_i, a_i as

    I_i = rho (s_i . n + a_i)

The method finds lights, albedo and depth in turn, from the prepared depth on.  Lights and albedo
are linear least squares.  For the depth, p = log z, the residuals

    r_i = I_i - rho (s_i . n(p) + a_i)

are linear in the gradient of p to first order, with the slope J_i = rho (s_i . dn/dgrad p).  What
`rakelight.solve` wants of a pixel is therefore

    tensor   sum_i J_i J_i^T, (h, w, 3) as uu, uv, vv
    vector   sum_i J_i (r_i + J_i . grad p), (h, w, 2): the right side for p itself, not for a step
    weight   how much the prepared depth counts, (h, w)

Handed to `rakelight.refine` as a `Method`, it gets the preparation, checks and findings of every
method.  To make it one of rakelight's, put `Options` and `small` into a file methods/small.py and
the line "small": "small" into METHODS there; `--method small --set rounds=3` is the same then.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import rakelight
from rakelight.geometry.grid import Links, has_gradient, mean_gradient, surface_links
from rakelight.geometry.normals import normal_derivatives, normals_from_gradient
from rakelight.methods import Method
from rakelight.methods.base import Estimate, brightest, scatter
from rakelight.metrics import evaluate_depth
from rakelight.model import Floats, Lights, Mask, Progress, ProgressCallback
from rakelight.prepare import Prepared
from rakelight.solve import DepthSystem, assemble, solve
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene


@dataclass(frozen=True, slots=True)
class Options:
    """rounds : of lights, albedo and depth; depth_weight : times that of the sensor's noise."""

    rounds: int = 5
    depth_weight: float = 2.0


def small(prepared: Prepared, options: Options, progress: ProgressCallback) -> Estimate:
    """Refine the depth of `prepared` by all its photographs."""
    mask = prepared.mask
    links = surface_links(prepared.depth_m, mask, prepared.camera)  # none across depth jumps
    values, usable = zip(*map(prepared.pixels, range(len(prepared))), strict=True)
    grey = np.stack(values).mean(axis=2)  # (N, P), linear light of the P pixels of the mask
    seen = np.stack(usable).all(axis=2) & has_gradient(links)[mask]

    log_depth, rho = np.log(prepared.depth_m), grey.mean(axis=0)
    energy: list[float] = []
    for step in range(options.rounds):
        progress(Progress("refine", step + 1, options.rounds))
        gradient = mean_gradient(log_depth, links)
        normals, length = normals_from_gradient(*gradient, prepared.camera)
        light, rho, shade = light_and_albedo(grey, seen, normals[mask], rho)

        lit = seen & (shade > 0.05 * shade.max())
        residual = np.where(lit, grey - rho * shade, 0.0)
        noise = 1.4826 * float(np.median(np.abs(residual[lit])))
        weight = lit / (1 + (residual / (3 * noise)) ** 2)  # Cauchy's: highlights, cast shadows
        energy.append(float((weight * residual**2).sum() / weight.sum()))

        slopes = [
            rho * (light[:, :3] @ derivative[mask].T)
            for derivative in normal_derivatives(normals, length, prepared.camera)
        ]
        system = depth_system(
            prepared, links, gradient, slopes, residual, weight, options.depth_weight * noise**2
        )
        solution = solve(system, start=log_depth, tolerance=1e-3)
        log_depth = solution.value

    scale = brightest(rho)  # every result's albedo has its 99th percentile at 1
    return Estimate(
        log_depth=log_depth,
        albedo=scatter(np.repeat(rho[:, None] / scale, 3, axis=1), mask),
        confidence=scatter(lit.mean(axis=0), mask),  # the share of photographs that tell something
        lights=Lights(scale * light[:, None, :3], scale * light[:, None, 3]),
        energy=tuple(energy),
        converged=solution.status == "converged" and energy[-1] > 0.95 * energy[-2],
    )


def light_and_albedo(
    grey: Floats, seen: Mask, normals: Floats, rho: Floats
) -> tuple[Floats, Floats, Floats]:
    """Lights (N, 4) by least squares with albedo rho (P,); then rho, and the shading (N, P)."""
    basis = np.column_stack([normals, np.ones(len(normals))])
    light = np.stack(
        [
            np.linalg.lstsq((rho[:, None] * basis)[ok], each[ok], rcond=None)[0]
            for each, ok in zip(grey, seen, strict=True)
        ]
    )
    shade = np.maximum(light @ basis.T, 0.0)
    known = np.maximum((seen * shade**2).sum(axis=0), 1e-9)
    return light, (seen * grey * shade).sum(axis=0) / known, shade


def depth_system(
    prepared: Prepared,
    links: Links,
    gradient: tuple[Floats, Floats],
    slopes: Sequence[Floats],
    residual: Floats,
    weight: Floats,
    depth_weight: float,
) -> DepthSystem:
    """The normal equations of one Gauss-Newton step; slopes : J_u and J_v, (N, P) each."""
    mask, (J_u, J_v) = prepared.mask, slopes
    target = residual + J_u * gradient[0][mask] + J_v * gradient[1][mask]
    tensor = [(weight * a * b).sum(axis=0) for a, b in ((J_u, J_u), (J_u, J_v), (J_v, J_v))]
    vector = [(weight * J * target).sum(axis=0) for J in slopes]
    # The sensor's noise of log depth; each of its pixels is factor^2 of ours.
    sigma = prepared.sigma_m / prepared.depth_m * prepared.factor
    return assemble(
        mask,
        scatter(np.stack(tensor, axis=1), mask),
        scatter(np.stack(vector, axis=1), mask),
        depth_weight / sigma**2,
        np.log(prepared.depth_m),
        pair_weights=links.pairs,
    )


SMALL = Method("small", small, Options)

if __name__ == "__main__":
    vase = make_shape("vase")
    scene = SceneOptions(camera=vase.camera.scaled(0.25), photographs=8)
    capture, truth = render_scene(vase, make_albedo("pattern"), scene)

    result = rakelight.refine(capture, SMALL, options=Options(rounds=8))

    before = evaluate_depth(result.prepared_depth, result.camera, truth)
    after = rakelight.evaluate(result, truth)
    print(f"{result.method}, {result.options}")
    print("mean error of the normals, degrees; of the depth, mm (rms)")
    for name, scores in (("prepared", before), ("refined", after)):
        print(f"{name:10}{scores.normals.mae_deg:8.2f}{scores.depth.rmse_mm:8.2f}")
