"""What a depth sensor does to the true depth: correlated noise, steps and holes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from rakelight.errors import InputError
from rakelight.model import Floats

LARGEST = 10_000.0  # of any property of a sensor: 10 m of noise, 10,000 pixels


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """The errors of a depth sensor; the defaults are those of a perfect one.

    rms_mm : root mean square of the noise at the reference depth, millimetres
    correlation_length_px : distance, in pixels of the depth map, at which the correlation of the
        noise has fallen to 1/e (it is Gaussian in the distance); 0 for independent pixels
    growth : the noise is proportional to (depth / reference depth)^growth; 2 for triangulation
        sensors (Khoshelham & Elberink 2012), 0 for uniform noise
    reference_depth_m : metres; None for the median depth of the map
    step_mm : depth is rounded to multiples of this, millimetres; 0 for none
    hole_fraction : share of the measured pixels that are lost, 0..1
    hole_size_px : about the diameter of a hole, pixels of the depth map
    """

    rms_mm: float = 0.0
    correlation_length_px: float = 0.0
    growth: float = 2.0
    reference_depth_m: float | None = None
    step_mm: float = 0.0
    hole_fraction: float = 0.0
    hole_size_px: float = 6.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value is not None and not 0 <= value <= LARGEST:
                raise InputError(
                    "not a possible property of a depth sensor",
                    source=item.name,
                    seen=f"{value}",
                    needed=f"0 to {LARGEST:g}",
                )
        for name, blind, needed in (
            ("hole_fraction", self.hole_fraction >= 1, "below 1"),
            ("reference_depth_m", self.reference_depth_m == 0, "above 0"),
        ):
            if blind:
                raise InputError(
                    "a depth sensor that sees nothing",
                    source=name,
                    seen=f"{getattr(self, name)}",
                    needed=needed,
                )


PERFECT = DepthNoise()
"""A sensor without errors."""

PAPER_NOISE = DepthNoise(rms_mm=3.325, correlation_length_px=20.06)
"""The paper's sensor.  rms_mm and correlation_length_px come from `calibrate_noise`: `python
benchmarks/accuracy.py noise` does it again."""

PAPER_INPUT = (3.33, 16.31)
"""RMSE in millimetres and MAE in degrees of the paper's prepared depth (its table 1)."""


def add_depth_noise(
    depth_m: Floats, noise: DepthNoise, seed: int | Sequence[int] | np.random.Generator = 0
) -> Floats:
    """What the sensor reports for `depth_m` (h, w) metres, NaN = no measurement; float32.

    The same seed gives the same noise, a generator its next.

    Raises InputError when there is no depth at all.

    >>> flat = np.full((60, 80), 0.8)
    >>> noisy = add_depth_noise(flat, DepthNoise(rms_mm=3.0, correlation_length_px=8.0))
    >>> round(1000 * float(np.sqrt(np.mean((noisy - flat) ** 2))), 3)
    3.0
    """
    measured = np.isfinite(depth_m)
    if depth_m.ndim != 2 or not measured.any():
        raise InputError(
            "there is no depth to add noise to",
            source="depth_m",
            seen=f"shape {depth_m.shape}, {np.count_nonzero(measured)} finite pixels",
            needed="a (h, w) map with finite depth",
        )
    rng = np.random.default_rng(seed)
    depth = np.array(depth_m, dtype=float)
    reference = noise.reference_depth_m or float(np.median(depth[measured]))
    texture = smooth_noise(rng, depth.shape, noise.correlation_length_px)
    texture /= np.sqrt(np.mean(texture[measured] ** 2))
    depth += noise.rms_mm / 1000 * texture * (depth / reference) ** noise.growth
    if noise.step_mm:
        depth = np.rint(depth * 1000 / noise.step_mm) * noise.step_mm / 1000
    blobs = smooth_noise(rng, depth.shape, noise.hole_size_px)
    lost = round(noise.hole_fraction * np.count_nonzero(measured))
    if lost:
        depth[measured & (blobs <= np.sort(blobs[measured])[lost - 1])] = np.nan
    return depth.astype(np.float32)


def calibrate_noise(
    score: Callable[[DepthNoise], tuple[float, float]],
    target: tuple[float, float] = PAPER_INPUT,
    start: DepthNoise = PAPER_NOISE,
    tolerance: float = 0.005,
    attempts: int = 30,
) -> DepthNoise:
    """`start` with the rms and correlation length at which `score` gives `target`.

    score : (RMSE in mm, MAE in degrees) of the depth that is left after preparation
    target : the two numbers wanted
    tolerance : relative, on both

    Broyden's method on logarithms; it starts from RMSE ~ rms and MAE ~ rms / length.  Raises
    InputError when it does not get there.

    >>> found = calibrate_noise(lambda noise: (noise.rms_mm, 50 * noise.rms_mm
    ...                                        / noise.correlation_length_px), (3.0, 10.0))
    >>> round(found.rms_mm, 1), round(found.correlation_length_px, 1)
    (3.0, 15.0)
    """
    goal = np.log(target)
    jacobian = np.array([[1.0, 0.0], [1.0, -1.0]])
    at = np.log([start.rms_mm, start.correlation_length_px])
    noise = start
    miss = np.log(score(noise)) - goal
    for _ in range(attempts):
        if np.all(np.abs(miss) <= np.log1p(tolerance)):
            return noise
        step = np.clip(-np.linalg.pinv(jacobian, 1e-3) @ miss, -0.5, 0.5)
        if not np.any(step):
            break
        at = at + step
        rms_mm, length_px = np.exp(at)
        noise = replace(start, rms_mm=float(rms_mm), correlation_length_px=float(length_px))
        missed, miss = miss, np.log(score(noise)) - goal
        jacobian = jacobian + np.outer(miss - missed - jacobian @ step, step) / (step @ step)
    raise InputError(
        "no depth noise gives these errors",
        source="target",
        seen=f"RMSE {np.exp(miss[0] + goal[0]):.3g} mm, MAE {np.exp(miss[1] + goal[1]):.3g} "
        f"degrees at {noise.rms_mm:.3g} mm rms over {noise.correlation_length_px:.3g} pixels",
        needed=f"RMSE {target[0]:.3g} mm, MAE {target[1]:.3g} degrees",
    )


def bent(depth_m: Floats, rms_mm: float, rng: np.random.Generator) -> Floats:
    """`depth_m` (h, w) plus a random polynomial of third degree, `rms_mm` over its measurements.

    A lens that is not quite known, or a sensor that warms up, distorts the whole field so.

    >>> flat = np.full((40, 50), 0.8)
    >>> off = bent(flat, 2.0, np.random.default_rng(0)) - flat
    >>> round(1000 * float(np.sqrt(np.mean(off**2))), 3)
    2.0
    """
    if not rms_mm:
        return depth_m
    legendre = np.polynomial.legendre.legval2d
    y, x = (np.linspace(-1, 1, side) for side in depth_m.shape)
    degree = np.add.outer(np.arange(4), np.arange(4))
    weights = np.where((degree > 0) & (degree <= 3), rng.standard_normal((4, 4)), 0.0)
    off = legendre(*np.meshgrid(x, y), weights)
    size = np.sqrt(np.mean(off[np.isfinite(depth_m)] ** 2))
    return np.asarray(depth_m + rms_mm / 1000 * off / size)


def flying_pixels(depth_m: Floats, jump_m: float, share: float, rng: np.random.Generator) -> Floats:
    """`depth_m` (h, w) with a share of the pixels beside a jump somewhere between both sides.

    jump_m : the least difference between a pixel's neighbours that is a jump, metres

    >>> step = np.repeat([[0.8, 0.8, 0.9, 0.9]], 3, axis=0)
    >>> flying_pixels(step, 0.05, 1.0, np.random.default_rng(0)).round(2)[1].tolist()
    [0.8, 0.89, 0.86, 0.9]
    """
    from scipy.ndimage import maximum_filter, minimum_filter

    finite = np.isfinite(depth_m)
    near = minimum_filter(np.where(finite, depth_m, np.inf), 3)
    far = maximum_filter(np.where(finite, depth_m, -np.inf), 3)
    step = np.maximum(far - near, 0)  # minus infinity where nothing is measured
    between = near + rng.random(depth_m.shape) * step
    chosen = finite & (rng.random(depth_m.shape) < share) & (step > jump_m)
    return np.where(chosen, between, depth_m)


def smooth_noise(
    rng: np.random.Generator, shape: tuple[int, ...], correlation_length_px: float
) -> Floats:
    """White noise under a Gaussian filter; its correlation is exp(-(r / length)^2)."""
    from scipy.ndimage import gaussian_filter

    white = rng.standard_normal(shape)
    if not correlation_length_px:
        return white
    # a Gaussian of width sigma correlates as exp(-r^2 / (4 sigma^2))
    return np.asarray(gaussian_filter(white, correlation_length_px / 2, mode="wrap"))
