"""What a multi-light method works on: photographs and prepared depth, at one resolution or more."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from rakelight.geometry.averaging import Averaging, data_misfit, data_terms
from rakelight.geometry.blur import blurred
from rakelight.geometry.camera import back_project
from rakelight.geometry.cells import cell_sums, spread
from rakelight.geometry.derivatives import gradient_image
from rakelight.geometry.grid import (
    Grid,
    Links,
    connected,
    has_gradient,
    pair_slices,
    surface_links,
)
from rakelight.model import BLACK, SATURATED, Array, Floats, Mask
from rakelight.photometry.images import Photographs, Surface
from rakelight.prepare import Prepared
from rakelight.prepare.inpaint import nearest_fill
from rakelight.prepare.linear import linear_table
from rakelight.solve.direct import factorised

# Depth that was filled in is worth this fraction of what the sensor measured.
FILLED = 0.01
# With fewer of its pixels along a sensor pixel's side a level is the sensor's own resolution.
NEARLY_ONE = 1.3
# A part of the surface of fewer sensor pixels is an island.
ISLAND = 4
# Over so many pixels the bias of smoothing is told from noise: over fewer, the noise is back.
BIAS_PX = 5.0


@dataclass(frozen=True, eq=False)
class Level:
    """Photographs and prepared depth at one resolution.

    prior : (h, w) log of the prepared depth, where refining begins
    aim : (h, w) log depth that the surface is held to: the prior without its smoothing's bias
    prior_weight : (h, w) the precision of both, 1 / variance; halving adds up four pixels'
    averaging : of the sensor's pixels, where those are wider than this level's; None elsewhere
    islands : (h, w) parts of the surface too small for a sensor pixel of their own: each of their
        pixels is held to the prior, or they would take up what the mean over one is off
    middle_m : (3,) the object's middle, metres
    points : (h, w, 3) of the prepared depth, metres from the middle, for lamps near the object:
        what refining moves them by is nothing beside the lamps' distance
    """

    photographs: Photographs
    prior: Floats
    aim: Floats
    prior_weight: Floats
    middle_m: Floats
    points: Floats
    averaging: Averaging | None
    islands: Mask

    @property
    def mask(self) -> Mask:
        """(h, w) the object."""
        return self.photographs.mask

    @property
    def grid(self) -> Grid:
        """The object's pixels and which of them are linked."""
        return self.photographs.grid

    @property
    def pairs(self) -> Floats | None:
        """Weights of the difference pairs, as `solve.assemble` takes them; None without a cut."""
        return Links.of(self.grid).pairs

    def surface(self, log_depth: Floats) -> Surface:
        """What the photographs see of `log_depth` (h, w)."""
        return Surface(gradient_image(log_depth, self.grid), self.points)

    def sensor_terms(self, log_depth: Floats, scale: float = 1.0) -> dict[str, Any]:
        """What the sensor says of a correction of `log_depth` (h, w), as `solve.assemble` takes it.

        The energy  scale sum w (K (p - aim))^2:  the aim's detail within a sensor pixel is
        interpolation, and nothing holds the surface to that.
        """
        terms = data_terms(self.averaging, scale * self.prior_weight, self.aim - log_depth)
        if self.averaging is not None:
            terms["data_weight"] = scale * self.prior_weight * self.islands
            terms["data_target"] = self.prior - log_depth
        return terms

    def sensor_misfit(self, log_depth: Floats) -> float:
        """sum w (K (p - aim))^2 of a log depth (h, w), and of islands that to the prior."""
        miss, weight = log_depth - self.aim, self.prior_weight
        held = (weight * (log_depth - self.prior) ** 2)[self.islands].sum()
        return data_misfit(self.averaging, weight, miss, self.mask) + float(held)

    def placed(self, log_depth: Floats) -> Floats:
        """A log depth (h, w) with each connected part moved as a whole to where the sensor has it.

        Each part moves by the constant in log depth that makes `sensor_misfit` least.  Photographs
        see slopes alone and leave it open.  A depth step does not settle it: the step's equations
        are solved to 2 % of a right side that is nearly all the photographs', and the sensor's
        share is smaller than that.
        """
        number, belongs, seen, factor = self._parts
        miss = self.sensor_weight * (self.sensed(self.aim) - self.sensed(log_depth))
        held = self.prior_weight * self.islands * (self.prior - log_depth)
        right = seen.T @ miss + belongs.T @ held[self.mask]
        moved = log_depth.copy()
        moved[self.mask] += factor.solve(right)[number]
        return moved

    @cached_property
    def _parts(self) -> tuple[Array, Any, Any, Any]:
        """What `placed` needs of the C connected parts of the P pixels.

        (P,) the number of each pixel's part; sparse (P, C), 1 where a pixel belongs to a part;
        sparse (M, C), the share of each part in a sensor pixel; and the factors of the (C, C)
        normal equations of the parts' constants.
        """
        from scipy.sparse import csr_array, diags_array

        parts, count = connected(self.grid)
        number = parts[self.mask]
        belongs = csr_array(
            (np.ones(number.size), (np.arange(number.size), number)), shape=(number.size, count)
        )
        seen = belongs
        if self.averaging is not None:
            seen = self.averaging.matrix(self.mask) @ belongs
        held = diags_array((self.prior_weight * self.islands)[self.mask])
        weights = seen.T @ diags_array(self.sensor_weight) @ seen + belongs.T @ held @ belongs
        # keeps the matrix regular: a part that no sensor pixel sees stays where it is
        weights = weights + diags_array(1e-9 * (weights.diagonal() + weights.diagonal().max()))
        return number, belongs, seen, factorised(weights.tocsc())

    def sensed(self, image: Floats) -> Floats:
        """(M,) K image, of an image (h, w): its means over the sensor's pixels."""
        if self.averaging is None:
            return image[self.mask]
        return self.averaging.down(image)[self.averaging.covered]

    @property
    def sensor_weight(self) -> Floats:
        """(M,) precision of each of the sensor's pixels, in the order of `sensed`."""
        if self.averaging is None:
            return self.prior_weight[self.mask]
        return self.averaging.total(self.prior_weight)[self.averaging.covered]

    def weighted(self, factor: float) -> Level:
        """This level with the prior's weight multiplied by `factor`."""
        return replace(self, prior_weight=factor * self.prior_weight)

    def cut(self, log_depth: Floats) -> Level:
        """This level with its links cut at the jumps of `log_depth` (h, w) as well."""
        here = Links.of(self.grid)
        steep = surface_links(np.exp(log_depth), here.mask, self.photographs.camera)
        both = Links(here.mask, here.right & steep.right, here.down & steep.down)
        islands = small_parts(both, self.averaging)
        return replace(self, photographs=replace(self.photographs, grid=both), islands=islands)

    def halved(self) -> Level:
        """This level at half the resolution."""
        photographs, averaging = self.photographs.halved(), None
        if self.averaging is not None and self.averaging.factor > 2 * NEARLY_ONE:
            averaging = self.averaging.halved(photographs.mask)
        weight = cell_sums(np.where(self.mask, 1.0, 0.0), 2)
        prior, aim = (
            cell_sums(np.where(self.mask, image, 0.0), 2) / np.maximum(weight, 1)
            for image in (self.prior, self.aim)
        )
        return Level(
            photographs,
            nearest_fill(prior, photographs.mask),
            nearest_fill(aim, photographs.mask),
            cell_sums(np.where(self.mask, self.prior_weight, 0.0), 2),
            self.middle_m,
            cell_sums(np.where(self.mask[..., None], self.points, 0.0), 2)
            / np.maximum(weight, 1)[..., None],
            averaging,
            small_parts(photographs.grid, averaging),
        )

    def carried(self, coarse: Level, log_depth: Floats) -> Floats:
        """The coarse level's log depth on this level's grid, without the prior's fine noise."""
        # Beyond the coarse mask it goes on flat, as the coarse prior does.
        return spread(nearest_fill(log_depth, coarse.mask), 2, self.mask.shape)


