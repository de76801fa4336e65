"""RGB ratio model (3.3): one photograph under a red, a green and a blue lamp.

Each channel sees its own lamp (l_c, phi_c), so that one photograph is three:

    I_c = rho_c (l_c . n + phi_c)

Light, albedo and depth in turn.  For the depth, the normalisation of n = m / |m| cancels in the
ratio of two channels c, d, which leaves an equation that is linear in the gradient of log depth:

    (I_c - rho_c phi_c) rho_d l_d . m = (I_d - rho_d phi_d) rho_c l_c . m

Beyond the paper: the albedo is drawn to the few colours that most things are painted with, and
an equation counts by how well the surface around it meets it.  Where paint passes for shape or
the reverse, neighbouring equations contradict each other, and the sensor's depth stays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.averaging import Averaging, data_terms
from rakelight.geometry.grid import Links, has_gradient, mean_gradient, surface_links
from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.base import (
    Estimate,
    Method,
    brightest,
    first_only,
    photometric_confidence,
    require_options,
    require_ranges,
    scatter,
)
from rakelight.methods.levels import NEARLY_ONE, depth_precision
from rakelight.methods.rgb_ratio.findings import dark_channels, rgb_findings
from rakelight.methods.rgb_ratio.ratios import Ratios
from rakelight.model import MAD_TO_SIGMA, Floats, Lights, Mask, Progress, ProgressCallback
from rakelight.photometry.color_modes import nearest_colors
from rakelight.photometry.lighting import estimate_light
from rakelight.photometry.piecewise_albedo import edge_weights, piecewise_smooth
from rakelight.prepare import Prepared
from rakelight.solve import assemble, solve

# No photograph is better than this (white is 1), the ratios' weights would be absurd.
SMALLEST_NOISE = 1e-2
# The weight of the sensor's depth, in white noise's: between these, and not changed by less than
# a factor.
LEAST_TRUST, MOST_TRUST, MORE = 0.03, 3.0, 1.5
# So many pixels share an error of the ratios, whatever the depth's errors do.
COHERENT_PIXELS = 0.2
# A change of the depth this much larger than its detail lets expect is misread paint.
DRIFT = 15.0
# The weight of the sensor's slopes, errors of which are as large as the change and shared.
SLOPE_TRUST = 0.01
LEAST_SHADING, LEAST_ALBEDO = 0.02, 0.01
# Light and albedo start from nothing; they find each other before the depth follows them.
FIRST_ROUNDS = 2


@dataclass(frozen=True, slots=True)
class RgbRatio:
    """What can be set; a good result needs none of it.

    lambda_rho : smoothness of the albedo within an area of paint, relative to the photograph.
        Raised, areas become even; lowered, the albedo takes up shading, and relief is lost.
    sigma_c : albedo difference (root sum of squares over the channels, white is 1) that is an
        edge of the paint.  Raised, faint edges become relief; lowered, noise breaks up the areas.
    sigma_d : depth difference between neighbours, metres, that is an edge of the paint too.
        Raised, areas reach across depth edges; lowered, steep slopes break them up.
    lambda_palette : pull of the albedo towards the commonest colours around its own, relative to
        the photograph.  Raised, faint paint becomes relief; 0 is the paper's albedo.
    laplacian : weight of the squared second differences of log depth, relative to the prior's
        weight in the middle.  Raised, noise and fine relief are smoothed away; 0 smooths nothing.
    depth_weight : weight of the sensor's depth, as a multiple of what white noise of the sensor's
        size would have; None chooses it from the data.  Raised, the surface keeps to the
        sensor's shape, its faults included; lowered, it follows the photograph, its misread paint
        included.
    max_iterations : rounds of light, albedo and depth.
    tolerance : the rounds end when one moves the depth by less than this (root mean square),
        as a multiple of the sensor's noise.  Lowered, there are more rounds.
    """

    lambda_rho: float = 30.0
    sigma_c: float = 0.03
    sigma_d: float = 0.02
    lambda_palette: float = 7.5
    laplacian: float = 0.0
    depth_weight: float | None = None
    max_iterations: int = 5
    tolerance: float = 0.3

    def __post_init__(self) -> None:
        require_ranges(
            self,
            from_0=("lambda_rho", "lambda_palette", "laplacian", "max_iterations", "tolerance"),
            above_0=("sigma_c", "sigma_d"),
        )
        trust = self.depth_weight
        require_options(self, depth_weight=(trust is None or 0 < trust < np.inf, "above 0"))


@dataclass(frozen=True, slots=True)
class Scene:
    """What is given: the photograph and the prepared depth.

    image : (h, w, 3) linear light; noise : of its values
    usable : (h, w, 3) which values say something of a normal
    links : which neighbours are on one surface; pairs : their weights, None without a jump
    prior : (h, w) log of the prepared depth, prior_weight : (h, w) its precision
    averaging : K, means over the sensor's pixels; None where those are about as small
    """

    prepared: Prepared
    image: Floats
    usable: Mask
    noise: float
    links: Links
    pairs: Floats | None
    prior: Floats
    prior_weight: Floats
    averaging: Averaging | None

    def surface(self, log_depth: Floats) -> tuple[Floats, Floats]:
        """Normals (h, w, 3) and |m| (h, w) of a log depth (h, w)."""
        return normals_from_gradient(*mean_gradient(log_depth, self.links), self.prepared.camera)


def rgb_ratio(prepared: Prepared, options: RgbRatio, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by the RGB ratio model (3.3), from the first photograph."""
    scene = observed(prepared)
    trust = options.depth_weight or LEAST_TRUST
    most = options.depth_weight or MOST_TRUST
    mask = prepared.mask
    log_depth = scene.prior
    albedo: Floats = np.ones((*mask.shape, 3))
    light: Floats = np.tile([0.0, 0.0, -1.0, 0.0], (3, 1))
    tensor: Floats = np.zeros((*mask.shape, 3))
    moved = np.inf
    energies: list[float] = []
    # Two channels make one equation, which nothing contradicts: then the depth is kept.
    rounds = 0 if dark_channels(scene.image[mask]) else options.max_iterations
    for done in range(rounds + 1):
        normals, length = scene.surface(log_depth)
        depth_m = np.exp(log_depth)
        for again in range(1 if done else FIRST_ROUNDS):
            light = lights(scene, normals, albedo, light)
            first = done == again == 0
            albedo, light = paint(scene, normals, depth_m, albedo, light, options, first)
        equations = Ratios(scene.image, scene.usable, scene.noise, albedo, light)
        energies.append(equations.energy(normals))
        if done == rounds or moved <= options.tolerance:
            break
        progress(Progress("refine", done + 1, rounds, energies[-1]))
        before = log_depth
        # The first solve meets the equations as they are, the second those that agree.
        for doubt in (False, True):
            log_depth, tensor = depth(scene, equations, trust, log_depth, doubt, options.laplacian)
        while (sound := min(deserved_trust(scene, log_depth, trust), most)) > MORE * trust:
            trust = sound
            log_depth, tensor = depth(scene, equations, trust, log_depth, True, options.laplacian)
        step = (log_depth - before) * prepared.depth_m / prepared.sigma_m
        moved = float(np.sqrt(np.mean(step[mask] ** 2)))
    _, length = scene.surface(log_depth)
    confidence = photometric_confidence(tensor, 1.0, length, prepared.camera, mask)
    return Estimate(
        log_depth=log_depth,
        albedo=np.where(mask[..., None], albedo, 0.0),
        confidence=np.where(has_gradient(scene.links), confidence, 0.0),
        lights=Lights(light[None, :, :3], light[None, :, 3]),
        energy=tuple(energies),
        converged=rounds == 0 or moved <= options.tolerance,
        findings=(
            *first_only(prepared, "rgb-ratio"),
            *rgb_findings(prepared, scene.image[mask], light),
        ),
    )


