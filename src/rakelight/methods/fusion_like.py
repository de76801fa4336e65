"""Fusion-like refinement of one photograph (the paper's 3.2): a baseline with five parameters.

The intensity I, the mean of the usable channels in linear light, is explained inside the mask by

    I = rho (l . n + phi)

without attached shadows.  Light, then albedo, then depth, each once:

    l, phi   least squares of I on (n, 1) with rho = 1, n from the prepared depth
    rho      sum_p (rho S - I)^2 + lambda_rho sum_links w (rho_p - rho_q)^2,   S = l . n + phi
    z        sum_p (rho S(z) - I)^2 + lambda_z1 (dz)^2 + lambda_z2 (laplace dz)^2

by fixed point, |m| of the normals lagged.  dz = z - z0, the change of the prepared depth, is in
units of the pixel's footprint z / f on the surface, so that the weights have no unit; in log
depth p that makes it f (p - p0).  The published energy has laplace z; but the prepared depth is
smooth already, and to flatten its rims and noses costs more than any weight of it gains.

One photograph does not tell paint from relief: this is a baseline to compare with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.grid import differences, mean_gradient, neighbours
from rakelight.geometry.normals import gradient_directions, normals_from_gradient
from rakelight.methods.estimate import Estimate, brightest, require_options
from rakelight.model import Camera, Finding, Floats, Lights, Mask, Progress, ProgressCallback
from rakelight.prepare import Prepared
from rakelight.shading.piecewise import EdgeWeights, edge_weights, piecewise_smooth
from rakelight.solve import Solution, assemble, solve

# Neighbours whose intensity differs more than this are of different paint (Or-El et al. 2015).
TAU = 0.05
# Shading below this part of its mean says nothing about the albedo under it.
DIM = 0.05
# A step with lagged |m| can overshoot; then a part of it is taken.
SHARES = (1.0, 0.5, 0.25, 0.125)


@dataclass(frozen=True, slots=True)
class Options:
    """The five parameters of the paper, and when to stop.

    lambda_rho : smoothness of the albedo, relative to the squared shading.  Raised, patches of
        one paint become flat and all change inside them becomes relief; lowered, the albedo
        explains the photograph alone and the depth stays.
    sigma_c : intensity difference (linear light, 0..1) between neighbours of different paint.
        Raised, soft edges of paint are taken for relief; lowered, shading is taken for paint.
    sigma_d : depth difference in metres between neighbours of different paint.  Raised, paint
        is joined across steps; lowered, it may change wherever the surface is steep.
    lambda_z1 : trust in the prepared depth, per pixel footprint.  Raised, the depth stays;
        lowered, it follows the shading, errors of the light included.
    lambda_z2 : smoothness of the depth, of its change, per pixel footprint.  Raised, fine relief
        goes; lowered, paint and noise are carved into the surface.
    smooth : False leaves lambda_z2 out: the paper's "not smooth".
    max_iterations : rounds of the fixed point; more than it needs do no harm.
    tolerance : the rounds end when the energy falls by less than this part of it in one.
    """

    lambda_rho: float = 30.0
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
            sigma_c=(0 < self.sigma_c < np.inf, "above 0"),
            sigma_d=(0 < self.sigma_d < np.inf, "above 0, in metres"),
            lambda_z1=(0 < self.lambda_z1 < np.inf, "above 0"),
            lambda_z2=(0 <= self.lambda_z2 < np.inf, "at least 0"),
            max_iterations=(self.max_iterations >= 0, "at least 0"),
            tolerance=(self.tolerance < np.inf, "a number"),
        )


@dataclass(frozen=True)
class View:
    """The first photograph on the prepared window, (h, w) each.

    colour : (h, w, 3) linear light, 0 where not usable; intensity : mean of usable channels
    usable : (h, w, 3); seen : whether any channel is usable
    prior : prepared log depth
    """

    colour: Floats
    usable: Mask
    intensity: Floats
    seen: Mask
    prior: Floats
    mask: Mask
    camera: Camera

    @classmethod
    def of(cls, prepared: Prepared) -> View:
        """What the methods for one photograph see of `prepared`."""
        mask = prepared.mask
        values, good = prepared.pixels(0)
        colour, usable = np.zeros((*mask.shape, 3)), np.zeros((*mask.shape, 3), dtype=bool)
        colour[mask], usable[mask] = values * good, good
        count = usable.sum(axis=-1)
        intensity = colour.sum(axis=-1) / np.maximum(count, 1)
        prior = np.log(np.where(mask, prepared.depth_m, 1.0))
        return cls(colour, usable, intensity, count > 0, prior, mask, prepared.camera)

    def normals(self, log_depth: Floats) -> tuple[Floats, Floats]:
        """Normals (h, w, 3) and |m| (h, w)."""
        return normals_from_gradient(*mean_gradient(log_depth, self.mask), self.camera)

    def edges(self, sigma_c: float, sigma_d: float, tau: float) -> EdgeWeights:
        """How surely neighbours are of one paint."""
        color, depth_m = self.intensity[..., None], np.exp(self.prior)
        return edge_weights(color, depth_m, self.mask, sigma_c=sigma_c, sigma_d=sigma_d, tau=tau)


def fusion_like(prepared: Prepared, options: Options, progress: ProgressCallback) -> Estimate:
    """Refine the prepared depth by the shading of the first photograph."""
    view = View.of(prepared)
    edges = view.edges(options.sigma_c, options.sigma_d, TAU)
    light = harmonics(view)
    rho = albedo(view, shading(view, light), edges, options.lambda_rho)
    strength = options.lambda_z2 if options.smooth else 0.0
    depth = Depth(view, light, rho, view.intensity, options.lambda_z1, strength)
    fit = depth.fixed_point(options.max_iterations, options.tolerance, progress)
    return finished(prepared, view, light, edges, options.lambda_rho, fit)


def harmonics(view: View) -> Floats:
    """The light (l_x, l_y, l_z, phi): least squares of the intensity on (n, 1), of least norm."""
    normals, _ = view.normals(view.prior)
    basis = np.column_stack([normals[view.seen], np.ones(np.count_nonzero(view.seen))])
    right = basis.T @ view.intensity[view.seen]
    return np.asarray(np.linalg.lstsq(basis.T @ basis, right, rcond=1e-9)[0])


def shading(view: View, light: Floats, log_depth: Floats | None = None) -> Floats:
    """S = l . n + phi, (h, w), of a log depth, the prepared one unless given."""
    normals, _ = view.normals(view.prior if log_depth is None else log_depth)
    return np.asarray(normals @ light[:3] + light[3])


def albedo(
    view: View, shade: Floats, edges: EdgeWeights, strength: float, channel: int | None = None
) -> Floats:
    """The albedo (h, w) under a shading (h, w), of the intensity or of one channel."""
    image, seen = view.intensity, view.seen
    if channel is not None:
        image, seen = view.colour[..., channel], view.usable[..., channel]
    least = DIM * abs(float(shade[view.seen].mean())) if view.seen.any() else DIM
    shade = np.maximum(shade, least)
    return piecewise_smooth(
        image / shade, np.where(seen, shade**2, 0.0), edges, strength, view.mask
    )


@dataclass(frozen=True)
class Fit:
    """A log depth and the energy of every iterate."""

    log_depth: Floats
    energies: tuple[float, ...]
    converged: bool
    solve_s: float


@dataclass(frozen=True)
class Depth:
    """The depth's energy  sum (rho S - I)^2 + f^2 (lambda_z1 (dp)^2 + lambda_z2 (L dp)^2).

    dp = p - p0; L is the Laplacian; aim : (h, w) the intensity that rho S is to have
    """

    view: View
    light: Floats
    albedo: Floats
    aim: Floats
    lambda_z1: float
    lambda_z2: float

    def linear(self, length: Floats) -> tuple[Floats, Floats, Floats]:
        """a_u, a_v and c, (h, w) each, of the residual  a . grad p + c  with |m| = `length`."""
        scale = np.where(self.view.seen, self.albedo, 0.0)
        u, v = (d @ self.light[:3] for d in gradient_directions(self.view.camera))
        miss = scale * (self.light[3] - self.light[2] / length) - self.aim
        return scale * u / length, scale * v / length, np.where(self.view.seen, miss, 0.0)

    def step(self, log_depth: Floats) -> Solution:
        """The minimiser with |m| of `log_depth`: linear."""
        u, v, miss = self.linear(self.view.normals(log_depth)[1])
        squared = self.view.camera.fx * self.view.camera.fy
        system = assemble(
            self.view.mask,
            np.stack([u * u, u * v, v * v], axis=-1),
            -np.stack([u * miss, v * miss], axis=-1),
            np.full(u.shape, self.lambda_z1 * squared),
            self.view.prior,
            laplacian_weight=self.lambda_z2 * squared if self.lambda_z2 else None,
            laplacian_target=laplacian(self.view.prior, self.view.mask),
        )
        return solve(system, start=log_depth, tolerance=1e-4)

    def energy(self, log_depth: Floats) -> float:
        """The energy, photometry being the mean over the one-sided differences (see `solve`)."""
        view = self.view
        slopes = self.linear(view.normals(log_depth)[1])
        residual, bent = slopes[2], np.zeros(view.mask.shape)
        for axis, slope in ((1, slopes[0]), (0, slopes[1])):
            forward, backward = differences(log_depth, view.mask, axis)
            ahead, behind = neighbours(view.mask, axis)
            both = np.where(ahead & behind, forward - backward, 0.0)
            residual = residual + slope * (forward + backward) / np.maximum(1.0 * ahead + behind, 1)
            bent += (slope * both) ** 2 / 4
        moved = log_depth - view.prior
        curved = laplacian(moved, view.mask)
        fit = self.lambda_z1 * moved**2 + self.lambda_z2 * curved**2
        squared = view.camera.fx * view.camera.fy
        return float((residual**2 + bent + squared * fit)[view.mask].sum())

    def fixed_point(self, rounds: int, tolerance: float, progress: ProgressCallback) -> Fit:
        """From the prepared depth on, until no step lowers the energy by more than `tolerance`."""
        now: Floats = self.view.prior
        solve_s = 0.0
        energies, gain = [self.energy(now)], np.inf
        while len(energies) <= rounds and gain > tolerance * energies[-1]:
            progress(Progress("refine", len(energies), rounds, energies[-1]))
            solution = self.step(now)
            solve_s += solution.seconds
            for share in SHARES:
                tried: Floats = np.asarray(now + share * (solution.value - now))
                energy = self.energy(tried)
                if energy < energies[-1]:
                    break
            else:  # at rest, as far as lagging can tell
                tried, energy = now, energies[-1]
            gain = energies[-1] - energy
            now = tried
            energies.append(energy)
        return Fit(now, tuple(energies), gain <= tolerance * energies[-1], solve_s)


def laplacian(values: Floats, mask: Mask) -> Floats:
    """Sum of the second differences of `values` (h, w) along both axes, each where it exists."""
    total = np.zeros(mask.shape)
    for axis in (1, 0):
        forward, backward = differences(values, mask, axis)
        total += np.where(np.logical_and(*neighbours(mask, axis)), forward - backward, 0.0)
    return total


def finished(
    prepared: Prepared, view: View, light: Floats, edges: EdgeWeights, strength: float, fit: Fit
) -> Estimate:
    """The estimate: the albedo of each channel, shared out so that its 99th percentile is 1.

    Confidence is modest, for one photograph never settles a normal: 0 where the depth was left
    as it was, rising to one half where it moved by more than the pixel's footprint.
    """
    shade = shading(view, light, fit.log_depth)
    color = np.stack([albedo(view, shade, edges, strength, c) for c in range(3)], axis=-1)
    gain = brightest(color[view.mask])
    moved = view.camera.fx * np.abs(fit.log_depth - view.prior)
    count = len(prepared)
    return Estimate(
        log_depth=fit.log_depth,
        albedo=np.where(view.mask[..., None], color / gain, 0.0),
        confidence=np.where(view.mask & view.seen, (1 - np.exp(-moved)) / 2, 0.0),
        lights=Lights(gain * light[None, None, :3], gain * light[None, 3:]),
        energy=fit.energies,
        converged=fit.converged,
        findings=single_photograph(prepared.names, count),
        timings_s={"solve": fit.solve_s},
    )


def single_photograph(names: tuple[str, ...], count: int) -> tuple[Finding, ...]:
    """What to know about a result from one photograph; which one, where there are several."""
    warning = Finding(
        "warning",
        "single-photograph",
        "one photograph does not tell paint from relief: fine detail may be painted, not real",
        "take at least 4 photographs under a moving lamp and use the method multi-light",
    )
    if count == 1:
        return (warning,)
    first = names[0] if names else "photograph 0"
    message = f"only the first of {count} photographs is used: {first}"
    return warning, Finding("note", "one-photograph", message, "use the method multi-light for all")
