"""The depth whose shading explains one photograph, the length of the normals lagged.

    minimise  sum c (rho S - I)^2 + f^2 (lambda_z1 (dp)^2 + lambda_z2 (L dp)^2),   S = l . n + phi

over log depth p, the photograph being believed by c, 0..1; dp = p - p0 is the change of the
prepared one and L the Laplacian.  f dp is the change in units of the pixel's footprint z / f on
the surface, so that the weights have no unit.  With |m| fixed, S is linear in the gradient of p,
and a step is one linear solve.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.geometry.grid import (
    Links,
    differences,
    has_gradient,
    mean_gradient,
    neighbours,
    surface_links,
)
from rakelight.geometry.normals import gradient_directions, normals_from_gradient
from rakelight.methods.estimate import scatter
from rakelight.model import Camera, Floats, Mask, Progress, ProgressCallback
from rakelight.prepare import Prepared
from rakelight.shading.piecewise import EdgeWeights, edge_weights
from rakelight.solve import Solution, assemble, solve

# A step with lagged |m| can overshoot; then a part of it is taken.
SHARES = (1.0, 0.5, 0.25, 0.125)
# The photograph's noise is averaged over the first, the paint's colour is alike within the second;
# darker colours, relative to the object's mean, are noise.
NOISE_PX, ALIKE_PX, DARKEST = 1.0, 3.0, 1e-3


@dataclass(frozen=True)
class View:
    """The first photograph on the prepared window, (h, w) each.

    exposure : (3,) the linear light that the rest is in units of: the object's mean
    colour : (h, w, 3), 0 where not usable; intensity : mean of usable channels
    usable : (h, w, 3); seen : whether any channel is usable and there is a normal
    prior : prepared log depth; links : which neighbours are on one surface
    """

    exposure: Floats

    colour: Floats
    usable: Mask
    intensity: Floats
    seen: Mask
    prior: Floats
    links: Links
    camera: Camera

    @property
    def mask(self) -> Mask:
        """(h, w) the object."""
        return self.links.mask

    @classmethod
    def of(cls, prepared: Prepared) -> View:
        """What the methods for one photograph see of `prepared`."""
        mask = prepared.mask
        values, good = prepared.pixels(0)
        colour, usable = scatter(values * good, mask), scatter(1.0 * good, mask) > 0
        # Whatever a lamp's colour, a channel that is not usable then leaves no edge.
        exposure = colour.sum(axis=(0, 1)) / np.maximum(usable.sum(axis=(0, 1)), 1)
        exposure = np.where(exposure > 0, exposure, 1.0)
        colour, count = colour / exposure, usable.sum(axis=-1)
        links = surface_links(prepared.depth_m, mask, prepared.camera)
        return cls(
            exposure,
            colour,
            usable,
            colour.sum(axis=-1) / np.maximum(count, 1),
            (count > 0) & has_gradient(links),
            np.log(np.where(mask, prepared.depth_m, 1.0)),
            links,
            prepared.camera,
        )

    def normals(self, log_depth: Floats) -> tuple[Floats, Floats]:
        """Normals (h, w, 3) and |m| (h, w)."""
        return normals_from_gradient(*mean_gradient(log_depth, self.links), self.camera)

    def edges(self, sigma_c: float, sigma_d: float, tau: float) -> EdgeWeights:
        """How surely neighbours are of one paint."""
        color, depth_m = self.intensity[..., None], np.exp(self.prior)
        return edge_weights(color, depth_m, self.mask, sigma_c=sigma_c, sigma_d=sigma_d, tau=tau)

    def believed(self, doubt: float) -> Floats:
        """How far shading is believed, (h, w) 0..1: less where the colour changes, as paint does.

        doubt : the inverse of the change per pixel, relative, that halves it
        """
        from scipy.ndimage import gaussian_filter

        def blurred(image: Floats, sigma: float) -> Floats:
            return np.asarray(gaussian_filter(image, sigma, axes=(0, 1)))

        colour = blurred(self.colour, NOISE_PX)
        colour /= np.maximum(blurred(self.usable.astype(float), NOISE_PX), 1e-6)
        colour = np.log(np.maximum(colour, DARKEST))
        colour -= np.log(np.maximum(np.exp(colour).mean(axis=-1, keepdims=True), DARKEST))
        squares, count = np.zeros(self.mask.shape), np.zeros(self.mask.shape)
        for axis in (0, 1):
            for channel in range(3):
                for step in differences(colour[..., channel], self.links, axis):
                    squares += step**2
            for side in neighbours(self.links, axis):
                count += side
        change = blurred(squares, ALIKE_PX) / np.maximum(blurred(count, ALIKE_PX), 1e-6)
        return 1 / (1 + doubt**2 * change)


@dataclass(frozen=True)
class Fit:
    """A log depth and the energy of every iterate."""

    log_depth: Floats
    energies: tuple[float, ...]
    converged: bool
    solve_s: float


@dataclass(frozen=True)
class Depth:
    """The depth's energy  sum c (rho S - I)^2 + f^2 (lambda_z1 (dp)^2 + lambda_z2 (L dp)^2).

    dp = p - p0; L is the Laplacian; aim : (h, w) the intensity that rho S is to have
    believed : (h, w) c, how far it is believed, 0..1
    accuracy : to which a step is solved, relative to what the prepared depth leaves unexplained
    """

    view: View
    light: Floats
    albedo: Floats
    aim: Floats
    lambda_z1: float
    lambda_z2: float
    believed: Floats
    accuracy: float

    def linear(self, length: Floats) -> tuple[Floats, Floats, Floats]:
        """a_u, a_v and c, (h, w) each, of the residual  a . grad p + c  with |m| = `length`."""
        weight = np.where(self.view.seen, np.sqrt(self.believed), 0.0)
        scale = weight * self.albedo
        u, v = (d @ self.light[:3] for d in gradient_directions(self.view.camera))
        miss = scale * (self.light[3] - self.light[2] / length) - weight * self.aim
        return scale * u / length, scale * v / length, miss

    def step(self, log_depth: Floats) -> Solution:
        """The minimiser with |m| of `log_depth`: linear."""
        u, v, miss = self.linear(self.view.normals(log_depth)[1])
        squared = self.view.camera.fx * self.view.camera.fy
        links, prior = self.view.links, self.view.prior
        system = assemble(
            links.mask,
            np.stack([u * u, u * v, v * v], axis=-1),
            -np.stack([u * miss, v * miss], axis=-1),
            np.full(u.shape, self.lambda_z1 * squared),
            prior,
            links.pair_weights() if links.cut else None,
            laplacian_weight=self.lambda_z2 * squared if self.lambda_z2 else None,
            laplacian_target=laplacian(prior, links.mask),
        )
        # In terms of the change, which is small, a rough accuracy will do.
        change = replace(system, rhs=system.rhs - system.apply(prior), target=np.zeros(prior.shape))
        solution = solve(change, start=log_depth - prior, tolerance=self.accuracy)
        return replace(solution, value=prior + solution.value)

    def energy(self, log_depth: Floats) -> float:
        """The energy, photometry being the mean over the one-sided differences (see `solve`)."""
        view = self.view
        slopes = self.linear(view.normals(log_depth)[1])
        residual, bent = slopes[2], np.zeros(view.mask.shape)
        for axis, slope in ((1, slopes[0]), (0, slopes[1])):
            forward, backward = differences(log_depth, view.links, axis)
            ahead, behind = neighbours(view.links, axis)
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
