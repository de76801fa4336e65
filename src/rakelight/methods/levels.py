"""What a method works on: photographs and prepared depth, at one resolution or more."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from rakelight.geometry.averaging import Averaging, data_sum_of_squares, data_terms
from rakelight.geometry.blur import blurred
from rakelight.geometry.camera import back_project
from rakelight.geometry.cells import cell_sums, interpolate
from rakelight.geometry.derivatives import gradient_image
from rakelight.geometry.fill import nearest_fill
from rakelight.geometry.grid import (
    Grid,
    Links,
    connected,
    has_gradient,
    pair_slices,
    surface_links,
)
from rakelight.geometry.normals import (
    normal_lengths,
    normals_from_gradient,
    squared_normal_derivative,
)
from rakelight.model import BLACK, SATURATED, Array, Camera, Floats, Mask
from rakelight.photometry.images import Photographs, Surface
from rakelight.prepare import Prepared
from rakelight.prepare.average import pixel_noise
from rakelight.prepare.jumps import without_measured_jumps
from rakelight.prepare.linear import linear_table
from rakelight.solve.sparse import factorised

# Precision of depth that was filled in, over that of measured depth (ablation.md: off 1.01, halved
# 1.00, doubled 0.97).
FILLED = 0.01
# Side, pixels, of the square over which errors are taken to be correlated: the photographs' where
# the model holds, of slopes, and of the sensor's depth until it is known; and standard deviation of
# the Gaussian that averages the residual of the prepared depth against the measurements
# (ablation.md: halved 0.93 on draws of half the size, doubled 1.15).
CORRELATION_PX = 5.0


@dataclass(frozen=True, eq=False)
class Level:
    """Photographs and prepared depth at one resolution.

    prior : (h, w) log of the prepared depth, where refining begins
    unbiased_prior : (h, w) log depth p_0 of the sensor term: the prior without its smoothing's bias
    prior_weight : (h, w) the precision of both, 1 / variance; halving adds up four pixels'
    averaging : K, means over the sensor's pixels; None where those are no wider than this level's
    small_components : (h, w) connected components too small for a sensor pixel of their own: their
        pixels are compared with the prior one by one, since the mean over a sensor pixel, mostly
        of other components, would move them by its error
    middle_m : (3,) the object's middle, metres
    points : (h, w, 3) of the prepared depth, metres from the middle, for near lights; refining
        moves them little compared to the distance of the lights
    relative_noise_variance : variance of the sensor's noise from pixel to pixel over the variance
        that `prior_weight` was made of; at most 1, less where the sensor may be more precise
    sensor_pixel : its side in this level's pixels
    """

    photographs: Photographs
    prior: Floats
    unbiased_prior: Floats
    prior_weight: Floats
    middle_m: Floats
    points: Floats
    averaging: Averaging | None
    small_components: Mask
    relative_noise_variance: float = 1.0
    sensor_pixel: float = 1.0

    @property
    def mask(self) -> Mask:
        """(h, w) the object."""
        return self.photographs.mask

    @property
    def grid(self) -> Grid:
        """The object's pixels and which of them are linked."""
        return self.photographs.grid

    @property
    def links(self) -> Links:
        """Which neighbouring pixels are on one surface."""
        return Links.of(self.grid)

    @property
    def camera(self) -> Camera:
        """The colour camera, of this level's window."""
        return self.photographs.camera

    @cached_property
    def image(self) -> Floats:
        """(h, w, 3) linear light of the first photograph, white is 1; 0 outside the mask."""
        return np.where(self.mask[..., None], self.photographs.decoded(0), 0.0)

    @cached_property
    def usable(self) -> Mask:
        """(h, w, 3) values of the first photograph that are neither saturated nor black."""
        return self.mask[..., None] & self.photographs.usable(0)

    @property
    def shaded(self) -> Mask:
        """(h, w, 3) the usable values of pixels that have a normal."""
        return np.asarray(self.usable & has_gradient(self.links)[..., None])

    def normals(self, log_depth: Floats) -> tuple[Floats, Floats]:
        """Normals (h, w, 3) and |m| (h, w) of a log depth (h, w)."""
        gradient = self.surface(log_depth).gradient
        return normals_from_gradient(gradient[..., 0], gradient[..., 1], self.camera)

    def squared_normal_derivative(self, surface: Surface) -> Floats:
        """(h, w) |dn/dg|^2 of a surface; see `geometry.normals.squared_normal_derivative`."""
        gradient = surface.gradient
        length = normal_lengths(gradient[..., 0], gradient[..., 1], self.camera)
        return squared_normal_derivative(length, self.camera)

    @property
    def rays(self) -> Floats:
        """(h, w, 3) points of the viewing rays at depth 1 metre."""
        return back_project(np.ones(self.mask.shape), self.camera)

    @property
    def radius_m(self) -> float:
        """The object's radius about its middle, metres."""
        return float(np.linalg.norm(self.points[self.mask], axis=-1).max())

    def surface(self, log_depth: Floats) -> Surface:
        """The surface of `log_depth` (h, w), as the photographs depend on it."""
        return Surface(gradient_image(log_depth, self.grid), self.points)

    def sensor_terms(self, log_depth: Floats, scale: float = 1.0) -> dict[str, Any]:
        """The sensor term for a correction of `log_depth` (h, w), as `solve.assemble` takes it.

        The energy  scale sum w (K (p - p_0))^2:  the detail of p_0 within a sensor pixel is
        interpolated, and does not constrain the surface.
        """
        terms = data_terms(
            self.averaging, scale * self.prior_weight, self.unbiased_prior - log_depth
        )
        if self.averaging is not None:
            terms["data_weight"] = scale * self.prior_weight * self.small_components
            terms["data_target"] = self.prior - log_depth
        return terms

    def sensor_sum_of_squares(self, log_depth: Floats) -> float:
        """sum w (K (p - p_0))^2 of a log depth (h, w), plus that of small components."""
        miss, weight = log_depth - self.unbiased_prior, self.prior_weight
        component_term = (weight * (log_depth - self.prior) ** 2)[self.small_components].sum()
        return data_sum_of_squares(self.averaging, weight, miss, self.mask) + float(component_term)

    def placed(self, log_depth: Floats) -> Floats:
        """A log depth (h, w) with each connected component moved as a whole to the sensor's depth.

        Each moves by the constant in log depth that minimises `sensor_sum_of_squares`, which
        photographs, of slopes alone, leave open.  Depth steps do not determine it: they are solved
        to 2 % of a right side that is nearly all the photographs', and the sensor's share is less.
        """
        number, membership, seen, factor = self._components
        miss = self.sensor_weight * (self.sensed(self.unbiased_prior) - self.sensed(log_depth))
        component_term = self.prior_weight * self.small_components * (self.prior - log_depth)
        right = seen.T @ miss + membership.T @ component_term[self.mask]
        moved = log_depth.copy()
        moved[self.mask] += factor.solve(right)[number]
        return moved

    @cached_property
    def _components(self) -> tuple[Array, Any, Any, Any]:
        """The C connected components of the P pixels, for `placed`.

        (P,) the number of each pixel's component; sparse (P, C), 1 where a pixel belongs to a
        component; sparse (M, C), the share of each component in a sensor pixel; and the factors of
        the (C, C) normal equations of the components' constants.
        """
        from scipy.sparse import csr_array, diags_array

        components, count = connected(self.grid)
        number = components[self.mask]
        membership = csr_array(
            (np.ones(number.size), (np.arange(number.size), number)), shape=(number.size, count)
        )
        seen = membership
        if self.averaging is not None:
            seen = self.averaging.matrix(self.mask) @ membership
        component_term = diags_array((self.prior_weight * self.small_components)[self.mask])
        weights = (
            seen.T @ diags_array(self.sensor_weight) @ seen
            + membership.T @ component_term @ membership
        )
        # keeps the matrix regular: a component that no sensor pixel sees does not move
        weights = weights + diags_array(1e-9 * (weights.diagonal() + weights.diagonal().max()))
        return number, membership, seen, factorised(weights.tocsc())

    @property
    def seen(self) -> Mask:
        """(hs, ws) the M pixels of the sensor that hold a part of the object."""
        return self.mask if self.averaging is None else self.averaging.covered

    @cached_property
    def measured(self) -> Mask:
        """(hs, ws) what the sensor measured; depth that was filled in weighs less."""
        weight, measured = self.sensor_weight, np.zeros(self.seen.shape, dtype=bool)
        measured[self.seen] = weight > np.sqrt(FILLED) * np.median(weight)
        return measured

    def sensed(self, image: Floats) -> Floats:
        """(M,) K image, of an image (h, w): its means over the sensor's pixels, those `seen`."""
        return (image if self.averaging is None else self.averaging.down(image))[self.seen]

    @property
    def sensor_weight(self) -> Floats:
        """(M,) precision of each of the sensor's pixels, in the order of `sensed`."""
        weight = self.prior_weight
        return (weight if self.averaging is None else self.averaging.total(weight))[self.seen]

    def weighted(self, factor: float) -> Level:
        """This level with the prior's weight multiplied by `factor`."""
        return replace(self, prior_weight=factor * self.prior_weight)

    def cut(self, log_depth: Floats) -> Level:
        """This level with its links cut at the jumps of `log_depth` (h, w) as well.

        Itself where no pixel would have a normal: then the depth is no surface.
        """
        here = self.links
        steep = surface_links(np.exp(log_depth), here.mask, self.camera)
        return self.linked(Links(here.mask, here.right & steep.right, here.down & steep.down))

    def linked(self, links: Links) -> Level:
        """This level with these links; itself where they leave no pixel that has a normal."""
        if not has_gradient(links).any():
            return self
        return replace(
            self,
            photographs=replace(self.photographs, grid=links),
            small_components=find_small_components(links, self.averaging),
        )

    def halved(self) -> Level:
        """This level at half the resolution."""
        photographs, averaging = self.photographs.halved(), None
        if self.averaging is not None and self.averaging.factor > 2:
            averaging = self.averaging.halved(photographs.mask)
        return Level(
            photographs,
            nearest_fill(self.means(self.prior), photographs.mask),
            nearest_fill(self.means(self.unbiased_prior), photographs.mask),
            cell_sums(np.where(self.mask, self.prior_weight, 0.0), 2),
            self.middle_m,
            self.means(self.points),
            averaging,
            find_small_components(photographs.grid, averaging),
            self.relative_noise_variance,
            self.sensor_pixel / 2,
        )

    def means(self, image: Floats) -> Floats:
        """(h/2, w/2[, C]) means of an image (h, w[, C]) over the object's part of 2 x 2 pixels."""
        inside = self.mask.reshape(*self.mask.shape, *[1] * (image.ndim - 2))
        count = np.maximum(cell_sums(inside.astype(float), 2), 1)
        return np.asarray(cell_sums(np.where(inside, image, 0.0), 2) / count)

    def carried(self, coarse: Level, log_depth: Floats) -> Floats:
        """The coarse level's log depth, interpolated on this level's grid."""
        # Beyond the coarse mask it is constant, as the coarse prior is.
        return interpolate(nearest_fill(log_depth, coarse.mask), 2, self.mask.shape)


