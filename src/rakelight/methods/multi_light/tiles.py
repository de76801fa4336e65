"""A part of large photographs, refined from what a lower resolution says of the whole.

The lower resolution, `shrink` times, has determined the lights, the highlights and shadows, and the
surface but for its finest detail.  So the log depth p of a tile minimises

    E = sum loss(rho_c (max(0, s_i . n) + phi_i) + H_i - I_ic)   the photographs' energy
        + sum of fourth differences                              (both as in energy.py)
        + sigma^2 sum w (K (p - p_c))^2                          agreement with the lower resolution

with the lights s_i and the gloss of the highlights H_i fixed, p_c the lower resolution's log depth,
and K the means over its pixels.  The weight w is such that a correction of the mean fades within
`LENGTH` of those pixels, so that tiles with a margin of some of them agree where they overlap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rakelight.geometry.averaging import Averaging
from rakelight.geometry.camera import back_project
from rakelight.geometry.cells import interpolate
from rakelight.geometry.fill import nearest_fill
from rakelight.geometry.grid import has_gradient
from rakelight.methods.base import UNDETERMINED_RAD, Estimate
from rakelight.methods.levels import Level, finest_level
from rakelight.methods.multi_light.bas_relief_variance import shape_errors
from rakelight.methods.multi_light.confidence import normal_errors
from rakelight.methods.multi_light.energy import Fit, first_fit, update_scale
from rakelight.methods.multi_light.normals import fine_normals
from rakelight.methods.multi_light.outliers import LitSurface, Outliers, find_outliers
from rakelight.methods.multi_light.steps import depth_step
from rakelight.model import Array, Floats, Lights, Mask
from rakelight.photometry.images import LightParameters
from rakelight.prepare import Prepared

# Pixels of the lower resolution within which a correction of their means fades.  From 2 to 12 the
# depth changes by 2 %, normals by 0.015 degrees (docs/explanation/scale.md).
LENGTH = 4.0
# Weight of pixels that no pixel of the lower resolution covers whole, over the others': they only
# have to stay near, since the continuation of a steep side is flat.
EDGE = 0.01
# Steps of the depth in a tile; a third one changes normals by 0.04 degrees, and errors by none.
STEPS = 2
# Least information of the median pixel, squared values of white, that a weight is taken from.
LEAST_INFORMATION = 1e-12


@dataclass(frozen=True, eq=False)
class Whole:
    """What the lower resolution says of the whole object.

    shrink : the photographs' pixels along a pixel of it; row, column : of its window's upper left
        corner in its image
    mask : (h, w) the object; the other images go on beyond it as they are at its border
    log_depth, depth_sigma_m : (h, w) of the estimate, and its expected error
    stated, lights : the lights as the estimate states them, and as the solver moves them
    middle_m : (3,) the object's middle; outliers : cast shadows and highlights that it predicts
    bas_relief : (h, w) expected squared error of normals, radians^2, by the bas-relief transform of
        the whole shape; 0 under given directions
    """

    shrink: int
    row: int
    column: int
    log_depth: Floats
    mask: Mask
    depth_sigma_m: Floats | None
    stated: Lights
    lights: LightParameters
    middle_m: Floats
    outliers: Outliers
    bas_relief: Floats

    def part(self, image: Array, rows: slice, columns: slice) -> Array:
        """An image (h, w, ...) at the pixels of its image that these rows and columns name.

        Beyond the window it continues as at its border.
        """
        at = [
            np.clip(place, 0, side - 1)
            for place, side in zip(self._places(rows, columns), self.mask.shape, strict=True)
        ]
        return np.asarray(image[np.ix_(*at)])

    def mask_part(self, rows: slice, columns: slice) -> Mask:
        """The mask there; False beyond the window."""
        within = [
            (place >= 0) & (place < side)
            for place, side in zip(self._places(rows, columns), self.mask.shape, strict=True)
        ]
        return np.asarray(self.part(self.mask, rows, columns) & np.logical_and.outer(*within))

    def _places(self, rows: slice, columns: slice) -> tuple[Array, Array]:
        """The rows and columns as counted in the window."""
        return (
            np.arange(rows.start, rows.stop) - self.row,
            np.arange(columns.start, columns.stop) - self.column,
        )


def whole_of(prepared: Prepared, estimate: Estimate, shrink: int) -> Whole:
    """What an estimate at a lower resolution says to the tiles of a higher one.

    prepared : what the estimate was made from
    """
    log_depth, lights = estimate.log_depth, estimate.lights
    level = finest_level(prepared, cut=True, unbiased=True)
    level = replace(level, middle_m=level.middle_m if lights.middle_m is None else lights.middle_m)
    level = level.cut(log_depth)
    distance_m = lights.distance_m
    inverse_distance = np.zeros_like(lights.ambient) if distance_m is None else 1 / distance_m
    held = prepared.lights is not None and prepared.lights.fixed
    parameters = LightParameters(lights.vector, lights.ambient, inverse_distance, beam=lights.beam)
    if lights.ambient_direction is not None:
        parameters = replace(parameters, ambient_direction=lights.ambient_direction)
    bas_relief = shape_errors(level, log_depth, None if held else parameters)[1]
    outliers = find_outliers(LitSurface(level, log_depth, parameters))
    return Whole(
        shrink=shrink,
        row=prepared.rows.start,
        column=prepared.columns.start,
        log_depth=nearest_fill(log_depth, prepared.mask),
        mask=prepared.mask,
        depth_sigma_m=None
        if estimate.depth_sigma is None
        else nearest_fill(estimate.depth_sigma, prepared.mask),
        stated=lights,
        lights=replace(parameters, gloss=outliers.highlights.coefficients),
        middle_m=level.middle_m,
        outliers=outliers,
        bas_relief=nearest_fill(bas_relief, prepared.mask),
    )


def refine_tile(
    prepared: Prepared, whole: Whole, check: Callable[[], None] = lambda: None
) -> Estimate:
    """The window of `prepared` refined, or as it was where no pixel of it has a normal.

    prepared : its rows and columns begin between pixels of the lower resolution
    check : called between the steps; what it raises comes through
    """
    if not has_gradient(prepared.mask).any():
        return replace(
            unmoved_tile(prepared, whole),
            depth_sigma=carried_sigma(prepared, whole),
            normal_sigma=np.full(prepared.mask.shape, np.degrees(UNDETERMINED_RAD)),
        )
    level, start = tile_level(prepared, whole)
    fit = first_fit(level, start, whole.lights)
    level = level.weighted(agreement(fit, whole.shrink))
    for step in range(STEPS):
        check()
        fit = fit if step == 0 else update_scale(level, fit, noisiest=1.0)
        fit = depth_step(level, fit, with_light_slope=False)
    check()
    normals, linearization = fine_normals(level, fit)
    check()
    bas_relief = carried(whole.bas_relief, prepared, whole)
    confidence, normal_sigma, _ = normal_errors(level, fit, normals, bas_relief)
    return Estimate(
        log_depth=fit.log_depth,
        albedo=linearization.albedo,
        confidence=confidence,
        lights=whole.stated,
        normals=normals,
        depth_sigma=carried_sigma(prepared, whole),
        normal_sigma=normal_sigma,
    )


def unmoved_tile(prepared: Prepared, whole: Whole) -> Estimate:
    """The window with its prepared depth, and the albedo that explains the photographs by it."""
    level = finest_level(replace(prepared, factor=1.0))
    points = level.points + level.middle_m - whole.middle_m
    surface = replace(level.surface(level.prior), points=points)
    found = level.photographs.linearize(surface, whole.lights)
    nothing = np.zeros(prepared.mask.shape)
    return Estimate(level.prior, found.albedo, nothing, whole.stated)


def carried_sigma(prepared: Prepared, whole: Whole) -> Floats | None:
    """(h, w) the expected error of the depth, metres, where the lower resolution says it."""
    if whole.depth_sigma_m is None:
        return None
    return carried(whole.depth_sigma_m, prepared, whole)


def tile_level(prepared: Prepared, whole: Whole) -> tuple[Level, Floats]:
    """The level of a tile, its agreement with the lower resolution of weight 1; and its start."""
    # A factor of 1: tiles have no use for the averaging over the sensor's pixels.
    level = finest_level(replace(prepared, factor=1.0), cut=True)
    shrink = whole.shrink
    coarse = coarse_window(prepared, whole)
    log_depth = whole.part(whole.log_depth, *coarse)
    target, covered = (
        in_blocks(image, shrink, prepared.mask.shape)
        for image in (log_depth, whole.mask_part(*coarse))
    )
    start = carried(whole.log_depth, prepared, whole)
    edges = [np.arange(part.stop - part.start + 1) * float(shrink) for part in coarse]
    level = replace(
        level.cut(start),
        prior=start,
        unbiased_prior=target,
        prior_weight=np.where(covered, 1.0, EDGE),
        middle_m=whole.middle_m,
        points=back_project(np.exp(start), prepared.camera) - whole.middle_m,
        averaging=Averaging.on(prepared.mask & covered, *edges),
        # What no pixel of the lower resolution covers whole stays near its continuation.
        small_components=prepared.mask & ~covered,
    )
    outliers = whole.outliers.carried(
        lambda image: in_blocks(whole.part(image, *coarse), shrink, prepared.mask.shape)
    )
    return outliers.removed(LitSurface(level, start, whole.lights)), start


def in_blocks(image: Array, shrink: int, shape: tuple[int, ...]) -> Array:
    """An image (h, w, ...) with every pixel repeated shrink x shrink times, cut to `shape`.

    >>> in_blocks(np.array([[1, 2]]), 2, (2, 3)).tolist()
    [[1, 1, 2], [1, 1, 2]]
    """
    return image.repeat(shrink, 0).repeat(shrink, 1)[: shape[0], : shape[1]]


def coarse_window(prepared: Prepared, whole: Whole) -> tuple[slice, slice]:
    """Rows and columns of the lower resolution that a tile covers."""
    rows, columns = (
        slice(part.start // whole.shrink, -(-part.stop // whole.shrink))
        for part in (prepared.rows, prepared.columns)
    )
    return rows, columns


def carried(image: Floats, prepared: Prepared, whole: Whole) -> Floats:
    """An image (h, w) of the lower resolution, interpolated at the pixels of a tile."""
    rows, columns = coarse_window(prepared, whole)
    wider = (slice(rows.start - 1, rows.stop + 1), slice(columns.start - 1, columns.stop + 1))
    shape = tuple((part.stop - part.start) * whole.shrink for part in wider)
    fine = interpolate(whole.part(image, *wider), whole.shrink, shape)
    height, width = prepared.mask.shape
    return fine[whole.shrink : whole.shrink + height, whole.shrink : whole.shrink + width]


def agreement(fit: Fit, shrink: int) -> float:
    """The weight of the agreement, 1 / variance of log depth, by which corrections fade."""
    information = max(fit.linearization.typical_information(2.0), LEAST_INFORMATION)
    return information / (fit.noise * LENGTH * shrink) ** 2
