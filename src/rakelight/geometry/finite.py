"""A result is finite: everything inside the object, and nothing but NaN or 0 outside."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rakelight.errors import InputError, check_is
from rakelight.geometry.camera import require_ideal
from rakelight.geometry.grid import all_finite, row_strips
from rakelight.model import Camera, Finding, Floats, Lights, Mask, Result

SIGMAS = ("depth_sigma", "normal_sigma")
"""The expected errors of a result, which not every method gives."""

MAPS = ("depth", "normals", "albedo", "confidence", "prepared_depth", *SIGMAS)
"""The images of a result."""


def only_finite(result: Result, mask: Mask | None = None) -> Result:
    """`result` with NaN depth and normals and zero albedo and confidence outside the object.

    Its maps are float32, as they are written: what that cannot hold is not finite.

    mask : (H, W) the object as it was refined; None for the pixels whose depth is not NaN

    A pixel whose depth or normal cannot be used leaves the object, an albedo or confidence that
    is not finite becomes 0; both are counted in a finding, and the result is then not converged.

    Raises InputError when something is no array of numbers, the arrays differ in size, or nothing
    usable is left.
    """
    _check_sizes(result)
    result = _single_precision(result)
    if _is_clean(result, mask):
        return result
    with np.errstate(invalid="ignore"):
        inside = np.isfinite(result.depth) & (result.depth > 0)
    inside &= all_finite(result.normals)
    if not inside.any():
        raise InputError(
            f"no pixel has a finite depth and normal by {result.method}",
            source=result.source,
            remedy="look for outliers in the depth on the object, and check the mask",
        )
    shown = all_finite(result.albedo) & np.isfinite(result.confidence)
    bad = _object(result.depth, mask) & ~(inside & shown)
    lights_bad = not _are_finite(result.lights)
    findings, converged = result.findings, result.converged
    if bad.any() or lights_bad:
        findings, converged = (*findings, _finding(int(bad.sum()), lights_bad)), False
    return replace(
        result,
        depth=np.where(inside, result.depth, np.nan),
        prepared_depth=_inside(result.prepared_depth, inside),
        normals=np.where(inside[..., None], result.normals, np.nan),
        albedo=np.where((inside & shown)[..., None], result.albedo, 0),
        confidence=np.where(inside & shown, result.confidence, 0),
        depth_sigma=None if result.depth_sigma is None else _inside(result.depth_sigma, inside),
        normal_sigma=None if result.normal_sigma is None else _inside(result.normal_sigma, inside),
        findings=findings,
        converged=converged,
    )


def _are_finite(lights: Lights) -> bool:
    """Whether all numbers of the lights are finite; places may be missing."""
    direction = lights.ambient_direction
    given = (lights.vector, lights.ambient, *(() if direction is None else (direction,)))
    return all(bool(np.isfinite(each).all()) for each in given)


def _single_precision(result: Result) -> Result:
    """The maps as float32; those that are so already are not copied."""
    maps: dict[str, Any] = {name: getattr(result, name) for name in MAPS}
    with np.errstate(over="ignore"):
        for name, given in maps.items():
            if given is not None:
                maps[name] = given.astype(np.float32, copy=False)
    return replace(result, **maps)


def _object(depth: Floats, mask: Mask | None) -> Mask:
    """The mask, or where there is none, where the depth is not NaN."""
    return ~np.isnan(depth) if mask is None else mask


def _is_clean(result: Result, mask: Mask | None) -> bool:
    """Whether all is as `only_finite` would make it; looked at in strips, without copies."""
    if not _are_finite(result.lights):
        return False
    seen = False
    for rows in row_strips(len(result.depth)):
        depth, albedo, confidence = (
            each[rows] for each in (result.depth, result.albedo, result.confidence)
        )
        inside = _object(depth, None if mask is None else mask[rows])
        outside, sigmas = ~inside, (result.depth_sigma, result.normal_sigma)
        seen |= bool(inside.any())
        with np.errstate(invalid="ignore"):
            good = np.isfinite(depth) & (depth > 0)
        clean = (
            (good == inside).all()
            and (all_finite(result.normals[rows]) == inside).all()
            and np.isnan(result.normals[rows][outside]).all()
            and np.isnan(result.prepared_depth[rows][outside]).all()
            and not np.isinf(result.prepared_depth[rows]).any()
            and np.isfinite(albedo).all()
            and np.isfinite(confidence).all()
            and not albedo[outside].any()
            and not confidence[outside].any()
            and all(
                each is None
                or (np.isnan(each[rows][outside]).all() and not np.isinf(each[rows]).any())
                for each in sigmas
            )
        )
        if not clean:
            return False
    return seen


def _inside(sigma: Floats, inside: Mask) -> Floats:
    """A prepared depth or expected error (H, W), NaN outside and where it is not finite."""
    return np.where(inside & np.isfinite(sigma), sigma, np.nan)


def _finding(pixels: int, lights_bad: bool) -> Finding:
    parts = [f"{pixels} pixels"] if pixels else []
    parts += ["the lights"] if lights_bad else []
    return Finding(
        "warning",
        "not-finite",
        f"not finite, and left out: {' and '.join(parts)}",
        "do not rely on this result; report the capture that led to it",
    )


def require_numbers(name: str, *arrays: Floats) -> None:
    """Raise InputError for what is no array of real numbers."""
    for array in arrays:
        if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu" or not array.ndim:
            raise InputError(
                f"{name} is no array of numbers",
                source=name,
                seen=f"{type(array).__name__} {getattr(array, 'dtype', '')}".strip(),
                needed="a numpy.ndarray of floats",
            )


def require_lights(lights: Lights, source: str) -> None:
    """Raise InputError unless the arrays of lights are numbers of N lights, 1 or more."""
    check_is(lights, Lights, source)
    given = np.shape(lights.ambient)
    each = (max(given[0], 1) if given else 1, 3 if given[1:] == (3,) else 1)
    sizes: dict[str, tuple[int, ...]] = {
        "ambient": each,
        "vector": (*each, 3),
        "position_m": (*each, 3),
        "middle_m": (3,),
        "beam": (*each, 3),
        "ambient_direction": (3,),
    }
    for name, size in sizes.items():
        array = getattr(lights, name)
        if array is None and name not in ("ambient", "vector"):
            continue
        require_numbers(f"{source}.{name}", array)
        if array.shape != size:
            raise InputError(
                "not the numbers of N lights with 1 or 3 channels each",
                source=f"{source}.{name}",
                seen=str(array.shape),
                needed=str(size),
            )


def _check_sizes(result: Result) -> None:
    """Raise InputError unless every map has the camera's size, and every light its name or none."""
    check_is(result.camera, Camera, "camera")
    require_ideal(result.camera, "result.camera")
    require_lights(result.lights, "lights")
    shape = result.camera.shape
    for name in MAPS:
        given = getattr(result, name)
        if given is None and name in SIGMAS:
            continue
        needed = (*shape, 3) if name in ("normals", "albedo") else shape
        require_numbers(name, given)
        if given.shape != needed:
            raise InputError(
                "an array of the result has another size than its camera",
                source=name,
                seen=str(given.shape),
                needed=str(needed),
            )
    names, lights = result.photograph_names, result.lights
    if names and len(names) != len(lights):
        raise InputError(
            "not a name for each light", source="photograph_names", seen=f"{len(names)} names",
            needed=f"{len(lights)}, or none",
        )  # fmt: skip