def finest_level(prepared: Prepared, *, cut: bool = False, unbiased: bool = False) -> Level:
    """The level of the prepared window itself.

    cut : whether links end at the jumps of the prepared depth, unless all pixels would lose theirs
    unbiased : whether `unbiased_prior` is without the bias of the depth's smoothing
    """
    read = prepared.photographs.dtype
    white, grid = np.iinfo(read).max, Links.of(prepared.mask)
    photographs = Photographs(
        # One type for all levels, or kernels would be compiled for another.
        np.ascontiguousarray(prepared.photographs, dtype=np.uint16),
        linear_table(read, prepared.encoding),
        low=int(BLACK * white) + 1,
        high=int(np.ceil(SATURATED * white)) - 1,
        grid=grid,
        camera=prepared.camera,
        exposures=np.array(prepared.exposures, dtype=np.float64) if prepared.exposures else None,
    )
    averaging = None
    if prepared.factor > 1:
        averaging = prepared.sensor.averaging(prepared.mask)
    points = back_project(prepared.depth_m, prepared.camera)
    middle = points[prepared.mask].mean(axis=0)
    prior = np.log(prepared.depth_m)
    level = Level(
        photographs,
        prior,
        prior,
        depth_precision(prepared),
        middle,
        points - middle,
        averaging,
        find_small_components(grid, averaging),
        relative_noise_variance(prepared),
        prepared.factor,
    )
    level = level.cut(prior) if cut else level
    return held_to_measurements(level, prepared, CORRELATION_PX) if unbiased else level


