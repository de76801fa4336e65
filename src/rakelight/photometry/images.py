"""One pass over all photographs: albedo, depth terms and light terms of a surface under lamps.

The albedo is linear given the shading, so each pixel's own is found on the way (and, when asked,
eliminated from the derivatives: variable projection).  The work is in `_kernels`; photographs
stay integers, decoded on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rakelight.geometry.grid import Grid, Links, has_gradient
from rakelight.jit import in_blocks, in_parts
from rakelight.model import FARTHEST_M, MAD_TO_SIGMA, Array, Camera, Floats, Lights, Mask

# Rows are summed in this many blocks, however many cores there are: the same numbers everywhere.
BLOCKS = 16
# Rows that a core explains at a time.
ROWS = 16


@dataclass(frozen=True, slots=True)
class Lamps:
    """The lights of N photographs as the solver moves them.

    vector : (N, C, 3) towards the lamp times irradiance at the object's middle; C is 1 or 3
    ambient : (N, C)
    closeness : (N, C) 1/metre, inverse distance from the object's middle; 0 for a distant lamp
    """

    vector: Floats
    ambient: Floats
    closeness: Floats

    @classmethod
    def distant(cls, vector: Floats, ambient: Floats) -> Lamps:
        """Lamps at infinity."""
        return cls(vector, ambient, np.zeros_like(ambient))

    @property
    def irradiance(self) -> Floats:
        """(N, C) on a surface at the object's middle that faces the lamp."""
        return np.asarray(np.linalg.norm(self.vector, axis=-1))

    @property
    def ambient_share(self) -> float:
        """The ambient light of all lamps as a part of their irradiance."""
        total = float(self.irradiance.sum())
        return float(self.ambient.sum() / max(total, np.finfo(float).tiny))

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Vector q (C, 3, N), ambient (C, N) and |q| closeness (C, N) as kernels take them."""
        nearness = self.irradiance * self.closeness
        vector, ambient, nearness = (
            np.ascontiguousarray(each.T, dtype=np.float64)
            for each in (self.vector.swapaxes(1, 2), self.ambient, nearness)
        )
        return vector, ambient, nearness

    def moved(self, step: Floats) -> Lamps:
        """The lamps after a step (N, C, 4 or 5): vector, [closeness,] ambient."""
        closeness = self.closeness
        if step.shape[-1] == 5:
            closeness = np.maximum(closeness + step[..., 3], 0.0)
        ambient = np.maximum(self.ambient + step[..., -1], 0.0)
        return Lamps(self.vector + step[..., :3], ambient, closeness)

    def brighter(self, gain: float) -> Lamps:
        """The lamps with `gain` times the intensity, for an albedo that much smaller."""
        return replace(self, vector=self.vector * gain, ambient=self.ambient * gain)

    def as_lights(self, middle_m: Floats) -> Lights:
        """As a result states them; near lamps get their positions."""
        lights = Lights(self.vector, self.ambient)
        if not (self.closeness > 0).any():
            return lights
        distance = 1 / np.maximum(self.closeness, 1 / FARTHEST_M)
        position = middle_m + distance[..., None] * lights.direction
        return replace(lights, position_m=position, middle_m=middle_m)


@dataclass(frozen=True, slots=True)
class Surface:
    """What the photographs see of a depth map.

    gradient : (h, w, 2) of log depth; points : (h, w, 3) metres from the object's middle
    """

    gradient: Floats
    points: Floats


@dataclass(frozen=True, slots=True)
class Explanation:
    """How lamps and a surface explain the photographs.

    albedo : (h, w, 3); energy : sum of squared or, with a scale, of Cauchy losses
    tensor, vector : M (h, w, 3: uu, uv, vv) and b (h, w, 2); moving the gradient of log depth by d
        changes the energy by about  d^T M d - 2 b . d
    misfit : (h, w) mean absolute residual of each pixel
    spread, rms : standard deviation of a value, from the median in one channel of every other
        pixel; root mean square
    light_slope : (N, C, 5) half the energy's derivatives with the lights' vector, closeness and
        ambient, the albedo following; None unless asked for
    """

    albedo: Floats
    energy: float
    tensor: Floats
    vector: Floats
    spread: float
    rms: float
    observations: int
    misfit: Floats
    light_slope: Floats | None = None

    def darker(self, gain: float) -> Explanation:
        """The same with an albedo `gain` times smaller, for lamps that much brighter."""
        return replace(self, albedo=self.albedo / gain)

    def aim(self, surface: Surface) -> tuple[Floats, Floats]:
        """M and M g + b: the depth terms of the whole gradient, g being the surface's."""
        return self.tensor, self.vector + applied(self.tensor, surface.gradient)


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
    """Photographs (N, h, w, 3) as read, with what their values mean.

    table : linear light of every value; values from `low` to `high` are usable
    grid : (h, w) mask of the object, or which of its neighbours are linked; camera : of this window
    """

    values: Array
    table: Floats
    low: int
    high: int
    grid: Grid
    camera: Camera

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

    def stride(self, most: int) -> int:
        """Of how many pixels along each side `some` takes one."""
        active = self.active
        stride = max(1, int(np.sqrt(np.count_nonzero(active) / most)))
        return stride if active[::stride, ::stride].any() else 1

    def some(self, most: int) -> Mask:
        """(h, w) about `most` of the active pixels, evenly spaced; all when there are fewer."""
        active, stride = self.active, self.stride(most)
        chosen = np.zeros_like(active)
        chosen[::stride, ::stride] = active[::stride, ::stride]
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

    def cleared(
        self,
        hidden: Mask | None,
        shine: Callable[[int], Floats] | None = None,
        much: float = np.inf,
    ) -> Photographs:
        """The photographs without values in shadows and without highlights.

        hidden : (N, h, w, C) what is not usable; None for nothing
        shine : of each photograph, the light (P, C) to take from its active pixels; None for none
        much : where that is more than this part of a value, the value is left out
        """
        active, table = self.active, np.arange(65536) / 65535
        values, low, high = np.empty_like(self.values, dtype=np.uint16), 1, 65534
        for i, value in enumerate(values):
            light = self._light[self.values[i]]
            usable = light >= 0
            if hidden is not None:
                usable &= ~hidden[i]
            if shine is not None:
                height = shine(i)
                usable[active] &= height <= much * light[active]
                light[active] -= height
            np.clip(np.rint(65535 * light), low, high, out=light)
            value[:] = np.where(usable, light, 0)
        return Photographs(values, table.astype(np.float32), low, high, self.grid, self.camera)

    def dimmed(self, share: float, least: int) -> Photographs:
        """The photographs without the brightest of each pixel's and channel's usable values.

        share : part of these that is left out, as long as `least` are left
        """
        light = np.stack([self._light[values] for values in self.values])
        light[light < 0] = np.inf
        usable = np.isfinite(light).sum(axis=0)
        keep = np.maximum(usable - np.rint(share * usable), np.minimum(usable, least))
        rank = light.argsort(axis=0).argsort(axis=0)
        return self.cleared(rank >= keep)

    @property
    def _optics(self) -> tuple[float, float, float, float]:
        return (self.camera.fx, self.camera.fy, self.camera.cx, self.camera.cy)

    def explain(
        self,
        surface: Surface,
        lamps: Lamps,
        *,
        scale: Floats | float = 0.0,
        start: Floats | None = None,
        lagged: bool = False,
        project: bool = True,
        turning: bool = False,
    ) -> Explanation:
        """The albedo that explains the photographs best, and what is left unexplained.

        scale : of the Cauchy loss, 0 for plain least squares; start : albedo (h, w, 3) where its
        reweighting starts; lagged : derivatives with |m| held, the paper's; project : the albedo
        follows the depth (variable projection) instead of being held; turning : with the first
        derivatives of the lights, for half as much time again
        """
        from rakelight.photometry import _kernels

        height, width = self.mask.shape
        albedo = np.full((height, width, 3), -1.0) if start is None else start.copy()
        tensor, vector = np.empty((height, width, 3)), np.empty((height, width, 2))
        sums = np.zeros((height, 3))
        histogram = np.zeros((height, _kernels.BINS), dtype=np.int64)
        misfit = np.zeros((height, width))
        slope = np.zeros((height if turning else 0, lamps.ambient.shape[1], 5, len(self)))
        given = (
            self.values, self._light, self.active, surface.gradient, surface.points,
            self._optics, *lamps.arrays, self._scales(scale), lagged, project,
            albedo, tensor, vector, sums, histogram, misfit, turning, slope,
        )  # fmt: skip

        def some_rows(block: int) -> None:
            _kernels.explain(ROWS * block, min(ROWS * (block + 1), height), *given)

        in_blocks(some_rows, -(-height // ROWS), len(self) * self.mask.size)
        energy, squared, count = sums.sum(axis=0)
        return Explanation(
            albedo=albedo,
            energy=float(energy),
            tensor=tensor,
            vector=vector,
            spread=_median_spread(histogram.sum(axis=0), _kernels.WIDEST),
            rms=float(np.sqrt(squared / max(count, 1.0))),
            observations=int(count),
            misfit=misfit,
            light_slope=np.moveaxis(slope.sum(axis=0), -1, 0) if turning else None,
        )

    def light_terms(
        self,
        surface: Surface,
        lamps: Lamps,
        albedo: Floats,
        *,
        scale: Floats | float = 0.0,
        near: bool = False,
        project: bool = True,
        stride: int = 1,
        mixed: bool = False,
    ) -> tuple[Floats, Floats, Floats]:
        """Second (K, K) and first (K,) derivatives of half the energy with the lights.

        K counts vector, closeness where `near`, and ambient of each light.
        stride : one pixel of so many along each side is used; see `some`
        mixed : whether to find each of these pixels' mixed derivatives with the gradient of log
            depth as well, (h / stride, w / stride, 2, K), rounded up; an empty array if not
        """
        from scipy.linalg import block_diag

        from rakelight.photometry import _kernels

        parameters = 5 if near else 4
        count, channels = lamps.ambient.shape
        own = count * parameters
        hessian = np.zeros((BLOCKS, channels, own, own))
        slope = np.zeros((BLOCKS, channels, parameters, count))
        thin = (slice(None, None, stride),) * 2
        active = np.ascontiguousarray(self.active[thin])
        both = np.zeros((*(active.shape if mixed else (0, 0)), 2, count, channels, parameters))
        # Of a camera with pixels so much wider, between which log depth changes so much more.
        optics = tuple(value / stride for value in self._optics)
        gradient, points, scales, albedo = (
            np.ascontiguousarray(each[thin])
            for each in (surface.gradient, surface.points, self._scales(scale), albedo)
        )
        values, gradient = np.ascontiguousarray(self.values[:, *thin]), stride * gradient
        given = (
            values, self._light, active, gradient, points, optics, *lamps.arrays, scales,
            albedo, parameters, project, hessian, slope, both,
        )  # fmt: skip
        in_blocks(
            lambda block: _kernels.light_terms(block, *given), BLOCKS, len(self) * active.size
        )
        both *= stride
        # The lights' order is photograph, channel, number; the block sums' channel, number, lamp.
        numbers = np.arange(channels * own).reshape(channels, parameters, count)
        order = np.moveaxis(numbers, -1, 0).ravel()
        upper = np.triu(hessian.sum(axis=0))
        blocks = block_diag(*(upper + np.triu(upper, 1).swapaxes(1, 2)))
        both = both.reshape(*both.shape[:3], channels * own)
        return blocks[np.ix_(order, order)], slope.sum(axis=0).ravel()[order], both

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
        return Photographs(small, table, 1, 65534, Links.of(self.grid).halved(), camera)


def _median_spread(counts: Array, widest: float) -> float:
    """Robust standard deviation from a histogram of absolute residuals."""
    total = counts.sum()
    if total == 0:
        return 0.0
    below = np.cumsum(counts)
    bin_ = int(np.searchsorted(below, total / 2))
    inside = (total / 2 - (below[bin_] - counts[bin_])) / max(counts[bin_], 1)
    return float(MAD_TO_SIGMA * (bin_ + inside) * widest / len(counts))
