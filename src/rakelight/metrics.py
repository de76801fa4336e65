"""How far a depth map and its normals are from the truth.

Scores are taken over a mask that the caller states and that does not depend on the estimate.
A masked pixel without an estimate is *charged*, so that leaving pixels out never helps:

- depth: the error of a pixel is min(|z - z_true|, z_true / 10), and z_true / 10 where there is no
  estimate.  An estimate that is off by a tenth of the distance is worth as much as none.
- normals: the error of a pixel is the angle between the normals, 0..180 degrees, and 180 where
  there is no estimate.

Each charge is the largest error that its pixel can have, hence removing an estimate can only
raise that pixel's error; mean, root mean square, median and percentile are monotonic in every
pixel's error, so no score falls.  (Depth has to be cut off somewhere for this: with unbounded
errors no finite charge would do.)  Coverage says how many masked pixels have an estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.errors import InputError, check_is
from rakelight.geometry.finite import require_numbers
from rakelight.geometry.normals import surface_normals
from rakelight.model import Camera, Floats, Mask, Result, Truth

DEPTH_CHARGE = 0.1
"""Largest error that counts, and the error of a missing pixel, as a fraction of the true depth."""

NORMAL_CHARGE_DEG = 180.0
"""The error of a missing normal, in degrees."""

DEPTH_RANGE_MM, NORMAL_RANGE_DEG = 5.0, 30.0
"""The error maps' brightest colour; a fixed range keeps the maps of several results comparable."""


@dataclass(frozen=True, slots=True)
class DepthErrors:
    """Depth errors over a mask, in millimetres; coverage in 0..1.  See the module's rules."""

    rmse_mm: float
    median_mm: float
    p95_mm: float
    coverage: float


