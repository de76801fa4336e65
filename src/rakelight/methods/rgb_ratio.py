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
from itertools import combinations

import numpy as np

from rakelight.geometry.grid import Links, has_gradient, mean_gradient, surface_links
from rakelight.geometry.normals import gradient_directions, normals_from_gradient
from rakelight.methods.estimate import (
    Estimate,
    brightest,
    photometric_confidence,
    require_options,
    scatter,
)
from rakelight.methods.levels import depth_precision
from rakelight.model import Finding, Floats, Lights, Mask, Progress, ProgressCallback
from rakelight.prepare import Prepared
from rakelight.prepare.average import MAD_TO_SIGMA
from rakelight.prepare.linear import SATURATED
from rakelight.shading.lighting import estimate_light
from rakelight.shading.piecewise import edge_weights, piecewise_smooth
from rakelight.solve import assemble, solve
from rakelight.solve.robust import CAUCHY

PAIRS = tuple(combinations(range(3), 2))
# Three pairs of three channels are worth two independent equations.
PAIR_SHARE = 2 / 3
# No photograph is better than this (white is 1), the ratios' weights would be absurd.
SMALLEST_NOISE = 1e-3
LEAST_SHADING, LEAST_ALBEDO = 0.02, 0.01
# Below this part of its lamp a channel is in the lamp's own shadow: its ratios say nothing.
SHADOW = 0.05
# An albedo is a colour of the paint if it is as near as this, logarithmic.
SAME_COLOR = 0.25
# Light and albedo start from nothing; they find each other before the depth follows them.
FIRST_ROUNDS = 3
# The neighbourhood over which equations have to agree, and what their disagreement counts.
AGREE_PX, DISAGREEMENT = 4.0, 3.0
# What the findings are about.
CLOSEST_DEG, DARK, EQUAL_MEANS, MANY_SATURATED = 30.0, 0.05, 0.02, 0.01


@dataclass(frozen=True, slots=True)
class Options:
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
    depth_trust : weight of the sensor's depth, as a multiple of what white noise of the sensor's
        size would have.  Raised, the surface keeps to the sensor's shape, its faults included;
        lowered, it follows the photograph, its misread paint included.
    max_iterations : rounds of light, albedo and depth.
    tolerance : the rounds end when one moves the depth by less than this (root mean square),
        as a multiple of the sensor's noise.  Lowered, there are more rounds.
    """

    lambda_rho: float = 30.0
    sigma_c: float = 0.03
    sigma_d: float = 0.02
    lambda_palette: float = 7.5
    laplacian: float = 0.0
    depth_trust: float = 0.03
    max_iterations: int = 5
    tolerance: float = 0.3

    def __post_init__(self) -> None:
        require_options(
            self,
            lambda_rho=(0 <= self.lambda_rho < np.inf, "at least 0"),
            sigma_c=(0 < self.sigma_c < np.inf, "above 0"),
            sigma_d=(0 < self.sigma_d < np.inf, "above 0"),
            lambda_palette=(0 <= self.lambda_palette < np.inf, "at least 0"),
            laplacian=(0 <= self.laplacian < np.inf, "at least 0"),
            depth_trust=(0 < self.depth_trust < np.inf, "above 0"),
            max_iterations=(self.max_iterations >= 0, "at least 0"),
            tolerance=(0 <= self.tolerance < np.inf, "at least 0"),
        )


@dataclass(frozen=True, slots=True)
class Scene:
    """What is given: the photograph and the prepared depth.

    image : (h, w, 3) linear light; usable : (h, w, 3); noise : of its values
    links : which neighbours are on one surface; pairs : their weights, None without a jump
    prior : (h, w) log of the prepared depth, prior_weight : (h, w) its precision
    """

    prepared: Prepared
    image: Floats
    usable: Mask
    noise: float
    links: Links
    pairs: Floats | None
    prior: Floats
    prior_weight: Floats

    def surface(self, log_depth: Floats) -> tuple[Floats, Floats]:
        """Normals (h, w, 3) and |m| (h, w) of a log depth (h, w)."""
        return normals_from_gradient(*mean_gradient(log_depth, self.links), self.prepared.camera)


def rgb_ratio(prepared: Prepared, options: Options, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by the RGB ratio model (3.3), from the first photograph."""
    scene = observed(prepared, options.depth_trust)
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
        equations = Ratios.of(scene, albedo, light)
        energies.append(equations.energy(normals))
        if done == rounds or moved <= options.tolerance:
            break
        progress(Progress("refine", done + 1, rounds, energies[-1]))
        before = log_depth
        # The first solve meets the equations as they are, the second those that agree.
        for doubt in (False, True):
            log_depth, tensor = depth(scene, equations, log_depth, doubt, options.laplacian)
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
        findings=found(prepared, scene.image[mask], light),
    )


