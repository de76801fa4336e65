"""RGBD-Fusion of one photograph (Or-El et al., CVPR 2015): a baseline with eight parameters.

As `fusion_like`, but what light and albedo leave of the intensity I is given to an ambient light
beta that differs from pixel to pixel:

    I = rho S + beta,   S = l . n + phi

    l, phi   least squares of I on (n, 1) with rho = 1, n from the prepared depth
    rho      sum_p (rho S - I)^2 + lambda_rho sum_links w (rho_p - rho_q)^2
    beta     sum_p (beta - (I - rho S))^2 + lambda_beta2 beta^2
                 + lambda_beta1 sum_links w (beta_p - beta_q)^2
    z        sum_p (rho S(z) + beta - I)^2 + lambda_z1 (dz)^2 + lambda_z2 (laplace dz)^2

Links with an intensity difference above tau have w = 0.  dz = z - z0 is in units of the pixel's
footprint z / f, and smoothness is asked of it rather than of z, both as there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.methods.estimate import Estimate, require_options
from rakelight.methods.fusion_like import Depth, View, albedo, finished, harmonics, shading
from rakelight.model import Floats, ProgressCallback
from rakelight.prepare import Prepared
from rakelight.shading.piecewise import EdgeWeights, piecewise_smooth


@dataclass(frozen=True, slots=True)
class Options:
    """The eight parameters of the paper, and when to stop.

    lambda_rho : smoothness of the albedo, relative to the squared shading.  Raised, patches of
        one paint become flat and all change inside them becomes relief; lowered, the albedo
        explains the photograph alone and the depth stays.
    lambda_beta1 : smoothness of the ambient light.  Raised, fine change is left to the depth;
        lowered, the ambient light explains it and the depth stays.
    lambda_beta2 : smallness of the ambient light.  Raised, there is none and the depth explains
        what is left; lowered, the ambient light takes all that the albedo left.
    tau : intensity difference (linear light, 0..1) above which neighbours are not linked at all.
        Raised, weak edges of paint are taken for relief; lowered, more is taken for paint.
    sigma_c : intensity difference at which a link is weak; raised and lowered as tau.
    sigma_d : depth difference in metres at which a link is weak.  Raised, paint is joined across
        steps; lowered, it may change wherever the surface is steep.
    lambda_z1 : trust in the prepared depth, per pixel footprint.  Raised, the depth stays;
        lowered, it follows the shading, errors of the light included.
    lambda_z2 : smoothness of the depth, of its change, per pixel footprint.  Raised, fine relief
        goes; lowered, paint and noise are carved into the surface.
    smooth : False leaves lambda_z2 out: the paper's "no smooth".
    max_iterations : rounds of the fixed point; more than it needs do no harm.
    tolerance : the rounds end when the energy changes by less than this part of it in one.
    """

    lambda_rho: float = 30.0
    lambda_beta1: float = 1.0
    lambda_beta2: float = 10.0
    tau: float = 0.05
    sigma_c: float = 0.05
    sigma_d: float = 0.01
    lambda_z1: float = 3e-5
    lambda_z2: float = 0.1
    smooth: bool = True
    max_iterations: int = 10
    tolerance: float = 1e-2

    def __post_init__(self) -> None:
        require_options(
            self,
            lambda_rho=(0 <= self.lambda_rho < np.inf, "at least 0"),
            lambda_beta1=(0 <= self.lambda_beta1 < np.inf, "at least 0"),
            lambda_beta2=(0 <= self.lambda_beta2 < np.inf, "at least 0"),
            tau=(self.tau >= 0, "at least 0"),
            sigma_c=(0 < self.sigma_c < np.inf, "above 0"),
            sigma_d=(0 < self.sigma_d < np.inf, "above 0, in metres"),
            lambda_z1=(0 < self.lambda_z1 < np.inf, "above 0"),
            lambda_z2=(0 <= self.lambda_z2 < np.inf, "at least 0"),
            max_iterations=(self.max_iterations >= 0, "at least 0"),
            tolerance=(self.tolerance < np.inf, "a number"),
        )


def rgbd_fusion(prepared: Prepared, options: Options, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by the shading of the first photograph."""
    view = View.of(prepared)
    edges = view.edges(options.sigma_c, options.sigma_d, options.tau)
    light = harmonics(view)
    shade = shading(view, light)
    rho = albedo(view, shade, edges, options.lambda_rho)
    beta = ambient(view, view.intensity - rho * shade, edges, options)
    strength = options.lambda_z2 if options.smooth else 0.0
    depth = Depth(view, light, rho, view.intensity - beta, options.lambda_z1, strength)
    fit = depth.fixed_point(options.max_iterations, options.tolerance, progress)
    return finished(prepared, view, light, edges, options.lambda_rho, fit)


def ambient(view: View, left: Floats, edges: EdgeWeights, options: Options) -> Floats:
    """The ambient light beta (h, w) from what light and albedo `left` (h, w) of the intensity."""
    # (beta - t)^2 + b beta^2 is, but for a constant, (1 + b) (beta - t / (1 + b))^2.
    pull = view.seen + options.lambda_beta2
    target = np.where(view.seen, left, 0.0) / np.maximum(pull, np.finfo(float).tiny)
    return piecewise_smooth(target, pull, edges, options.lambda_beta1, view.mask)
