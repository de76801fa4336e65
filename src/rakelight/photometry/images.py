"""One pass over all photographs: albedo, residuals and their derivatives for depth and lights.

The albedo is linear given the shading: it is solved for at each pixel and channel in the same pass
and, when asked, eliminated from the derivatives (variable projection).  The loops are in
`_kernels`; photographs stay integers and are decoded there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from rakelight.geometry.grid import Grid, Links, has_gradient
from rakelight.jit import in_blocks, in_parts
from rakelight.model import FARTHEST_M, MAD_TO_SIGMA, Array, Camera, Floats, Lights, Mask
from rakelight.photometry.specular import EXPONENTS
from rakelight.solve.robust import SMALLEST_NOISE

# Blocks of rows with a sum each; their number does not depend on the cores, nor does the result.
BLOCKS = 16
# Rows of the image in one task of `Photographs.linearize`.
ROWS = 16
# Pixels, evenly spread, that stand for all where medians, sums or the nearest one are wanted; those
# of all photographs together where it is decided whether there are highlights and shadows.  More
# only take longer (ablation.md).
SAMPLE_PIXELS = 5_000

# Largest length of the ambient light's direction: that of light from one point alone, whose first
# two orders of spherical harmonics are 1/4 + (l . n) / 2 (Ramamoorthi and Hanrahan 2001).
MOST_UNEVEN = 2.0


@dataclass(frozen=True, slots=True)
class LightParameters:
    """The lights of N photographs as the solver moves them, and how the surface reflects them.

    vector : (N, C, 3) towards the light times irradiance at the object's middle; C is 1 or 3
    ambient : (N, C)
    inverse_distance : (N, C) 1/metre, from the object's middle; 0 for a distant light
    gloss : (E,) coefficients k of the surface's highlights, see `photometry.specular`; 0 where it
        is matte
    beam : (N, C, 3) b_x, b_y and w of each lamp's beam, as in `Lights`; None without beams
    ambient_direction : (3,) d, that all photographs share: the ambient light on a normal n is
        ambient (1 + d . n)
    """

    vector: Floats
    ambient: Floats
    inverse_distance: Floats
    gloss: Floats = field(default_factory=lambda: np.zeros(len(EXPONENTS)))
    beam: Floats | None = None
    ambient_direction: Floats = field(default_factory=lambda: np.zeros(3))

    @classmethod
    def distant(cls, vector: Floats, ambient: Floats) -> LightParameters:
        """Lights at infinity."""
        return cls(vector, ambient, np.zeros_like(ambient))

    @property
    def irradiance(self) -> Floats:
        """(N, C) on a surface at the object's middle that faces the light."""
        return np.asarray(np.linalg.norm(self.vector, axis=-1))

    @property
    def ambient_share(self) -> float:
        """Sum of the ambient light over the sum of the irradiance, of all photographs."""
        total = float(self.irradiance.sum())
        return float(self.ambient.sum() / max(total, np.finfo(float).tiny))

    @property
    def numbers(self) -> Floats:
        """(N, C, 8) vector, inverse distance, beam and ambient, as `moved` takes their step."""
        inverse_distance, ambient = self.inverse_distance[..., None], self.ambient[..., None]
        return np.concatenate([self.vector, inverse_distance, self.beams, ambient], axis=-1)

    @property
    def beams(self) -> Floats:
        """(N, C, 3) `beam`, 0 without beams."""
        return np.zeros((*self.ambient.shape, 3)) if self.beam is None else self.beam

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """As kernels take them: vector q (C, 3, N), ambient (C, 4, N), fall-off (C, 4, N).

        Ambient light is phi and d; the fall-off |q| inverse_distance, and the beam's numbers.
        """
        nearness = (self.irradiance * self.inverse_distance)[..., None]
        falloff = np.concatenate([nearness, self.beams], axis=-1)
        direction = np.broadcast_to(self.ambient_direction, self.vector.shape)
        ambient = np.concatenate([self.ambient[..., None], direction], axis=-1)
        vector, ambient, falloff = (
            np.ascontiguousarray(np.moveaxis(each, 0, -1), dtype=np.float64)
            for each in (self.vector, ambient, falloff)
        )
        return vector, ambient, falloff

    def moved(
        self,
        step: Floats,
        gloss_step: Floats | float = 0.0,
        ambient_direction_step: Floats | float = 0.0,
    ) -> LightParameters:
        """The lights after a step (N, C, 4, 5 or 8), and those of what they share, (E,) and (3,).

        Of vector, [inverse_distance, [beam,]] and ambient.  What cannot be below 0 is not.
        """
        inverse_distance, beam = self.inverse_distance, self.beam
        if step.shape[-1] > 4:
            inverse_distance = np.maximum(inverse_distance + step[..., 3], 0.0)
        if step.shape[-1] > 5:
            beam = self.beams + step[..., 4:7]
            beam[..., 2] = np.maximum(beam[..., 2], 0.0)
        ambient = np.maximum(self.ambient + step[..., -1], 0.0)
        direction = self.ambient_direction + ambient_direction_step
        return replace(
            self, vector=self.vector + step[..., :3], ambient=ambient,
            inverse_distance=inverse_distance, beam=beam,
            gloss=np.maximum(self.gloss + gloss_step, 0.0),
            ambient_direction=direction / max(float(np.linalg.norm(direction)) / MOST_UNEVEN, 1.0),
        )  # fmt: skip

    def brighter(self, gain: float) -> LightParameters:
        """The lights with `gain` times the intensity, for albedo and gloss divided by `gain`."""
        return replace(
            self, vector=self.vector * gain, ambient=self.ambient * gain, gloss=self.gloss / gain
        )

    def as_lights(self, middle_m: Floats) -> Lights:
        """The lights as a result states them; near ones get their positions."""
        direction = self.ambient_direction if self.ambient_direction.any() else None
        lights = Lights(self.vector, self.ambient, ambient_direction=direction)
        near = (self.inverse_distance > 0).any()
        if not near and self.beam is None:
            return lights
        distance = 1 / np.maximum(self.inverse_distance, 1 / FARTHEST_M)
        position = middle_m + distance[..., None] * lights.direction if near else None
        return replace(lights, position_m=position, middle_m=middle_m, beam=self.beam)