def observed(prepared: Prepared, trust: float) -> Scene:
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
        scatter(usable.astype(np.float64), mask) > 0,
        max(noise, SMALLEST_NOISE),
        links,
        links.pair_weights() if links.cut else None,
        np.log(prepared.depth_m),
        trust * depth_precision(prepared),
    )


def lights(scene: Scene, normals: Floats, albedo: Floats, before: Floats) -> Floats:
    """1. Each channel's lamp (3, 4), rho and n fixed."""
    seen = has_gradient(scene.links)
    found = []
    for c, light in enumerate(before):
        weight = scene.usable[seen, c].astype(np.float64)[:, None]
        image, rho = scene.image[seen, c, None], albedo[seen, c, None]
        found.append(estimate_light(image, weight, rho, normals[seen], light[:3]))
    return np.array(found)


def paint(
    scene: Scene, normals: Floats, depth_m: Floats, albedo: Floats, light: Floats,
    options: Options, first: bool,
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
        smooth = [
            piecewise_smooth(
                target[..., c], weight[..., c], edges, options.lambda_rho, mask, tolerance=1e-2
            )
            for c in range(3)
        ]
        return np.maximum(np.stack(smooth, axis=-1), LEAST_ALBEDO)

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


def nearest_colors(albedo: Floats) -> tuple[Floats, Floats]:
    """The commonest colour (P, 3) around each log albedo (P, 3), and how alike they are, 0..1.

    The colours are the modes of the albedo's distribution (mean shift from a few hundred pixels,
    on a few thousand).

    >>> colors, alike = nearest_colors(np.repeat([[0.0] * 3, [-1.0] * 3, [-0.5] * 3], [9, 9, 1], 0))
    >>> colors[[0, 9], 0].round(2).tolist(), bool(alike[0] > 0.9)
    ([0.0, -1.0], True)
    """
    some = albedo[:: max(1, len(albedo) // 1500)]
    modes = some[:: max(1, len(some) // 200)]

    def near(colors: Floats) -> Floats:
        squares = (colors**2).sum(axis=1)[:, None] + (some**2).sum(axis=1) - 2 * colors @ some.T
        return np.asarray(np.exp(-np.maximum(squares, 0) / (2 * SAME_COLOR**2)))

    for _ in range(15):
        share = near(modes)
        modes = share @ some / share.sum(axis=1)[:, None]
    density = near(modes).sum(axis=1)
    colors: list[Floats] = []
    for mode in modes[np.argsort(-density, kind="stable")]:
        if all(((mode - other) ** 2).sum() > SAME_COLOR**2 / 4 for other in colors):
            colors.append(mode)
    table = np.array(colors)
    label = ((table**2).sum(axis=1) / 2 - albedo @ table.T).argmin(axis=1)
    for k in range(len(table)):
        if (label == k).any():
            table[k] = np.median(albedo[label == k], axis=0)
    apart = ((albedo - table[label]) ** 2).sum(axis=1)
    return table[label], np.asarray(1 / (1 + apart / SAME_COLOR**2) ** 2)


@dataclass(frozen=True, slots=True)
class Ratios:
    """The ratio equations q . m = 0 of all pairs of channels.

    q : (3, h, w, 3), a pair's noise being `noise` (white is 1) times |slope . n|
    slope : (3, 2, h, w, 3) what a pair's two intensities are multiplied by, without m
    """

    q: Floats
    slope: Floats
    scene: Scene
    light: Floats

    @classmethod
    def of(cls, scene: Scene, albedo: Floats, light: Floats) -> Ratios:
        """The equations of a photograph, an albedo (h, w, 3) and lamps (3, 4)."""
        lamp = scene.image - albedo * light[:, 3]
        slopes = [(albedo[..., d, None] * light[d, :3], albedo[..., c, None] * light[c, :3])
                  for c, d in PAIRS]  # fmt: skip
        q = [
            lamp[..., c, None] * one - lamp[..., d, None] * other
            for (c, d), (one, other) in zip(PAIRS, slopes, strict=True)
        ]
        return cls(np.array(q), np.array(slopes), scene, light)

    def misfit(self, normals: Floats) -> tuple[Floats, Mask]:
        """Squared noise (3, h, w) of q . n, and where both channels see their lamps."""
        spread = (np.einsum("abhwk,hwk->abhw", self.slope, normals) ** 2).sum(axis=1)
        variance = np.maximum(spread, 1e-4) * self.scene.noise**2
        strength = np.linalg.norm(self.light[:, :3], axis=-1)
        lit = (normals @ self.light[:, :3].T > SHADOW * strength) & self.scene.usable
        lit &= has_gradient(self.scene.links)[..., None]
        return variance, np.stack([lit[..., c] & lit[..., d] for c, d in PAIRS])

    def energy(self, normals: Floats) -> float:
        """Mean Cauchy loss of the equations in units of their noise."""
        variance, lit = self.misfit(normals)
        squares = along(self.q, normals)[lit] ** 2 / variance[lit]
        return float(np.log1p(squares / CAUCHY**2).mean()) if squares.size else 0.0


def along(q: Floats, directions: Floats) -> Floats:
    """q . direction, (3, h, w), of q (3, h, w, 3) and directions (h, w, 3)."""
    return np.asarray(np.einsum("ahwk,hwk->ahw", q, directions))


def depth(
    scene: Scene, equations: Ratios, log_depth: Floats, doubt: bool, laplacian: float
) -> tuple[Floats, Floats]:
    """3. The log depth (h, w), light and rho fixed, and the tensor (h, w, 3) of its equations.

    doubt : whether equations that the surface `log_depth` does not meet count less: one by one
        (Cauchy), and all where those around disagree
    """
    from scipy.ndimage import gaussian_filter

    normals, length = scene.surface(log_depth)
    variance, lit = equations.misfit(normals)
    weight = np.where(lit, PAIR_SHARE / (variance * length**2), 0.0)
    if doubt:
        squares = np.where(lit, along(equations.q, normals) ** 2 / variance, 0.0)
        around = gaussian_filter(squares.sum(axis=0), AGREE_PX)
        around /= np.maximum(gaussian_filter(lit.sum(axis=0).astype(float), AGREE_PX), 1e-6)
        worse = np.maximum(1.0, DISAGREEMENT * around)
        weight /= worse * (1 + squares / worse / CAUCHY**2)
    u, v = gradient_directions(scene.prepared.camera)
    j_u, j_v = along(equations.q, u), along(equations.q, v)
    tensor = np.stack([(weight * a).sum(axis=0) for a in (j_u**2, j_u * j_v, j_v**2)], axis=-1)
    q_2 = weight * equations.q[..., 2]
    aim = np.stack([(q_2 * j).sum(axis=0) for j in (j_u, j_v)], axis=-1)
    mask = scene.prepared.mask
    smooth = laplacian * float(np.median(scene.prior_weight[mask])) or None
    system = assemble(
        mask, tensor, aim, scene.prior_weight, scene.prior, scene.pairs, laplacian_weight=smooth
    )
    return solve(system, start=log_depth, tolerance=1e-4).value, tensor


def dark_channels(image: Floats) -> list[int]:
    """Which channels of the picture (P, 3) show next to nothing of the object."""
    level = np.median(image, axis=0)
    return [c for c in range(3) if level[c] < DARK * level.max()]


def found(prepared: Prepared, image: Floats, light: Floats) -> tuple[Finding, ...]:
    """What speaks against the picture (P, 3) or its lamps (3, 4)."""
    findings = []
    if len(prepared) > 1:
        message = f"rgb-ratio uses the first of {len(prepared)} photographs"
        findings.append(Finding("note", "first-photograph", message, "use multi-light for all"))
    names, level = ("red", "green", "blue"), np.median(image, axis=0)
    dark = dark_channels(image)
    for c in dark:
        message = f"the {names[c]} channel is dark ({level[c]:.3f} of white): the depth is kept"
        remedy = f"switch the {names[c]} lamp on, or move it nearer; coloured paint needs more"
        findings.append(Finding("warning", "channel-dark", message, remedy))
    toward = light[:, :3] / np.maximum(np.linalg.norm(light[:, :3], axis=1), 1e-12)[:, None]
    for c, d in PAIRS:
        apart = float(np.degrees(np.arccos(np.clip(toward[c] @ toward[d], -1, 1))))
        if apart < CLOSEST_DEG and not {c, d} & set(dark):
            message = f"the {names[c]} and the {names[d]} lamp are {apart:.0f} degrees apart"
            remedy = "set the lamps around the camera, 120 degrees from each other, 40 off its axis"
            findings.append(Finding("warning", "leds-close", message, remedy))
    mean = image.mean(axis=0)
    if np.ptp(mean) < EQUAL_MEANS * mean.mean():
        message = "the three channels are equally bright, as automatic white balance makes them"
        remedy = "fix the camera's white balance: its gains change with what is in view"
        findings.append(Finding("warning", "white-balance", message, remedy))
    values = prepared.photographs[0][prepared.mask]
    saturated = float((values >= SATURATED * np.iinfo(values.dtype).max).mean())
    if saturated > MANY_SATURATED:
        message = f"{100 * saturated:.1f} % of the object's values are saturated"
        remedy = "lower the exposure; against highlights, set polarisers before lamps and camera"
        findings.append(Finding("warning", "highlights", message, remedy))
    return tuple(findings)