def finest_level(prepared: Prepared, *, cut: bool = False, unbiased: bool = False) -> Level:
    """The level of the prepared window itself.

    cut : whether links end at the jumps of the prepared depth
    unbiased : whether the surface is held to the prepared depth without its smoothing's bias
    """
    read = prepared.photographs.dtype
    white, grid = np.iinfo(read).max, Links.of(prepared.mask)
    if cut:
        grid = surface_links(prepared.depth_m, prepared.mask, prepared.camera)
    photographs = Photographs(
        # One type for all levels, or kernels would be compiled for another.
        np.ascontiguousarray(prepared.photographs, dtype=np.uint16),
        linear_table(read, prepared.encoding),
        low=int(BLACK * white) + 1,
        high=int(np.ceil(SATURATED * white)) - 1,
        grid=grid,
        camera=prepared.camera,
    )
    averaging = None
    if prepared.factor > NEARLY_ONE:
        averaging = prepared.sensor.averaging(prepared.mask)
    points = back_project(prepared.depth_m, prepared.camera)
    middle = points[prepared.mask].mean(axis=0)
    prior = np.log(prepared.depth_m)
    return Level(
        photographs,
        prior,
        np.where(photographs.active, unbiased_depth(prepared), prior) if unbiased else prior,
        depth_precision(prepared),
        middle,
        points - middle,
        averaging,
        small_parts(grid, averaging),
    )


