"""Fusion-like refinement of one photograph (the paper's 3.2): a baseline with five parameters.

The intensity I, the `brightness` of the channels in linear light, is explained inside the mask by

    I = rho (l . n + phi)

without attached shadows.  Light, then albedo, then depth, each once:

    l, phi   least squares of I on (n, 1) with rho = 1, n from the prepared depth; robust, so that
             regions of another albedo than the commonest do not count
    rho      sum_p (rho S - I)^2 + lambda_rho sum_links w (rho_p - rho_q)^2,   S = l . n + phi
    z        sum_p c (rho S(z) - I)^2 + lambda_z1 (dz)^2 + lambda_z2 (laplace dz)^2

by fixed point, |m| of the normals lagged.  dz = z - z0, the change of the prepared depth, is in
units of the pixel's footprint z / f on the surface, so that the weights have no unit; in log
depth p that makes it f (p - p0).  The published energy has laplace z; but the prepared depth is
smooth already, and to flatten its rims and noses costs more than any weight of it gains.  Beyond
the paper, c = 1 / (1 + (colour_weight * change of colour)^2): where the colour changes, so does the
albedo, unless it is the shading of fine relief, such as yarn (`texture_likelihood`); its ambient
occlusion, which l . n + phi leaves out, is the change that the smoothness expects
(`occlusion_height`).

From one photograph albedo and relief are ambiguous: this is a baseline to compare with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.camera import focal_px
from rakelight.methods.base import (
    AMBIGUOUS,
    Estimate,
    Method,
    brightest,
    first_only,
    require_ranges,
    require_types,
)
from rakelight.methods.single_image.ambient_occlusion import occlusion_height
from rakelight.methods.single_image.depth_energy import Depth, Fit, View
from rakelight.model import MAD_TO_SIGMA, Floats, Lights, ProgressCallback
from rakelight.photometry.lighting import estimate_light
from rakelight.photometry.piecewise_albedo import EdgeWeights, piecewise_smooth
from rakelight.prepare import Prepared

# Least shading, over its mean, that the intensity is divided by.
DIM = 0.05
# Tukey's constant, in standard deviations: 95 % efficient on Gaussian noise; rounds of its weights.
TUKEY, LIGHT_ROUNDS = 4.685, 8
# Relative residuals to which albedo and depth are solved: the photograph does not determine more.
ALBEDO_ACCURACY, DEPTH_ACCURACY = 1e-2, 1e-1


@dataclass(frozen=True, slots=True)
class FusionLike:
    """The five parameters of the paper, and when to stop.

    lambda_rho : smoothness of the albedo, relative to the squared shading.  Raised, patches of
        one paint become flat and all change inside them becomes relief; lowered, the albedo
        explains the photograph alone and the depth stays.
    sigma_c : intensity difference between neighbours of different paint; the object's typical
        pixel is 1, and fine relief makes no difference.  Up to it a link weakens, beyond it there
        is none.  Raised, soft edges of paint are taken for relief; lowered, shading is taken for
        paint.
    sigma_d : depth difference in metres between neighbours of different paint.  Raised, paint
        is joined across steps; lowered, it may change wherever the surface is steep.
    lambda_z1 : weight of the prepared depth, per pixel footprint.  Raised, the depth stays;
        lowered, it follows the shading, errors of the light included.
    lambda_z2 : smoothness of the depth, of its change, per pixel footprint.  Raised, fine relief
        goes; lowered, paint and noise are carved into the surface.
    colour_weight : not of the paper.  Where the colour changes by 1 / colour_weight (relative) per
        pixel, shading has half its weight, for the albedo changes there too, unless it is fine
        relief.  Raised, the depth stays wherever the albedo varies; 0 weighs the shading the same
        everywhere.
    smooth : False leaves out lambda_z2, colour_weight and ambient occlusion, as the paper's "not
        smooth" does.
    max_iterations : rounds of the fixed point; more than it needs do no harm.
    tolerance : the rounds end when the energy falls by less than this fraction of it in one.
    """

    lambda_rho: float = 30.0
    sigma_c: float = 0.1
    sigma_d: float = 0.01
    lambda_z1: float = 7e-4
    lambda_z2: float = 0.05
    colour_weight: float = 26.0
    smooth: bool = True
    max_iterations: int = 10
    tolerance: float = 1e-2

    def __post_init__(self) -> None:
        require_types(self)
        require_ranges(
            self,
            from_0=("lambda_rho", "lambda_z2", "colour_weight", "max_iterations", "tolerance"),
            above_0=("sigma_c", "sigma_d", "lambda_z1"),
        )


def fusion_like(prepared: Prepared, options: FusionLike, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by the shading of the first photograph."""
    view = View.of(prepared)
    edges = view.edges(options.sigma_c, options.sigma_d, tau=options.sigma_c)
    light = harmonics(view)
    rho = albedo(view, shading(view, light), edges, options.lambda_rho, ALBEDO_ACCURACY)
    depth = depth_energy(view, light, rho, view.intensity, options, DEPTH_ACCURACY)
    fit = depth.fixed_point(options.max_iterations, options.tolerance, progress)
    return finished(prepared, depth, edges, options.lambda_rho, ALBEDO_ACCURACY, fit, "fusion-like")


