"""RGBD-Fusion of one photograph (Or-El et al., CVPR 2015): a baseline with eight parameters.

As `fusion_like`, but what light and albedo leave of the intensity I is given to an ambient light
beta that differs from pixel to pixel:

    I = rho S + beta,   S = l . n + phi

    l, phi   robust least squares of I on (n, 1) with rho = 1, n from the prepared depth
    rho      sum_p (rho S - I)^2 + lambda_rho sum_links w (rho_p - rho_q)^2
    beta     sum_p (beta - (I - rho S))^2 + lambda_beta2 beta^2
                 + lambda_beta1 sum_links w (beta_p - beta_q)^2
    z        sum_p c (rho S(z) + beta - I)^2 + lambda_z1 (dz)^2 + lambda_z2 (laplace dz)^2

Links with an intensity difference above tau have w = 0.  dz = z - z0 is in units of the pixel's
footprint z / f, and smoothness is asked of it rather than of z, both as there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.methods.base import Estimate, Method, require_options, require_ranges
from rakelight.methods.single_image.depth_energy import View
from rakelight.methods.single_image.fusion_like import (
    FusionLike,
    albedo,
    depth_energy,
    finished,
    harmonics,
    shading,
)
from rakelight.model import Floats, ProgressCallback
from rakelight.photometry.piecewise_albedo import EdgeWeights, piecewise_smooth
from rakelight.prepare import Prepared

# Relative residual to which systems are solved; the published method solves them exactly.
ACCURACY = 1e-3


@dataclass(frozen=True, slots=True)
class RgbdFusion(FusionLike):
    """The eight parameters of the paper: the five of `FusionLike`, and

    lambda_beta1 : smoothness of the ambient light.  Raised, fine change is left to the depth;
        lowered, the ambient light explains it and the depth stays.
    lambda_beta2 : smallness of the ambient light.  Raised, there is none and the depth explains
        what is left; lowered, the ambient light takes all that the albedo left.
    tau : intensity difference, the object's typical pixel being 1, above which neighbours are
        not linked at all.  Raised, weak edges of paint are taken for relief; lowered, more is
        taken for paint.
    """

    lambda_beta1: float = 1.0
    lambda_beta2: float = 10.0
    tau: float = 0.1

    def __post_init__(self) -> None:
        FusionLike.__post_init__(self)
        require_ranges(self, from_0=("lambda_beta1", "lambda_beta2"))
        require_options(self, tau=(self.tau >= 0, "at least 0"))


def rgbd_fusion(prepared: Prepared, options: RgbdFusion, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by the shading of the first photograph."""
    view = View.of(prepared)
    edges = view.edges(options.sigma_c, options.sigma_d, options.tau)
    light = harmonics(view)
    shade = shading(view, light)
    rho = albedo(view, shade, edges, options.lambda_rho, ACCURACY)
    beta = ambient(view, view.intensity - rho * shade, edges, options)
    depth = depth_energy(view, light, rho, view.intensity - beta, options, ACCURACY)
    fit = depth.fixed_point(options.max_iterations, options.tolerance, progress)
    return finished(prepared, depth, edges, options.lambda_rho, ACCURACY, fit, "rgbd-fusion")


def ambient(view: View, remaining: Floats, edges: EdgeWeights, options: RgbdFusion) -> Floats:
    """The ambient light beta (h, w) from the residual of light and albedo, `remaining` (h, w)."""
    # (beta - t)^2 + b beta^2 is, but for a constant, (1 + b) (beta - t / (1 + b))^2.
    weight = view.seen + options.lambda_beta2
    target = np.where(view.seen, remaining, 0.0) / np.maximum(weight, np.finfo(float).tiny)
    return piecewise_smooth(target, weight, edges, options.lambda_beta1, view.mask)


METHOD = Method("rgbd-fusion", rgbd_fusion, RgbdFusion, lighting="ambient")