@dataclass(frozen=True, slots=True)
class NormalErrors:
    """Angles between normals over a mask, in degrees (mae: their mean); coverage in 0..1."""

    mae_deg: float
    median_deg: float
    p95_deg: float
    coverage: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The scores of one estimate."""

    depth: DepthErrors
    normals: NormalErrors


def evaluate_maps(
    depth: Floats, normals: Floats, truth: Truth, mask: Mask | None = None
) -> Evaluation:
    """Scores of `depth` (H, W) metres and `normals` (H, W, 3) against `truth`.

    mask : (H, W) bool, the pixels that count; None stands for all of the truth's, never for the
        estimate's

    Raises InputError where sizes differ, the mask is empty or leaves the truth.

    >>> truth = Truth(np.ones((2, 2)), np.full((2, 2, 3), [0.0, 0.0, -1.0]), np.ones((2, 2, 3)))
    >>> scores = evaluate_maps(truth.depth + 0.003, truth.normals, truth)
    >>> round(scores.depth.rmse_mm, 9), scores.normals.mae_deg, scores.normals.coverage
    (3.0, 0.0, 1.0)
    """
    check_is(truth, Truth, "truth", "read one with rakelight.load_truth")
    require_numbers("truth", truth.depth)
    chosen = truth.mask if mask is None else mask
    return Evaluation(
        depth=depth_errors(depth, truth.depth, chosen),
        normals=normal_errors(normals, truth.normals, chosen),
    )


def evaluate(result: Result, truth: Truth, mask: Mask | None = None) -> Evaluation:
    """Scores of a result's depth, in millimetres, and of its normals, in degrees, against `truth`.

    truth : of the resolution of the result, from `load_truth` or `rakelight.synthetic`
    mask : (H, W) bool, the pixels that count; None stands for all of the truth's.  One without an
        estimate is charged the largest error, so leaving pixels out never helps

    Raises InputError where these are no Result and Truth, sizes differ, the mask is empty or leaves
    the truth.

    >>> from rakelight.model import Lights
    >>> facing = np.full((2, 2, 3), [0.0, 0.0, -1.0])
    >>> truth = Truth(np.ones((2, 2)), facing, np.ones((2, 2, 3)))
    >>> result = Result(truth.depth + 0.003, facing, truth.albedo, truth.depth,
    ...                 Lights(facing, truth.depth), Camera(2, 2, 2.0, 2.0, 0.5, 0.5), truth.depth,
    ...                 "none")
    >>> scores = evaluate(result, truth)
    >>> round(scores.depth.rmse_mm, 9), scores.normals.mae_deg, scores.depth.coverage
    (3.0, 0.0, 1.0)
    """
    remedy = "give what rakelight.refine or rakelight.load_result returned"
    check_is(result, Result, "result", remedy)
    return evaluate_maps(result.depth, result.normals, truth, mask)


def evaluate_depth(depth: Floats, camera: Camera, truth: Truth) -> Evaluation:
    """Scores of a depth map (H, W) metres alone, as of a result's: its normals are its own.

    camera : of the depth map; the normals are not taken across depth jumps.  Raises as
    `evaluate_maps`.

    >>> camera = Camera(2, 2, fx=2.0, fy=2.0, cx=0.5, cy=0.5)
    >>> truth = Truth(np.ones((2, 2)), np.full((2, 2, 3), [0.0, 0.0, -1.0]), np.ones((2, 2, 3)))
    >>> evaluate_depth(truth.depth, camera, truth).normals.mae_deg
    0.0
    """
    return evaluate_maps(depth, surface_normals(depth, truth.mask, camera), truth)


def depth_errors(depth_m: Floats, truth_m: Floats, mask: Mask) -> DepthErrors:
    """Errors of `depth_m` (H, W) against `truth_m` (H, W) over `mask` (H, W).

    Not finite, zero or negative depth is missing.  Raises InputError as `evaluate_maps` does.

    >>> depth_errors(np.array([[0.501, np.nan]]), np.array([[0.5, 0.5]]), np.array([[True, True]]))
    DepthErrors(rmse_mm=35.36..., median_mm=25.5..., p95_mm=47.5..., coverage=0.5)
    """
    errors = depth_error_map_mm(depth_m, truth_m, mask)[mask]
    return DepthErrors(
        rmse_mm=float(np.sqrt(np.mean(errors**2))),
        median_mm=float(np.median(errors)),
        p95_mm=float(np.quantile(errors, 0.95)),
        coverage=float(np.mean(_has_depth(depth_m)[mask])),
    )


def normal_errors(normals: Floats, truth_normals: Floats, mask: Mask) -> NormalErrors:
    """Angles between `normals` and `truth_normals`, both (H, W, 3), over `mask` (H, W).

    Vectors need not be of unit length; not finite or zero ones are missing.  Raises InputError
    as `evaluate_maps` does.

    >>> facing, level, mask = [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], np.ones((1, 2), bool)
    >>> normal_errors(np.array([[facing, level]]), np.array([[facing, facing]]), mask)
    NormalErrors(mae_deg=45.0, median_deg=45.0, p95_deg=85.5, coverage=1.0)
    """
    errors = normal_error_map_deg(normals, truth_normals, mask)[mask]
    return NormalErrors(
        mae_deg=float(np.mean(errors)),
        median_deg=float(np.median(errors)),
        p95_deg=float(np.quantile(errors, 0.95)),
        coverage=float(np.mean(_has_normal(normals)[mask])),
    )


def depth_error_map_mm(depth_m: Floats, truth_m: Floats, mask: Mask) -> Floats:
    """(H, W) error of each pixel in millimetres, cut off and charged as scored; NaN off the mask.

    >>> truth, mask = np.full((1, 2), 0.5), np.array([[True, False]])
    >>> depth_error_map_mm(truth + 0.002, truth, mask)
    array([[ 2., nan]])
    """
    require_numbers("depth", depth_m, truth_m)
    _check("depth", depth_m, truth_m, mask, np.isfinite(truth_m))
    charge = DEPTH_CHARGE * np.asarray(truth_m, float)
    with np.errstate(invalid="ignore"):
        off = np.abs(np.asarray(depth_m, float) - truth_m)
    error = np.where(_has_depth(depth_m), np.minimum(off, charge), charge)
    return np.where(mask, 1000 * error, np.nan)


def normal_error_map_deg(normals: Floats, truth_normals: Floats, mask: Mask) -> Floats:
    """(H, W) angle to the true normal in degrees, charged as scored; NaN off the mask.

    >>> facing = np.array([[[0.0, 0.0, -1.0]]])
    >>> normal_error_map_deg(np.array([[[0.0, 1.0, -1.0]]]), facing, np.ones((1, 1), bool)).round(9)
    array([[45.]])
    """
    require_numbers("normals", normals, truth_normals)
    _check("normals", normals, truth_normals, mask, _has_normal(truth_normals))
    present = mask & _has_normal(normals)
    a, b = np.asarray(normals, float)[present], np.asarray(truth_normals, float)[present]
    a /= np.abs(a).max(axis=-1, keepdims=True)  # no under- or overflow in the products
    errors = np.where(mask, NORMAL_CHARGE_DEG, np.nan)
    # atan2 keeps small angles, where arccos of the dot product loses half the digits
    crossed = np.linalg.norm(np.cross(a, b), axis=-1)
    errors[present] = np.degrees(np.arctan2(crossed, np.sum(a * b, axis=-1)))
    return errors


def _has_depth(depth_m: Floats) -> Mask:
    return np.isfinite(depth_m) & (np.asarray(depth_m) > 0)


def _has_normal(normals: Floats) -> Mask:
    return np.asarray(np.isfinite(normals).all(axis=-1) & (np.asarray(normals) != 0).any(axis=-1))


def _check(name: str, estimate: Floats, truth: Floats, mask: Mask, truth_mask: Mask) -> None:
    if not isinstance(mask, np.ndarray):
        raise InputError(
            "the mask is no array",
            source="mask",
            seen=type(mask).__name__,
            needed="a numpy.ndarray, (H, W) bool",
        )
    if estimate.shape != truth.shape or mask.shape != truth_mask.shape:
        raise InputError(
            f"{name}, truth and mask are of different size",
            source=name,
            seen=f"{estimate.shape}, mask {mask.shape}",
            needed=f"{truth.shape}, mask {truth_mask.shape}",
            remedy="refine at the truth's resolution",
        )
    if mask.dtype != bool:
        raise InputError(
            "not a mask", source="mask", seen=str(mask.dtype), needed="bool", remedy="mask > 0"
        )
    if not mask.any():
        raise InputError(
            "the mask marks no pixel",
            source="mask",
            needed="at least one True",
            remedy="take the result's mask",
        )
    outside = np.count_nonzero(mask & ~truth_mask)
    if outside:
        raise InputError(
            "the mask reaches beyond the truth",
            source="mask",
            seen=f"{outside} pixels without true {name}",
            needed="none",
            remedy="intersect the mask with the truth's",
        )
