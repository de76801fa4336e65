"""The depth whose shading explains one photograph, the length of the normals lagged.

    minimise  sum c (rho S - I)^2 + f^2 (lambda_z1 (K dp)^2 + lambda_z2 (L (dp - q))^2)

over log depth p, with S = l . n + phi and a weight c of the photograph's shading, 0..1; dp = p - p0
is the change of the prepared depth, L the Laplacian and K the mean over a sensor's pixel, where
that is larger; q is the relief of the ambient-occlusion cue (`occlusion_height`).  f dp is the
change in units of the pixel's footprint z / f on the surface, so that the weights have no unit.
With |m| fixed, S is linear in the gradient of p, and a step is one linear solve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.geometry.averaging import data_sum_of_squares, data_terms
from rakelight.geometry.grid import (
    differences,
    neighbours,
)
from rakelight.geometry.normals import gradient_directions
from rakelight.methods.levels import Level, first_photograph
from rakelight.methods.single_image.reflectance_regions import brightness, reflectance_regions
from rakelight.methods.single_image.texture import (
    DARKEST,
    from_afar,
    shading_weight,
    texture_likelihood,
    without_texture,
)
from rakelight.model import MAD_TO_SIGMA, Floats, Mask, Progress, ProgressCallback
from rakelight.photometry.piecewise_albedo import EdgeWeights, edge_weights
from rakelight.prepare import Prepared
from rakelight.solve import Solution, assemble, solve

# Fractions of a step that are tried in turn: with lagged |m| the whole may overshoot.
SHARES = (1.0, 0.5, 0.25, 0.125)
# Largest contrast of a ridge, in standard deviations of the contrast of texture.
BRIGHTEST = 1.5


@dataclass(frozen=True)
class View:
    """How the first photograph looks: colour, brightness, regions of one albedo, texture.

    level : the photograph and the prepared depth
    exposure : linear light of the object's median pixel, the unit of colour and intensity
    colour : (h, w, 3), clipped values as they are; intensity : its `brightness`
    regions : (h, w) each, the `reflectance_regions`
    seen : whether any channel is usable and all neighbours are on the surface
    texture : likelihood that changes are shading of fine relief, not of the albedo, 0..1
    """

    level: Level
    exposure: float
    colour: Floats
    intensity: Floats
    regions: tuple[Mask, ...]
    seen: Mask
    texture: Floats

    @property
    def mask(self) -> Mask:
        """(h, w) the object."""
        return self.level.mask

    @classmethod
    def of(cls, prepared: Prepared) -> View:
        """The view of the first photograph of `prepared`."""
        level = first_photograph(prepared)
        mask, links, usable = level.mask, level.links, level.usable
        seen = usable.any(axis=-1) & level.links.inner  # those at a border mix with the background
        observed = level.image.mean(axis=-1)[seen]
        exposure = max(float(np.median(observed)), np.finfo(float).tiny) if observed.size else 1.0
        colour = level.image / exposure
        regions = tuple(reflectance_regions(colour, mask))
        return cls(
            level,
            exposure,
            colour,
            brightness(colour, usable, mask),
            regions,
            seen,
            texture_likelihood(colour, links, regions),
        )

    def edges(self, sigma_c: float, sigma_d: float, tau: float) -> EdgeWeights:
        """Weights of the links between neighbours: small where the albedo may change."""
        color = without_texture(self.intensity, self.texture, self.regions)[..., None]
        depth_m = np.exp(self.level.prior)
        return edge_weights(color, depth_m, self.mask, sigma_c=sigma_c, sigma_d=sigma_d, tau=tau)

    def contrast(self) -> Floats:
        """(h, w) of texture with its surroundings, relative; 0 where there is no information.

        Valleys may be black, but no ridge is brighter than the ambient light makes it: what is much
        brighter than usual is a highlight or another albedo.
        """
        plain = np.maximum(from_afar(self.intensity, self.regions), DARKEST)
        found = np.where(self.seen, self.intensity / plain - 1, 0.0)
        sure = self.seen & (self.texture > 0.5)
        if not sure.any():
            return np.zeros(self.mask.shape)
        usual = MAD_TO_SIGMA * float(np.median(np.abs(found[sure])))
        return np.asarray(self.texture * np.minimum(found, BRIGHTEST * usual))

    def shading_weight(self, colour_weight: float) -> Floats:
        """(h, w) 0..1, the weight c of the shading: see `texture.shading_weight`."""
        return shading_weight(self.colour, self.texture, self.level.links, colour_weight)


@dataclass(frozen=True)
class Fit:
    """A log depth and the energy of every iterate."""

    log_depth: Floats
    energies: tuple[float, ...]
    converged: bool
    solve_s: float


@dataclass(frozen=True)
class Depth:
    """The energy  sum c (rho S - I)^2 + f^2 (lambda_z1 (K dp)^2 + lambda_z2 (L (dp - q))^2).

    dp = p - p0; L is the Laplacian; target : (h, w) the intensity that rho S is to have
    shading_weight : (h, w) c, 0..1; expected : (h, w) q, log metres
    accuracy : to which a step is solved, relative to the residual of the prepared depth
    """

    view: View
    light: Floats
    albedo: Floats
    target: Floats
    lambda_z1: float
    lambda_z2: float
    shading_weight: Floats
    accuracy: float
    expected: Floats

    @property
    def prior_weight(self) -> Floats:
        """(h, w) the weight of the prepared depth, lambda_z1 f^2."""
        weight = self.lambda_z1 * self.view.level.camera.fx * self.view.level.camera.fy
        return np.full(self.view.mask.shape, weight)

    def linear(self, length: Floats) -> tuple[Floats, Floats, Floats]:
        """a_u, a_v and c, (h, w) each, of the residual  a . grad p + c  with |m| = `length`."""
        weight = np.where(self.view.seen, np.sqrt(self.shading_weight), 0.0)
        scale = weight * self.albedo
        u, v = (d @ self.light[:3] for d in gradient_directions(self.view.level.camera))
        constant = scale * (self.light[3] - self.light[2] / length) - weight * self.target
        return scale * u / length, scale * v / length, constant

    def step(self, log_depth: Floats) -> Solution:
        """The minimiser with |m| of `log_depth`: linear."""
        u, v, constant = self.linear(self.view.level.normals(log_depth)[1])
        squared = self.view.level.camera.fx * self.view.level.camera.fy
        links, prior = self.view.level.links, self.view.level.prior
        system = assemble(
            links.mask,
            np.stack([u * u, u * v, v * v], axis=-1),
            -np.stack([u * constant, v * constant], axis=-1),
            pair_weights=links.pairs,
            **data_terms(self.view.level.averaging, self.prior_weight, prior),
            laplacian_weight=self.lambda_z2 * squared if self.lambda_z2 else None,
            laplacian_target=laplacian(prior + self.expected, links.mask),
        )
        # In terms of the change, which is small, a rough accuracy will do.
        return solve(system, start=log_depth, origin=prior, tolerance=self.accuracy)

    def energy(self, log_depth: Floats) -> float:
        """The energy, photometry being the mean over the one-sided differences (see `solve`)."""
        view = self.view
        slopes = self.linear(view.level.normals(log_depth)[1])
        residual, second_order = slopes[2], np.zeros(view.mask.shape)
        for axis, slope in ((1, slopes[0]), (0, slopes[1])):
            forward, backward = differences(log_depth, view.level.links, axis)
            ahead, behind = neighbours(view.level.links, axis)
            both = np.where(ahead & behind, forward - backward, 0.0)
            residual = residual + slope * (forward + backward) / np.maximum(1.0 * ahead + behind, 1)
            second_order += (slope * both) ** 2 / 4
        moved = log_depth - view.level.prior
        curved = laplacian(moved - self.expected, view.mask)
        prior_term = data_sum_of_squares(view.level.averaging, self.prior_weight, moved, view.mask)
        smooth = self.lambda_z2 * view.level.camera.fx * view.level.camera.fy * curved**2
        return prior_term + float((residual**2 + second_order + smooth)[view.mask].sum())

    def fixed_point(self, rounds: int, tolerance: float, progress: ProgressCallback) -> Fit:
        """From the prepared depth on, until no step lowers the energy by more than `tolerance`.

        A step that the solver does not find is refused, and the fit has not converged.
        """
        now: Floats = self.view.level.prior
        solve_s = 0.0
        energies, gain = [self.energy(now)], np.inf
        while len(energies) <= rounds and gain > tolerance * energies[-1]:
            progress(Progress("refine", len(energies), rounds, energies[-1]))
            solution = self.step(now)
            solve_s += solution.seconds
            if not solution.converged:
                break  # refused: the depth stays, and has not come to rest
            for share in SHARES:
                tried: Floats = np.asarray(now + share * (solution.value - now))
                energy = self.energy(tried)
                if energy < energies[-1]:
                    break
            else:  # no fraction of the lagged step lowers the energy
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