def relative_noise_variance(prepared: Prepared) -> float:
    """Variance of the sensor's pixel-to-pixel noise over the one it is taken to have, at most 1.

    That is of `prepared.sensor.sigma_m`, its median where the sensor measured.
    """
    sensor = prepared.sensor
    if not sensor.measured.any():
        return 1.0
    typical_m = float(np.median(sensor.sigma_m[sensor.measured]))
    return min(pixel_noise(sensor.depth_m) / typical_m, 1.0) ** 2


def cut_at_measured_jumps(level: Level, prepared: Prepared) -> Level:
    """The finest level with its links cut at the jumps that the sensor's measurements show, too.

    Where these are as fine as the photographs and of the same view; others do not show to a pixel
    where a jump is.
    """
    measured = prepared.sensor.depth_m
    if not prepared.own_view or measured.shape != level.mask.shape:
        return level
    measured = np.where(level.mask, measured, np.nan)
    return level.linked(without_measured_jumps(level.links, measured, level.camera))


def first_photograph(prepared: Prepared) -> Level:
    """The finest level of a method for one photograph: the first; links end at jumps."""
    return finest_level(replace(prepared, photographs=prepared.photographs[:1]), cut=True)


def find_small_components(grid: Grid, averaging: Averaging | None) -> Mask:
    """(h, w) connected components, by pixels with a normal, smaller than a sensor pixel.

    Empty where the sensor's pixels are no wider than the grid's.
    """
    links = Links.of(grid)
    if averaging is None:
        return np.zeros_like(links.mask)
    active = has_gradient(grid)
    sides = []
    for axis, side in ((1, links.right), (0, links.down)):
        here, there = pair_slices(axis)
        linked = side.copy()
        linked[here] &= active[here] | active[there]
        sides.append(linked)
    components, count = connected(Links(links.mask, *sides))
    size = np.bincount(components[links.mask], minlength=count)
    return links.mask & (size < averaging.factor**2)[components]