def observed(prepared: Prepared) -> Scene:
    """The first photograph, and the prepared depth as far as it is trusted."""
    mask = prepared.mask
    values, usable = prepared.pixels(0)
    image = scatter(values.astype(np.float64), mask)
    # Neither slopes nor straight edges along an axis are in the mixed second difference.
    mixed = np.diff(np.diff(np.where(mask[..., None], image, np.nan), axis=0), axis=1) / 2
    mixed = np.abs(mixed[np.isfinite(mixed)])
    noise = MAD_TO_SIGMA * float(np.median(mixed)) if mixed.size else 0.0
    links = surface_links(prepared.depth_m, mask, prepared.camera)
    return Scene(
        prepared,
        image,
        (scatter(usable.astype(np.float64), mask) > 0) & has_gradient(links)[..., None],
        max(noise, SMALLEST_NOISE),
        links,
        links.pairs,
        np.log(prepared.depth_m),
        depth_precision(prepared),
        prepared.sensor.averaging(mask) if prepared.factor > NEARLY_ONE else None,
    )


def lights(scene: Scene, normals: Floats, albedo: Floats, before: Floats) -> Floats:
    """1. Each channel's lamp (3, 4), rho and n fixed."""
    seen = has_gradient(scene.links)
    normals, image, rho = normals[seen], scene.image[seen], albedo[seen]
    weight = scene.usable[seen].astype(np.float64)
    return np.array(
        [
            estimate_light(
                image[:, c, None], weight[:, c, None], rho[:, c, None], normals, light[:3]
            )
            for c, light in enumerate(before)
        ]
    )