@dataclass(frozen=True, slots=True)
class Surface:
    """What the photographs see of a depth map.

    gradient : (h, w, 2) of log depth; points : (h, w, 3) metres from the object's middle
    """

    gradient: Floats
    points: Floats


@dataclass(frozen=True, slots=True)
class Linearization:
    """The residuals of a surface and lights, linearised, and the albedo that goes with them.

    albedo : (h, w, 3); energy : sum of squared residuals or, with a scale, of their Cauchy losses
    jtwj, rhs : M = J'WJ (h, w, 3: uu, uv, vv) and b = -J'Wr (h, w, 2) of each pixel; moving its
        gradient of log depth by d changes the energy by about  d^T M d - 2 b . d
    noise_sigma : standard deviation of a value, at least that of rounding to 16 bit, from the
        median of the absolute residuals in one channel of every other pixel; rms : root mean
        square of all residuals
    observations : number of usable values; mean_abs_residual : (h, w) over those of each pixel
    light_slope : (N, C, 8) half the energy's derivatives with the lights' vector, inverse_distance,
        beam and ambient, the albedo eliminated; None unless asked for
    gloss_slope, ambient_direction_slope : (E,) and (3,) those with the gloss, 0 where it is 0, and
        with the ambient light's direction, None unless that is not 0 or asked for, likewise
    """

    albedo: Floats
    energy: float
    jtwj: Floats
    rhs: Floats
    noise_sigma: float
    rms: float
    observations: int
    mean_abs_residual: Floats
    light_slope: Floats | None = None
    gloss_slope: Floats | None = None
    ambient_direction_slope: Floats | None = None

    def typical_information(self, per: Floats | float = 1.0) -> float:
        """The median of the trace of M divided by `per`; 0 where photographs say nothing.

        Of the pixels of which they say anything: most may be black or saturated.
        per : 2 for the mean over both directions; |dn/dg|^2 (h, w) for information on the normal
        """
        trace = self.jtwj[..., 0] + self.jtwj[..., 2]
        informed = trace > 0
        return float(np.median((trace / per)[informed])) if informed.any() else 0.0

    def darker(self, gain: float) -> Linearization:
        """The same with the albedo divided by `gain`, for lights multiplied by it."""
        return replace(self, albedo=self.albedo / gain)

    def normal_equations(self, surface: Surface) -> tuple[Floats, Floats]:
        """M and M g + b: for the gradient itself, not its change from the surface's, g."""
        return self.jtwj, self.rhs + applied(self.jtwj, surface.gradient)


