"""Whether a Capture made in Python holds what its fields promise, before it can do harm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from numbers import Integral, Real
from typing import Any, get_args

import numpy as np

from rakelight.capture import validate
from rakelight.capture.defaults import on_depth_grid
from rakelight.capture.lights import checked_lights
from rakelight.capture.no_distance import has_no_distances, mark_no_distances
from rakelight.errors import CaptureError, check_is
from rakelight.geometry.distortion import STEEPEST_RAY
from rakelight.geometry.finite import require_lights
from rakelight.model import (
    Array,
    Camera,
    Capture,
    Distortion,
    Encoding,
    Finding,
    Lighting,
    RigidTransform,
    SensorNoise,
    Truth,
    finite_number,
    photograph_names,
)

MAKE_A_CAMERA = "rakelight.Camera.from_matrix(K, (height, width)) makes one"


def checked_arrays(capture: Capture) -> Capture:
    """The capture with plain contiguous arrays, where every field is of its kind and size.

    Raises CaptureError, with what is needed, for arrays of another type, number of axes or size,
    for masked arrays, a camera without an image, names that are not as many as the photographs.
    An InputError where it is no Capture at all.

    >>> camera = Camera(8, 6, 10.0, 10.0, 3.5, 2.5)
    >>> checked_arrays(Capture(np.zeros((3, 6, 8, 3)), np.ones((1, 6, 8)), np.ones((6, 8)), camera))
    Traceback (most recent call last):
    rakelight.errors.CaptureError: photographs: not 8 or 16 bit (seen float64, needed uint8 or
    uint16). Fix: for values of 0 to 1: np.rint(65535 * photographs).astype(np.uint16)
    """
    check_is(capture, Capture, "capture", "load one with rakelight.load_capture")
    camera = capture.camera
    check_is(camera, Camera, "camera", MAKE_A_CAMERA)
    photographs = _plain(capture.photographs, "photographs", ("N", "H", "W", 3))
    if photographs.dtype not in (np.uint8, np.uint16):
        raise CaptureError(
            "not 8 or 16 bit",
            source="photographs",
            seen=str(photographs.dtype),
            needed="uint8 or uint16",
            remedy="for values of 0 to 1: np.rint(65535 * photographs).astype(np.uint16)"
            if photographs.dtype.kind == "f"
            else "photographs.astype(np.uint16), where all values are 0 to 65535",
        )
    depth_m = _plain(capture.depth_m, "depth_m", ("K", "h", "w"))
    if depth_m.dtype not in (np.float32, np.float64):
        raise CaptureError(
            "not metres in floating point",
            source="depth_m",
            seen=str(depth_m.dtype),
            needed="float32",
            remedy="(depth / values_per_metre).astype(np.float32), NaN where there is none",
        )
    mask = _plain(capture.mask, "mask", ("H", "W"))
    if mask.dtype != bool:
        raise CaptureError(
            "not true or false", source="mask", seen=str(mask.dtype), needed="bool",
            remedy="mask > 0",
        )  # fmt: skip
    _check_camera(camera, "camera")
    _check_fits("photographs", photographs, (len(photographs), *camera.shape, 3))
    _check_fits("mask", mask, camera.shape)
    for field, kind, remedy in (
        ("depth_camera", Camera, MAKE_A_CAMERA),
        ("depth_to_color", RigidTransform, "rakelight.RigidTransform(rotation, translation_m)"),
        ("depth_noise", SensorNoise, "rakelight.SensorNoise(sigma_m, at_m, growth)"),
    ):
        if (value := getattr(capture, field)) is not None:
            check_is(value, kind, field, remedy)
    _check_words(capture, len(photographs))
    lights = capture.lights
    if lights is not None:
        measured = depth_m[np.isfinite(depth_m)]
        middle_z_m = float(np.median(measured)) if measured.size else 0.0
        lights = checked_lights(lights, len(photographs), middle_z_m)
    exposures = tuple(map(float, capture.exposures))
    return replace(
        capture, photographs=photographs, depth_m=depth_m, mask=mask, lights=lights,
        exposures=exposures,
    )  # fmt: skip


def checked_capture(capture: Capture) -> Capture:
    """As `checked_arrays`; and what the capture says is plausible, as `load_capture` has it.

    Depth that is too near or too far to be a distance is NaN in it.  Raises CaptureError for an
    empty mask, the same photograph twice, depth that is not positive, hardly measured on the object
    or of several scenes, an implausible unit, depth camera or noise.

    >>> camera = Camera(8, 6, 10.0, 10.0, 3.5, 2.5)
    >>> checked_capture(Capture(np.zeros((3, 6, 8, 3), np.uint8), np.full((1, 6, 8), 600.0),
    ...                         np.ones((6, 8), bool), camera))
    Traceback (most recent call last):
    rakelight.errors.CaptureError: depth_m: the depth unit looks wrong (seen median depth 600 m,
    needed 0.05 to 20 m). Fix: divide the values by 1000 if they are ...
    """
    capture = checked_arrays(capture)
    factor = check_sensor(capture)
    depth_m = capture.depth_m
    holes = np.where(np.isfinite(depth_m), 0, validate.HOLES.index("not finite")).astype(np.uint8)
    marked = has_no_distances(depth_m)
    if marked:
        capture = replace(capture, depth_m=depth_m.copy())
        mark_no_distances(capture.depth_m, holes)
    found = check_object(capture, factor, holes)
    shown = photograph_names(capture.names, len(capture.photographs))
    validate.check_not_twice(capture.photographs, shown, "photographs")
    if not marked:  # whoever made the capture has said the rest
        return capture
    missing = tuple(each for each in found if each.code == "depth-missing")
    return replace(capture, findings=(*capture.findings, *missing))


def check_sensor(capture: Capture) -> float | None:
    """How many colour pixels a depth pixel has along each side; None for another camera's depth.

    capture : as `checked_arrays` returns it, its mask is not looked at

    Raises CaptureError for an implausible depth camera, pose or noise, or sizes that do not fit.
    """
    _check_depth_camera(capture)
    if capture.depth_noise is not None:
        validate.check_noise(capture.depth_noise, "depth_noise")
    if capture.depth_camera is None:
        h, w = capture.depth_m.shape[1:]
        return validate.depth_factor((h, w), capture.camera.shape, "depth_m")
    if capture.depth_to_color is not None:
        validate.check_transform(capture.depth_to_color, "depth_to_color")
    return None


def check_object(
    capture: Capture, factor: float | None, holes: Array, depth_names: Sequence[str] = ()
) -> tuple[Finding, ...]:
    """What a person should know of the mask and the depth on it.

    factor : of `check_sensor`; holes : (K, h, w) indices into validate.HOLES
    depth_names : of the maps, for messages

    Raises CaptureError for an empty mask, depth that is not positive, hardly measured on the
    object, in another unit, or that contradicts itself.
    """
    depth_m, mask = capture.depth_m, capture.mask
    findings = validate.check_mask(mask, "mask")
    least_m, most_m = validate.POSSIBLE_M
    impossible = ~(np.isnan(depth_m) | ((depth_m >= least_m) & (depth_m <= most_m)))
    if impossible.any():
        raise CaptureError(
            "depth that none can be",
            source="depth_m",
            seen=f"{depth_m[impossible][0]:g} and {np.count_nonzero(impossible) - 1} more",
            needed=f"{least_m:g} to {most_m:g} m, or NaN for no measurement",
            remedy="give metres, NaN for what is no distance: "
            f"depth_m[~((depth_m >= {least_m:g}) & (depth_m <= {most_m:g}))] = np.nan",
        )
    on_object = on_depth_grid(mask, factor, depth_m.shape[1:])
    return findings + validate.check_depth(depth_m, holes, on_object, "depth_m", None, depth_names)


def checked_truth(truth: Truth, shape: tuple[int, int]) -> None:
    """Raise CaptureError unless the maps of a truth are numbers of an image (height, width).

    An InputError where it is no Truth, or its lights are none.
    """
    check_is(truth, Truth, "truth")
    for name, channels in (("depth", ()), ("normals", (3,)), ("albedo", (3,))):
        source, needed = f"truth.{name}", (*shape, *channels)
        array = _plain(getattr(truth, name), source, ("H", "W", *channels))
        if array.shape != needed or array.dtype.kind not in "fiu":
            raise CaptureError(
                "this array does not fit the capture",
                source=source,
                seen=f"{array.shape} {array.dtype}",
                needed=f"{needed} float32",
                remedy="give the maps of this capture's photographs",
            )
    if truth.lights is not None:
        require_lights(truth.lights, "truth.lights")
        for each in fields(truth.lights):
            name, numbers = each.name, getattr(truth.lights, each.name)
            if numbers is not None and not np.isfinite(numbers).all():
                raise CaptureError(
                    "the lights are not finite", source=f"truth.lights.{name}",
                    needed="finite numbers", remedy="leave the lights out: lights=None",
                )  # fmt: skip


def require_plain(array: Any, name: str, fill: str, make: str) -> None:
    """Raise CaptureError unless it is a numpy.ndarray of values, not of objects, unmasked."""
    masked = isinstance(array, np.ma.MaskedArray)
    if masked or not isinstance(array, np.ndarray):
        raise CaptureError(
            "a masked array" if masked else "not an array",
            source=name,
            seen=type(array).__name__,
            needed="a numpy.ndarray",
            remedy=fill if masked else make,
        )
    if array.dtype.kind == "O":
        raise CaptureError(
            "an array of objects",
            source=name,
            seen=f"object, {array.shape}",
            needed="an array of numbers",
            remedy=f"np.stack({name}) of arrays of one size and type",
        )


def _plain(array: Array, name: str, axes: tuple[int | str, ...]) -> Array:
    """The array, contiguous and of no subclass, with these axes, none of them empty."""
    require_plain(array, name, "fill what is masked", f"np.asarray({name})")
    fits = array.ndim == len(axes) and 0 not in array.shape
    fits = fits and all(a == b for a, b in zip(axes, array.shape, strict=True) if a == 3)
    if not fits:
        raise CaptureError(
            "this array does not fit a capture: it has another shape",
            source=name,
            seen=str(array.shape),
            needed=f"({', '.join(map(str, axes))}), none of them 0",
            remedy="reshape it, or take one image out of it",
        )
    return np.ascontiguousarray(array, array.dtype.newbyteorder("="))


def _check_fits(name: str, array: Array, needed: tuple[int, ...]) -> None:
    if array.shape != needed:
        raise CaptureError(
            "this array does not fit the capture's camera",
            source=name,
            seen=str(array.shape),
            needed=str(needed),
            remedy="give the camera of these photographs, camera.resized(width, height) where "
            "they were resized",
        )


def _check_numbers(value: Any, source: str) -> None:
    """Every field of a Camera or a SensorNoise is a number, width and height whole ones."""
    for field in fields(value):
        if field.name == "distortion":
            continue
        number = getattr(value, field.name)
        kind = Integral if field.name in ("width", "height") else Real
        if not isinstance(number, kind) or not finite_number(number):
            raise CaptureError(
                f"{field.name} is not a number",
                source=source,
                seen=str(number),
                needed="a whole number" if kind is Integral else "a finite number",
                remedy="calibrate it, or read it from the camera",
            )


def _check_camera(camera: Camera, source: str, *, of_depth: bool = False) -> None:
    """of_depth : as of `validate.check_camera`."""
    _check_numbers(camera, source)
    for key in ("width", "height", "fx", "fy"):
        if getattr(camera, key) <= 0:
            raise CaptureError(
                f"{key} is not positive",
                source=source,
                seen=f"{getattr(camera, key):g}",
                needed="pixels above 0",
                remedy="give the sizes and focal lengths in pixels of this image",
            )
    rays = [
        max(abs(centre), abs(side - 1 - centre)) / length
        for side, centre, length in (
            (camera.width, camera.cx, camera.fx),
            (camera.height, camera.cy, camera.fy),
        )
    ]
    if max(rays) > STEEPEST_RAY or max(camera.fx, camera.fy) > 1e6:
        raise CaptureError(
            "focal length and principal point do not fit the image",
            source=source,
            seen=f"fx = {camera.fx:g}, fy = {camera.fy:g}, cx = {camera.cx:g}, "
            f"cy = {camera.cy:g} in {camera.width}x{camera.height}",
            needed="pixels of this image",
            remedy="give pixels: not millimetres, not fractions of a side",
        )
    validate.check_principal_point(camera, source)
    if camera.distortion is not None:
        remedy = "rakelight.Camera.from_matrix(K, (height, width), distortion) makes one"
        check_is(camera.distortion, Distortion, f"{source}.distortion", remedy)
        validate.check_distortion(camera, source, "distortion", folds=not of_depth)


def _check_depth_camera(capture: Capture) -> None:
    camera, pose, noise = capture.depth_camera, capture.depth_to_color, capture.depth_noise
    if camera is not None:
        _check_camera(camera, "depth_camera", of_depth=True)
        if capture.depth_m.shape[1:] != camera.shape:
            raise CaptureError(
                "this array does not fit the capture's depth camera",
                source="depth_m",
                seen=str(capture.depth_m.shape[1:]),
                needed=str(camera.shape),
                remedy="give the depth camera's own intrinsics and image size",
            )
        validate.check_depth_lens(camera, capture.depth_m, "depth_camera", "distortion")
    if pose is not None:
        if camera is None:
            raise CaptureError(
                "depth_to_color without depth_camera",
                source="depth_to_color",
                seen="no depth_camera",
                needed="both",
                remedy="give both, or neither when the depth is aligned to the colour",
            )
        for name, shape in (("rotation", (3, 3)), ("translation_m", (3,))):
            array = getattr(pose, name)
            numbers = isinstance(array, np.ndarray) and (
                array.dtype in (np.float32, np.float64) or array.dtype.kind in "iu"
            )
            if not numbers or array.shape != shape or not np.isfinite(array).all():
                seen = [str(getattr(array, key, "")) for key in ("shape", "dtype")]
                raise CaptureError(
                    f"{name} is not an array of finite numbers",
                    source="depth_to_color",
                    seen=" ".join([type(array).__name__, *seen]),
                    needed=f"a numpy.ndarray {shape}, float64",
                    remedy="X_color = rotation @ X_depth + translation_m, metres",
                )
    if noise is not None:
        _check_numbers(noise, "depth_noise")


def _check_words(capture: Capture, photographs: int) -> None:
    validate.check_word("encoding", capture.encoding, get_args(Encoding))
    validate.check_word("lighting", capture.lighting, get_args(Lighting))
    for name, values, kind, count in (
        ("names", capture.names, str, photographs),
        ("findings", capture.findings, Finding, None),
    ):
        fits = isinstance(values, tuple) and all(isinstance(value, kind) for value in values)
        if fits and count is not None and len(values) not in (0, count):
            raise CaptureError(
                f"not as many {name} as photographs",
                source=name,
                seen=f"{len(values)} for {count} photographs",
                needed=f"none or {count}",
                remedy="give one for each photograph, or leave them away",
            )
        if not fits:
            many = "" if count is None else f", none or {count}"
            raise CaptureError(
                f"not a tuple of {kind.__name__}",
                source=name,
                seen=f"{type(values).__name__} {str(values)[:80]}",
                needed=f"a tuple of {kind.__name__}{many}",
                remedy=f"give {name} as that, or leave it away",
            )
    validate.check_exposures(capture.exposures, photographs, "exposures")
    check_is(capture.source, str, "source", "name where the capture came from, or nothing")
    check_is(capture.register, bool, "register", "True or False")