def held_to_measurements(level: Level, prepared: Prepared, averaged_px: float = 0.0) -> Level:
    """The finest level with a p_0 that is corrected by its residual against the measurements.

    averaged_px : deviation of the Gaussian, pixels, that averages the residual.  With
        `CORRELATION_PX` the bias of the prepared depth's smoothing, which flattens slopes, is gone.
        With 0 the means of p_0 are the measurements themselves: the sensor then tells how high
        relief is that is a few of its pixels wide, which averaging takes away.  Not for a start:
        lights that are not known yet follow what is wrong beside jumps.
    """
    before = level.unbiased_prior
    miss, seen = sensor_error(prepared, before)
    if averaged_px:
        miss = blurred(miss, averaged_px / prepared.factor, seen)
    after = before + prepared.sensor.nearest_upsample(miss, before.shape)
    return replace(level, unbiased_prior=np.where(level.photographs.active, after, before))


def sensor_error(prepared: Prepared, log_depth: Floats) -> tuple[Floats, Mask]:
    """(hs, ws) log measurements less the means of a log depth (h, w), and where there are any.

    0 where there is no measurement of the object.
    """
    averaging = prepared.sensor.averaging(prepared.mask)
    seen = prepared.sensor.measured & averaging.covered
    measured = np.log(np.where(seen, prepared.sensor.depth_m, 1.0))
    return np.where(seen, measured - averaging.down(log_depth), 0.0), seen


def depth_precision(prepared: Prepared) -> Floats:
    """(h, w) 1 / variance of the prepared log depth.

    The factor^2 pixels of a depth pixel share the precision of its measurement; depth that was
    filled in has `FILLED` of it.
    """
    precision = (prepared.depth_m / prepared.sigma_m / prepared.factor) ** 2
    return np.where(prepared.measured, precision, FILLED * precision)


def pyramid(finest: Level, most_pixels: int) -> list[Level]:
    """Levels from the finest to one with at most `most_pixels` pixels, halved each time."""
    levels = [finest]
    while np.count_nonzero(levels[-1].mask) > most_pixels:
        coarser = levels[-1].halved()
        if np.count_nonzero(coarser.photographs.active) < most_pixels / 16:
            break  # a narrow object would be lost
        levels.append(coarser)
    return levels