def paint(
    scene: Scene, normals: Floats, depth_m: Floats, albedo: Floats, light: Floats,
    options: RgbRatio, first: bool,
) -> tuple[Floats, Floats]:  # fmt: skip
    """2. The albedo (h, w, 3), light and n fixed; scaled so that every 99th percentile is 1.

    Edges and colours are those of the albedo before; at first, of the photograph over its shading.
    """
    from scipy.ndimage import gaussian_filter

    mask = scene.prepared.mask
    shading = np.maximum(np.maximum(normals @ light[:, :3].T, 0) + light[:, 3], LEAST_SHADING)
    weight = np.where(scene.usable, shading**2, 0.0)
    target = scene.image / shading

    def smoothed(like: Floats, target: Floats, weight: Floats) -> Floats:
        edges = edge_weights(like, depth_m, mask, sigma_c=options.sigma_c, sigma_d=options.sigma_d)
        smooth = piecewise_smooth(target, weight, edges, options.lambda_rho, mask, tolerance=1e-2)
        return np.maximum(smooth, LEAST_ALBEDO)

    if first:
        albedo = gaussian_filter(scene.image, 1.0, axes=(0, 1)) / shading
    albedo = smoothed(albedo, target, weight)
    if options.lambda_palette > 0:
        color, alike = nearest_colors(np.log(albedo[mask]))
        pull = options.lambda_palette * scatter(alike, mask)[..., None]
        common = scatter(np.exp(color), mask)
        total = weight + pull
        target = (weight * target + pull * common) / np.maximum(total, np.finfo(float).tiny)
        albedo = smoothed(albedo, target, total)
    gain = np.array([brightest(albedo[mask, c]) for c in range(3)])
    return albedo / gain, light * gain[:, None]


def depth(
    scene: Scene,
    equations: Ratios,
    trust: float,
    log_depth: Floats,
    doubt: bool,
    laplacian: float,
) -> tuple[Floats, Floats]:
    """3. The log depth (h, w), light and rho fixed, and the tensor (h, w, 3) of its equations.

    doubt : whether equations count less where the surface `log_depth` does not meet them
    """
    camera, mask = scene.prepared.camera, scene.prepared.mask
    ratios, rhs = equations.terms(*scene.surface(log_depth), camera, doubt)
    tensor = ratios
    if doubt:  # where the equations say little, the sensor's slopes stay
        slopes, changed = (
            np.stack(mean_gradient(image, scene.links), axis=-1)
            for image in (scene.prior, log_depth - scene.prior)
        )
        weight = SLOPE_TRUST / max(float(np.median(changed[mask] ** 2)), 1e-12)
        tensor, rhs = ratios + weight * np.array([1.0, 0.0, 1.0]), rhs + weight * slopes
    held = trust * scene.prior_weight
    smooth = laplacian * float(np.median(held[mask])) or None
    sensor = data_terms(scene.averaging, held, scene.prior)
    system = assemble(
        mask, tensor, rhs, pair_weights=scene.pairs, laplacian_weight=smooth, **sensor
    )
    return solve(system, start=log_depth, tolerance=1e-3).value, ratios


def deserved_trust(scene: Scene, log_depth: Floats, trust: float) -> float:
    """The weight of the sensor's depth that the change of the depth under `trust` asks for.

    Errors e of the sensor that hang together over l pixels say that much less than independent
    ones.  If there is one such length, <e^2> / <|de|^2> and <|de|^2> / <|dde|^2> are both about
    l^2; of a surface that follows misread paint, the first is much larger, and more trust is due.
    White noise, l = 1/2 after preparation, leaves hardly an error in the shape as a whole: hence
    the second term.  (Medians, so that jumps do not count.)
    """
    change = np.where(scene.prepared.mask, log_depth - scene.prior, np.nan)
    steps = [np.diff(change, axis=axis) for axis in (0, 1)]
    bends = [np.diff(step, axis=axis) for axis, step in enumerate(steps)]
    whole, steep, bent = (
        _median(np.concatenate([each.ravel() for each in images]) ** 2)
        for images in ([change - np.nanmedian(change)], steps, bends)
    )
    if whole * bent > DRIFT * steep**2:
        trust = 3 * trust
    rough = bent / max(steep, 1e-30)
    return max(trust, COHERENT_PIXELS * rough, 1.5 * COHERENT_PIXELS * rough**2)


def _median(values: Floats) -> float:
    """Of those that are numbers; 0 where there are none, as of bends where nothing is wide."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else 0.0


METHOD = Method("rgb-ratio", rgb_ratio, RgbRatio)
