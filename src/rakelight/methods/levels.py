"""What a multi-light method works on: photographs and prepared depth, at one resolution or more."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rakelight.geometry.averaging import AveragedData, Averaging
from rakelight.geometry.camera import back_project
from rakelight.geometry.cells import cell_sums, spread
from rakelight.geometry.grid import Grid, Links, mean_gradient, surface_links
from rakelight.model import Floats, Mask
from rakelight.prepare import Prepared
from rakelight.prepare.inpaint import nearest_fill
from rakelight.prepare.linear import BLACK, SATURATED, linear_table
from rakelight.shading.photographs import Photographs, Surface

# Depth that was filled in is worth this fraction of what the sensor measured.
FILLED = 0.01
# With fewer of its pixels along a sensor pixel's side a level is the sensor's own resolution.
NEARLY_ONE = 1.3


@dataclass(frozen=True, slots=True)
class Level:
    """Photographs and prepared depth at one resolution.

    prior : (h, w) log of the prepared depth
    prior_weight : (h, w) its precision, 1 / variance of log depth; halving adds up four pixels'
    averaging : of the sensor's pixels, where those are wider than this level's; None elsewhere
    middle_m : (3,) the object's middle, metres
    points : (h, w, 3) of the prepared depth, metres from the middle, for lamps near the object:
        what refining moves them by is nothing beside the lamps' distance
    """

    photographs: Photographs
    prior: Floats
    prior_weight: Floats
    middle_m: Floats
    points: Floats
    averaging: Averaging | None = None

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
        return self.grid.pair_weights() if isinstance(self.grid, Links) and self.grid.cut else None

    def surface(self, log_depth: Floats) -> Surface:
        """What the photographs see of `log_depth` (h, w)."""
        return Surface(np.stack(mean_gradient(log_depth, self.grid), axis=-1), self.points)

    def sensor_terms(self, log_depth: Floats, scale: float = 1.0) -> dict[str, Any]:
        """What the sensor says of a correction of `log_depth` (h, w), as `solve.assemble` takes it.

        The energy  scale sum w (K (p - prior))^2:  the prior's detail within a sensor pixel is
        interpolation, and nothing holds the surface to that.
        """
        aim = self.prior - log_depth
        if self.averaging is None:
            return {"data_weight": scale * self.prior_weight, "data_target": aim}
        weight = scale * self.averaging.total(self.prior_weight)
        data = AveragedData(self.averaging, weight)
        nothing = np.zeros(self.mask.shape)
        return {
            "data_weight": nothing, "data_target": nothing, "extra": data,
            "extra_rhs": data.apply(aim),
        }  # fmt: skip

    def sensor_misfit(self, log_depth: Floats) -> float:
        """sum w (K (p - prior))^2 of a log depth (h, w)."""
        miss = log_depth - self.prior
        if self.averaging is None:
            return float((self.prior_weight * miss**2)[self.mask].sum())
        weight = self.averaging.total(self.prior_weight)
        return float((weight * self.averaging.down(miss) ** 2).sum())

    def trusting(self, trust: float) -> Level:
        """This level with the prior's weight multiplied by `trust`."""
        return replace(self, prior_weight=trust * self.prior_weight)

    def cut(self, log_depth: Floats) -> Level:
        """This level with its links cut at the jumps of `log_depth` (h, w) as well."""
        here = Links.of(self.grid)
        steep = surface_links(np.exp(log_depth), here.mask, self.photographs.camera)
        both = Links(here.mask, here.right & steep.right, here.down & steep.down)
        return replace(self, photographs=replace(self.photographs, grid=both))

    def halved(self) -> Level:
        """This level at half the resolution."""
        photographs = self.photographs.halved()
        weight = cell_sums(np.where(self.mask, 1.0, 0.0), 2)
        prior = cell_sums(np.where(self.mask, self.prior, 0.0), 2) / np.maximum(weight, 1)
        return Level(
            photographs,
            nearest_fill(prior, photographs.mask),
            cell_sums(np.where(self.mask, self.prior_weight, 0.0), 2),
            self.middle_m,
            cell_sums(np.where(self.mask[..., None], self.points, 0.0), 2)
            / np.maximum(weight, 1)[..., None],
            self._halved_averaging(photographs.mask),
        )

    def _halved_averaging(self, mask: Mask) -> Averaging | None:
        if self.averaging is None or self.averaging.factor <= 2 * NEARLY_ONE:
            return None
        return self.averaging.halved(mask)

    def carried(self, coarse: Level, log_depth: Floats) -> Floats:
        """The coarse level's log depth on this level's grid, without the prior's fine noise."""
        # Continued beyond the coarse mask as the prior goes on.
        correction = nearest_fill(log_depth - coarse.prior, coarse.mask)
        continued = np.where(coarse.mask, log_depth, coarse.prior + correction)
        return spread(continued, 2, self.mask.shape)


def finest_level(prepared: Prepared, *, cut: bool = False) -> Level:
    """The level of the prepared window itself; `cut` at the jumps of the prepared depth or not."""
    values = np.ascontiguousarray(prepared.photographs)
    white, grid = np.iinfo(values.dtype).max, Links.of(prepared.mask)
    if cut:
        grid = surface_links(prepared.depth_m, prepared.mask, prepared.camera)
    photographs = Photographs(
        values,
        linear_table(values.dtype, prepared.encoding),
        low=int(BLACK * white) + 1,
        high=int(np.ceil(SATURATED * white)) - 1,
        grid=grid,
        camera=prepared.camera,
    )
    points = back_project(prepared.depth_m, prepared.camera)
    middle = points[prepared.mask].mean(axis=0)
    return Level(
        photographs,
        np.log(prepared.depth_m),
        depth_precision(prepared),
        middle,
        points - middle,
        prepared.sensor.averaging(prepared.mask) if prepared.factor > NEARLY_ONE else None,
    )


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
