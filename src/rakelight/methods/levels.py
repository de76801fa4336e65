"""What a multi-light method works on: photographs and prepared depth, at one resolution or more."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import mean_gradient
from rakelight.model import Floats, Mask
from rakelight.prepare import Prepared
from rakelight.prepare.inpaint import nearest_fill
from rakelight.prepare.linear import BLACK, SATURATED, linear_table
from rakelight.shading.photographs import Photographs, Surface

# Depth that was filled in is worth this fraction of what the sensor measured.
FILLED = 0.01


@dataclass(frozen=True, slots=True)
class Level:
    """Photographs and prepared depth at one resolution.

    prior : (h, w) log of the prepared depth
    prior_weight : (h, w) its precision, 1 / variance of log depth; halving adds up four pixels'
    middle_m : (3,) the object's middle, metres
    """

    photographs: Photographs
    prior: Floats
    prior_weight: Floats
    middle_m: Floats

    @property
    def mask(self) -> Mask:
        """(h, w) the object."""
        return self.photographs.mask

    def surface(self, log_depth: Floats) -> Surface:
        """What the photographs see of `log_depth` (h, w)."""
        depth = np.exp(np.where(self.mask, log_depth, 0.0))
        return Surface(
            gradient=np.stack(mean_gradient(log_depth, self.mask), axis=-1),
            points=back_project(depth, self.photographs.camera) - self.middle_m,
        )

    def trusting(self, trust: float) -> Level:
        """This level with the prior's weight multiplied by `trust`."""
        return replace(self, prior_weight=trust * self.prior_weight)

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
        )

    def carried(self, coarse: Level, log_depth: Floats) -> Floats:
        """The coarse level's log depth on this level's grid, without the prior's fine noise."""
        # Continued beyond the coarse mask as the prior goes on.
        correction = nearest_fill(log_depth - coarse.prior, coarse.mask)
        continued = np.where(coarse.mask, log_depth, coarse.prior + correction)
        return spread(continued, 2, self.mask.shape)


def finest_level(prepared: Prepared) -> Level:
    """The level of the prepared window itself.

    A depth pixel covers factor^2 of its pixels, which share that measurement's precision; depth
    that was filled in is worth a hundredth.
    """
    values = np.ascontiguousarray(prepared.photographs)
    white = np.iinfo(values.dtype).max
    photographs = Photographs(
        values,
        linear_table(values.dtype, prepared.encoding),
        low=int(BLACK * white) + 1,
        high=int(np.ceil(SATURATED * white)) - 1,
        mask=prepared.mask,
        camera=prepared.camera,
    )
    precision = (prepared.depth_m / prepared.sigma_m / prepared.factor) ** 2
    points = back_project(prepared.depth_m, prepared.camera)[prepared.mask]
    return Level(
        photographs,
        np.log(prepared.depth_m),
        np.where(prepared.measured, precision, FILLED * precision),
        points.mean(axis=0),
    )


def pyramid(finest: Level, most_pixels: int) -> list[Level]:
    """Levels from the finest to one with at most `most_pixels` pixels, halved each time."""
    levels = [finest]
    while np.count_nonzero(levels[-1].mask) > most_pixels:
        coarser = levels[-1].halved()
        if np.count_nonzero(coarser.photographs.active) < most_pixels / 16:
            break  # a thin object would be lost
        levels.append(coarser)
    return levels


def cell_sums(image: Floats, cell: int) -> Floats:
    """Sums over cells of cell x cell pixels of an image (h, w[, C]), the last ones cut short.

    >>> cell_sums(np.ones((3, 4)), 2).tolist()
    [[4.0, 4.0], [2.0, 2.0]]
    """
    for axis in (0, 1):
        starts = np.arange(0, image.shape[axis], cell)
        image = np.add.reduceat(image, starts, axis=axis)
    return image


def spread(coarse: Floats, cell: int, shape: tuple[int, ...]) -> Floats:
    """An image of cells interpolated linearly between their centres, cut to `shape`."""
    from scipy.ndimage import zoom

    if cell == 1:
        return coarse
    fine = zoom(coarse, cell, order=1, mode="nearest", grid_mode=True)
    return np.asarray(fine[: shape[0], : shape[1]])