def applied(tensor: Floats, gradient: Floats) -> Floats:
    """(h, w, 2) each pixel's tensor (h, w, 3: uu, uv, vv) times its gradient (h, w, 2).

    >>> applied(np.array([[[1.0, 2.0, 3.0]]]), np.array([[[1.0, 10.0]]])).tolist()
    [[[21.0, 32.0]]]
    """
    u = tensor[..., 0] * gradient[..., 0] + tensor[..., 1] * gradient[..., 1]
    v = tensor[..., 1] * gradient[..., 0] + tensor[..., 2] * gradient[..., 1]
    return np.stack([u, v], axis=-1)


@dataclass(frozen=True, eq=False)
class Photographs:
    """Photographs (N, h, w, 3), uint16 with the values as read, and what these mean.

    table : linear light of every value; values from `low` to `high` are usable
    grid : (h, w) mask of the object, or which of its neighbours are linked; camera : of this window
    exposures : (N,) of the photographs, beside each other; None where they are alike
    """

    values: Array
    table: Floats
    low: int
    high: int
    grid: Grid
    camera: Camera
    exposures: Floats | None = None

    def __len__(self) -> int:
        return len(self.values)

    @property
    def mask(self) -> Mask:
        """(h, w) the object."""
        return self.grid.mask if isinstance(self.grid, Links) else self.grid

    @property
    def active(self) -> Mask:
        """(h, w) pixels that have a normal."""
        return has_gradient(self.grid)

    def subsampling(self, most: int = SAMPLE_PIXELS) -> int:
        """The factor, along each side, by which `subsample` takes fewer pixels."""
        active = self.active
        subsampling = max(1, int(np.sqrt(np.count_nonzero(active) / most)))
        return subsampling if active[::subsampling, ::subsampling].any() else 1

    def subsample(self, most: int = SAMPLE_PIXELS) -> Mask:
        """(h, w) about `most` of the active pixels, on a regular grid; all when there are fewer."""
        active, subsampling = self.active, self.subsampling(most)
        chosen = np.zeros_like(active)
        chosen[::subsampling, ::subsampling] = active[::subsampling, ::subsampling]
        return chosen

    @cached_property
    def _light(self) -> Floats:
        """Linear light of every value, -1 where it is not usable."""
        codes = np.arange(self.table.size)
        usable = (codes >= self.low) & (codes <= self.high)
        return np.where(usable, self.table, np.float32(-1))

    def light(self, where: Mask) -> Floats:
        """(N, P, 3) linear light of the P pixels of a mask (h, w), negative where not usable."""
        return self._light[self.values[:, where]].astype(np.float64)

    def decoded(self, photograph: int) -> Floats:
        """(h, w, 3) linear light of one photograph, usable or not."""
        return np.asarray(self.table[self.values[photograph]], dtype=np.float64)

    def usable(self, photograph: int) -> Mask:
        """(h, w, 3) values of one photograph that are neither saturated nor black."""
        values = self.values[photograph]
        return np.asarray((values >= self.low) & (values <= self.high))

    def without(self, hidden: Iterable[Mask]) -> Photographs:
        """The photographs without some values: of each photograph (h, w, C or 3)."""
        values = np.empty_like(self.values)
        for one, leave_out, left in zip(self.values, hidden, values, strict=True):
            np.copyto(left, np.where(leave_out, 0, one))
        return replace(self, values=values)

    @property
    def _optics(self) -> tuple[float, float, float, float]:
        return (self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy)

    def linearize(
        self,
        surface: Surface,
        lights: LightParameters,
        *,
        scale: Floats | float = 0.0,
        start: Floats | None = None,
        lagged: bool = False,
        project: bool = True,
        with_light_slope: bool = False,
        ambient_direction: bool = False,
    ) -> Linearization:
        """The albedo that fits the photographs best, the residuals and their derivatives.

        scale : of the Cauchy loss, 0 for plain least squares
        start : albedo (h, w, 3) where its reweighting starts; None for least squares first
        lagged : derivatives with |m| fixed, as in the paper
        project : the albedo is eliminated (variable projection) instead of being fixed
        with_light_slope : first derivatives with the lights as well, for half as much time again
        ambient_direction : and with the ambient light's direction
        """
        from rakelight.photometry import _kernels

        height, width = self.mask.shape
        albedo = np.full((height, width, 3), -1.0) if start is None else start.copy()
        jtwj, rhs = np.empty((height, width, 3)), np.empty((height, width, 2))
        sums = np.zeros((height, 3))
        histogram = np.zeros((height, _kernels.BINS), dtype=np.int64)
        mean_abs_residual = np.zeros((height, width))
        rows, channels = height if with_light_slope else 0, lights.ambient.shape[1]
        numbers = 11 if ambient_direction or lights.ambient_direction.any() else 8
        slope = np.zeros((rows, channels, numbers, len(self)))
        gloss_slope = np.zeros((len(slope), len(lights.gloss)))
        # In one order in memory, or the kernel would be compiled once more for another.
        gradient, points = map(np.ascontiguousarray, (surface.gradient, surface.points))
        given = (
            self.values, self._light, self.active, gradient, points,
            self._optics, *lights.arrays, self._scales(scale), lagged, project,
            albedo, jtwj, rhs, sums, histogram, mean_abs_residual, with_light_slope, slope,
        )  # fmt: skip

        kernel: Callable[..., None] = _kernels.linearize
        if lights.gloss.any():
            kernel = partial(_kernels.linearize_glossy, lights.gloss, gloss_slope)

        def some_rows(block: int) -> None:
            kernel(ROWS * block, min(ROWS * (block + 1), height), *given)

        in_blocks(some_rows, -(-height // ROWS), len(self) * self.mask.size)
        energy, squared, count = sums.sum(axis=0)
        along = np.moveaxis(slope.sum(axis=0), -1, 0)
        by_direction = None
        if with_light_slope and numbers == 11:  # with ambient light phi, and with phi d
            along[..., 7] += along[..., 8:] @ lights.ambient_direction
            by_direction = np.einsum("nc,nck->k", lights.ambient, along[..., 8:])
        return Linearization(
            albedo=albedo,
            energy=float(energy),
            jtwj=jtwj,
            rhs=rhs,
            noise_sigma=_median_sigma(histogram.sum(axis=0), _kernels.WIDEST),
            rms=float(np.sqrt(squared / max(count, 1.0))),
            observations=int(count),
            mean_abs_residual=mean_abs_residual,
            light_slope=along[..., :8] if with_light_slope else None,
            gloss_slope=gloss_slope.sum(axis=0) if with_light_slope else None,
            ambient_direction_slope=by_direction,
        )

    def light_terms(
        self,
        surface: Surface,
        lights: LightParameters,
        albedo: Floats,
        *,
        scale: Floats | float = 0.0,
        numbers: int = 4,
        project: bool = True,
        subsampling: int = 1,
        mixed: bool = False,
        ambient_direction: bool = False,
    ) -> tuple[Floats, Floats, Floats]:
        """Second (K, K) and first (K,) derivatives of half the energy with the lights.

        K counts each light's numbers, as `LightParameters.moved` takes them; after them the gloss,
        unless it is 0, and last, when asked for, the ambient light's direction.
        numbers : of each light: 4 of distant ones, 5 of near ones, 8 of those with a beam
        subsampling : factor along each side by which fewer pixels are used; see `subsample`
        mixed : whether to find the used pixels' mixed derivatives with the gradient of log depth
            as well, (h / subsampling, w / subsampling, 2, K), rounded up; an empty array if not
        """
        from scipy.linalg import block_diag

        from rakelight.photometry import _kernels

        count, channels = lights.ambient.shape
        glossy, own = bool(lights.gloss.any()), count * numbers
        extra = (len(lights.gloss) if glossy else 0) + (3 if ambient_direction else 0)
        hessian = np.zeros((BLOCKS, channels, own + extra, own + extra))
        slope = np.zeros((BLOCKS, channels, numbers, count))
        every = (slice(None, None, subsampling),) * 2
        active = np.ascontiguousarray(self.active[every])
        shape = active.shape if mixed else (0, 0)
        both = np.zeros((*shape, 2, count, channels, numbers))
        shared_slope, shared_both = np.zeros((BLOCKS, extra)), np.zeros((*shape, 2, extra))
        # A camera whose pixels are wider by the factor; the gradient per pixel grows by it, too.
        optics = tuple(value / subsampling for value in self._optics)
        gradient, points, scales, albedo = (
            np.ascontiguousarray(each[every])
            for each in (surface.gradient, surface.points, self._scales(scale), albedo)
        )
        values, gradient = np.ascontiguousarray(self.values[:, *every]), subsampling * gradient
        given = (
            values, self._light, active, gradient, points, optics, *lights.arrays, scales,
            albedo, numbers, project, hessian, slope, both, shared_slope, shared_both,
        )  # fmt: skip
        kernel: Callable[..., None] = _kernels.light_terms
        if glossy:
            kernel = partial(_kernels.light_terms_glossy, lights.gloss)
        in_blocks(lambda block: kernel(block, *given), BLOCKS, len(self) * active.size)
        # Order of the lights' numbers: photograph, channel, number; of the sums: channel, number,
        # photograph.
        places = np.arange(channels * own).reshape(channels, numbers, count)
        order = np.moveaxis(places, -1, 0).ravel()
        upper = np.triu(hessian.sum(axis=0))
        whole = upper + np.triu(upper, 1).swapaxes(1, 2)
        blocks = block_diag(*whole[:, :own, :own])[np.ix_(order, order)]
        beside = whole[:, :own, own:].reshape(channels * own, extra)[order]
        blocks = np.block([[blocks, beside], [beside.T, whole[:, own:, own:].sum(axis=0)]])
        slopes = np.append(slope.sum(axis=0).ravel()[order], shared_slope.sum(axis=0))
        both = both.reshape(*both.shape[:3], channels * own)
        if extra:
            both = np.concatenate([both, shared_both], axis=-1)
        both *= subsampling
        return blocks, slopes, both

    def _scales(self, scale: Floats | float) -> Floats:
        # Writable, as a number would make it: kernels are compiled for one of both.
        return np.array(np.broadcast_to(scale, self.mask.shape), dtype=np.float64)

    def halved(self) -> Photographs:
        """The photographs at half the resolution, averaged in linear light."""
        from rakelight.photometry import _kernels

        height, width = (-(-side // 2) for side in self.mask.shape)
        small = np.empty((len(self), height, width, 3), dtype=np.uint16)
        in_parts(_kernels.halve, 0, height, small.size, self.values, self._light, small)
        camera = Camera(
            width, height, self.camera.fx / 2, self.camera.fy / 2,
            (self.camera.cx - 0.5) / 2, (self.camera.cy - 0.5) / 2,
        )  # fmt: skip
        table = (np.arange(65536) / 65535).astype(np.float32)
        grid = Links.of(self.grid).halved()
        return Photographs(small, table, 1, 65534, grid, camera, self.exposures)


def _median_sigma(counts: Array, widest: float) -> float:
    """Robust standard deviation from a histogram of absolute residuals, not below rounding's."""
    total = counts.sum()
    if total == 0:
        return SMALLEST_NOISE
    below = np.cumsum(counts)
    bin_ = int(np.searchsorted(below, total / 2))
    inside = (total / 2 - (below[bin_] - counts[bin_])) / max(counts[bin_], 1)
    sigma = float(MAD_TO_SIGMA * (bin_ + inside) * widest / len(counts))
    return max(sigma, SMALLEST_NOISE)