def depth_energy(
    view: View, light: Floats, rho: Floats, target: Floats, options: FusionLike, accuracy: float
) -> Depth:
    """The energy of the depth; without smoothness, as published: no colour_weight, no occlusion."""
    smoothness, colour_weight = (
        (options.lambda_z2, options.colour_weight) if options.smooth else (0.0, 0.0)
    )
    shading_weight = view.shading_weight(colour_weight)
    expected: Floats = np.zeros(view.mask.shape)
    if smoothness:
        normals, _ = view.level.normals(view.level.prior)
        height, explained = occlusion_height(view.contrast(), light, normals, view.mask)
        expected = -height / focal_px(view.level.camera)
        target = target - explained * rho * shading(view, light)
    return Depth(
        view, light, rho, target, options.lambda_z1, smoothness, shading_weight, accuracy, expected
    )


def harmonics(view: View) -> Floats:
    """The light (l_x, l_y, l_z, phi): robust least squares (Tukey) of the intensity on (n, 1).

    Of the commonest albedo; pixels of another are outliers.
    """
    normals, intensity = view.level.normals(view.level.prior)[0], view.intensity[view.seen]
    normals = normals[view.seen]
    ones = np.ones((len(intensity), 1))
    light = np.array([0.0, 0.0, 0.0, float(np.median(intensity)) if len(intensity) else 0.0])
    for _ in range(LIGHT_ROUNDS if len(intensity) else 0):
        residual = intensity - normals @ light[:3] - light[3]
        sigma = MAD_TO_SIGMA * float(np.median(np.abs(residual)))
        weight = np.maximum(1 - (residual / max(TUKEY * sigma, 1e-9)) ** 2, 0) ** 2
        light = estimate_light(intensity[:, None], weight[:, None], ones, normals)
    return light


def shading(view: View, light: Floats, log_depth: Floats | None = None) -> Floats:
    """S = l . n + phi, (h, w), of a log depth, the prepared one unless given."""
    normals, _ = view.level.normals(view.level.prior if log_depth is None else log_depth)
    return np.asarray(normals @ light[:3] + light[3])


def albedo(
    view: View, shade: Floats, edges: EdgeWeights, smoothness: float, accuracy: float,
    coloured: bool = False,
) -> Floats:  # fmt: skip
    """The albedo of the intensity, (h, w), or coloured, (h, w, 3), under a shading (h, w)."""
    least = DIM * abs(float(shade[view.seen].mean())) if view.seen.any() else DIM
    shade = np.maximum(shade, least)
    image, seen = view.intensity, view.seen
    if coloured:
        image, seen, shade = view.colour, view.level.usable, np.repeat(shade[..., None], 3, axis=-1)
    weight = np.where(seen, shade**2, 0.0)
    return piecewise_smooth(image / shade, weight, edges, smoothness, view.mask, tolerance=accuracy)


def finished(
    prepared: Prepared, depth: Depth, edges: EdgeWeights, smoothness: float, accuracy: float,
    fit: Fit, method: str,
) -> Estimate:  # fmt: skip
    """The estimate: the albedo of each channel, shared out so that its 99th percentile is 1.

    The confidence is low, since one photograph never determines a normal: 0 where the depth was not
    changed, rising to one half where it moved by more than the pixel's footprint, times the weight
    of the shading.
    """
    view, light = depth.view, depth.light
    shade = shading(view, light, fit.log_depth)
    color = albedo(view, shade, edges, smoothness, accuracy, coloured=True) * view.exposure
    gain = brightest(color[view.mask])
    moved = focal_px(view.level.camera) * np.abs(fit.log_depth - view.level.prior)
    confidence = depth.shading_weight * (1 - np.exp(-moved)) / 2
    return Estimate(
        log_depth=fit.log_depth,
        albedo=np.where(view.mask[..., None], color / gain, 0.0),
        confidence=np.where(view.mask & view.seen, confidence, 0.0),
        lights=Lights(gain * light[None, None, :3], gain * light[None, 3:]),
        energy=fit.energies,
        converged=fit.converged,
        findings=(AMBIGUOUS, *first_only(prepared, method)),
        timings_s={"solve": fit.solve_s},
    )


METHOD = Method("fusion-like", fusion_like, FusionLike, lighting="ambient")