def small_parts(grid: Grid, averaging: Averaging | None) -> Mask:
    """(h, w) the parts of the grid that normals hold together, below `ISLAND` sensor pixels.

    None where the sensor's pixels are no wider than the grid's.
    """
    links = Links.of(grid)
    if averaging is None:
        return np.zeros_like(links.mask)
    active = has_gradient(grid)
    sides = []
    for axis, side in ((1, links.right), (0, links.down)):
        here, there = pair_slices(axis)
        linked = side & active
        linked[here] |= side[here] & active[there]
        sides.append(linked)
    parts, count = connected(Links(links.mask, *sides))
    size = np.bincount(parts[links.mask], minlength=count)
    return links.mask & (size < ISLAND * averaging.factor**2)[parts]


def unbiased_depth(prepared: Prepared) -> Floats:
    """(h, w) the prepared log depth without the bias of its smoothing, which flattens slopes.

    What it is off the measurements, averaged over `BIAS_PX`, is added.
    """
    prior = np.log(prepared.depth_m)
    miss, seen = sensor_error(prepared, prior)
    miss = blurred(miss, BIAS_PX / prepared.factor, seen)
    return np.asarray(prior + prepared.sensor.spread(miss, prior.shape))


def sensor_error(prepared: Prepared, log_depth: Floats) -> tuple[Floats, Mask]:
    """(hs, ws) what the measurements are off the means of a log depth (h, w), and where there are.

    0 where there is no measurement of the object.
    """
    averaging = prepared.sensor.averaging(prepared.mask)
    seen = prepared.sensor.measured & averaging.covered
    measured = np.log(np.where(seen, prepared.sensor.depth_m, 1.0))
    return np.where(seen, measured - averaging.down(log_depth), 0.0), seen


def depth_precision(prepared: Prepared) -> Floats:
    """(h, w) 1 / variance of the prepared log depth.

    A depth pixel covers factor^2 of its pixels, which share that measurement's precision; depth
    that was filled in is worth a hundredth.
    """
    precision = (prepared.depth_m / prepared.sigma_m / prepared.factor) ** 2
    return np.where(prepared.measured, precision, FILLED * precision)


def pyramid(finest: Level, most_pixels: int) -> list[Level]:
    """Levels from the finest to one with at most `most_pixels` pixels, halved each time."""
    levels = [finest]
    while np.count_nonzero(levels[-1].mask) > most_pixels:
        coarser = levels[-1].halved()
        if np.count_nonzero(coarser.photographs.active) < most_pixels / 16:
            break  # a thin object would be lost
        levels.append(coarser)
    return levels
