"""A Capture from numpy arrays: what they may be, and what is said of those that do not fit.

The rules are those of the capture folder, so that the same pixels give the same capture.  Nothing
of the caller's is kept or changed: the capture's arrays are copies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from rakelight.capture import validate
from rakelight.capture.ambient_and_flat import corrected
from rakelight.capture.arrays import (
    MAKE_A_CAMERA,
    check_object,
    check_sensor,
    checked_arrays,
    require_plain,
)
from rakelight.capture.defaults import chosen_encoding, chosen_lighting, object_mask
from rakelight.capture.listing import allocate
from rakelight.capture.no_distance import mark_no_distances
from rakelight.capture.white_level import WHITE_16_BIT, stretched
from rakelight.errors import CaptureError, InputError, check_is
from rakelight.model import (
    Array,
    Camera,
    Capture,
    Encoding,
    Finding,
    Floats,
    GivenLights,
    Lighting,
    Mask,
    RigidTransform,
    SensorNoise,
    photograph_names,
)

_SAY_ENCODING = 'give encoding="linear" or "srgb", or write it into the capture.toml of `import`'


def capture_from_arrays(
    photographs: Array,
    depth: Floats,
    camera: Camera,
    *,
    mask: Array | None = None,
    encoding: Encoding | None = None,
    lighting: Lighting | None = None,
    names: Sequence[str] = (),
    depth_camera: Camera | None = None,
    depth_to_color: RigidTransform | None = None,
    depth_noise: SensorNoise | None = None,
    register: bool = False,
    ambient: Array | None = None,
    flat: Array | None = None,
    lights: GivenLights | None = None,
    exposures: Sequence[float] = (),
    depth_names: Sequence[str] = (),
    picture_names: tuple[str, str] = ("ambient", "flat"),
) -> Capture:
    """What `Capture.from_arrays` says; its docstring has the parameters and the errors.

    depth_names, picture_names : of the depth maps, and of `ambient` and `flat`, for messages

    >>> capture_from_arrays(np.zeros((4, 6, 3)), np.full((4, 6), 600), Camera(6, 4, 9, 9, 2.5, 1.5))
    Traceback (most recent call last):
    rakelight.errors.CaptureError: depth: whole numbers without a unit (seen int64, needed metres
    in floating point). Fix: depth / 1000.0, if they are millimetres
    """
    check_is(camera, Camera, "camera", MAKE_A_CAMERA)
    _refuse_exchanged(photographs, depth)
    pixels, kind = _photographs(photographs)
    depth_m, holes = _depth(depth)
    stated, assumed = chosen_encoding(encoding, kind, _SAY_ENCODING)
    room = _picture(ambient, picture_names[0], kind)
    white = _picture(flat, picture_names[1], kind)
    if kind == "16-bit":  # of floating point, 1 is white
        assumed += stretched(pixels, room, white)
    if room is not None or white is not None:
        pixels, light = corrected(pixels, stated, room, white, picture_names)
        stated, assumed = "linear", (*assumed, *light)
    capture = Capture(
        photographs=pixels,
        depth_m=depth_m,
        mask=np.ones(pixels.shape[1:3], bool),
        camera=camera,
        encoding=stated,
        lighting=chosen_lighting(lighting, len(pixels)),
        depth_camera=depth_camera,
        depth_to_color=depth_to_color,
        depth_noise=depth_noise,
        register=bool(register) if isinstance(register, np.bool_) else register,
        names=_as_tuple(names),
        lights=lights,
        exposures=_as_tuple(exposures),
    )
    with _named_as_arguments():
        capture = checked_arrays(capture)
        factor = check_sensor(capture)
        shown = photograph_names(capture.names, len(pixels))
        validate.check_not_twice(pixels, shown, "photographs")
        marked, found = _marked(capture, mask)
        capture = replace(capture, mask=marked)
        object_findings = check_object(capture, factor, holes, depth_names)
        subtracted = "" if ambient is None else picture_names[0]
        exposed = validate.check_exposure(pixels, capture.mask, shown, "photographs", subtracted)
        off_centre = validate.principal_point_finding(camera)
    return replace(capture, findings=(*assumed, *off_centre, *found, *object_findings, *exposed))


@contextmanager
def _named_as_arguments() -> Iterator[None]:
    """Errors about the field depth_m name the argument that it was made of."""
    try:
        yield
    except InputError as error:
        error.source = "depth" if error.source == "depth_m" else error.source
        raise


def _as_tuple(values: Sequence[Any] | Array) -> Any:
    """The values of a sequence or an array as a tuple; text and anything else as it is."""
    if isinstance(values, np.ndarray):
        return tuple(values.tolist()) if values.ndim else values
    listed = isinstance(values, Sequence) and not isinstance(values, str | bytes)
    return tuple(values) if listed else values


def _refuse_exchanged(photographs: Any, depth: Any) -> None:
    """Raise CaptureError where the first array is depth and the second photographs."""
    first: tuple[int, ...] = getattr(photographs, "shape", ())
    second: tuple[int, ...] = getattr(depth, "shape", ())
    in_colour = len(second) in (3, 4) and second[-1] == 3
    if in_colour and len(first) in (2, 3) and first[-1] != 3:
        raise CaptureError(
            "photographs and depth look exchanged",
            source="photographs",
            seen=f"photographs {first}, depth {second}",
            needed="photographs (N, H, W, 3), depth (h, w) or (K, h, w)",
            remedy="Capture.from_arrays(photographs, depth, camera)",
        )


def _photographs(photographs: Any) -> tuple[Array, str]:
    """A copy (N, H, W, 3) as uint8 or uint16, and the kind: "8-bit", "16-bit" or "float"."""
    require_plain(photographs, "photographs", "photographs.filled(0)", "np.stack(photographs)")
    images = photographs[None] if photographs.ndim == 3 else photographs
    if images.ndim != 4 or images.shape[-1] != 3 or 0 in images.shape:
        raise CaptureError(
            "not photographs in colour",
            source="photographs",
            seen=str(photographs.shape),
            needed="(N, H, W, 3) or (H, W, 3), none of them 0",
            remedy=_colour_remedy(photographs.shape),
        )
    if images.dtype.kind == "f":
        return _sixteen_bit(images), "float"
    if images.dtype.kind != "u" or images.dtype.itemsize > 2:
        raise CaptureError(
            "this kind of photograph is not read",
            source="photographs",
            seen=str(images.dtype),
            needed="uint8, uint16, or floating point from 0 to 1",
            remedy="photographs.astype(np.uint16), where all values are 0 to 65535"
            if images.dtype.kind in "iu"
            else "give the values that the camera's image files hold",
        )
    bits = 8 * images.dtype.itemsize
    copied = allocate(images.shape, f"uint{bits}", "photographs")
    copied[:] = images
    return copied, f"{bits}-bit"


def _picture(picture: Any, name: str, kind: str) -> Array | None:
    """One picture (H, W, 3) as `_photographs` takes them, of their kind; None for none."""
    if picture is None:
        return None
    try:
        images, own = _photographs(picture)
    except InputError as error:
        error.source = name
        if name.isidentifier():
            error.remedy = error.remedy.replace("photographs", name)
        raise
    if (own, kind) == ("float", "8-bit"):
        raise CaptureError(
            "not as the photographs are",
            source=name,
            seen=str(picture.dtype),
            needed="uint8",
            remedy=f"np.rint(255 * {name}).astype(np.uint8), if its 1 is their 255",
        )
    return images[0] if len(images) == 1 else images


def _colour_remedy(shape: tuple[int, ...]) -> str:
    if len(shape) in (3, 4) and shape[-1] == 4:
        return "photographs[..., :3] drops the alpha channel"
    if len(shape) in (3, 4) and shape[-1] == 1:
        return "np.repeat(photographs, 3, axis=-1) makes colour of grey"
    if len(shape) in (3, 4) and shape[-3] == 3:
        return "np.moveaxis(photographs, -3, -1) puts the channels last"
    if len(shape) in (2, 3) and 0 not in shape:
        return "np.repeat(photographs[..., None], 3, axis=-1) makes colour of grey"
    return "np.stack([first, second, ...]) of images (H, W, 3) of one size"


def _sixteen_bit(images: Floats) -> Array:
    """(N, H, W, 3) uint16 of values from 0 to 1: round(65535 value); raises CaptureError."""
    bad = sum(int(np.count_nonzero(~np.isfinite(image))) for image in images)
    if bad:
        raise CaptureError(
            "values that are not finite",
            source="photographs",
            seen=f"{bad} of them",
            needed="0 to 1",
            remedy="np.nan_to_num(photographs, nan=0, posinf=1, neginf=0): 0 and 1 are left out as "
            "black and saturated",
        )
    low, high = float(images.min()), float(images.max())
    if low < 0 or high > 1:
        raise CaptureError(
            "values beyond 0 to 1",
            source="photographs",
            seen=f"{low:g} to {high:g}",
            needed="0 (black) to 1 (saturated)",
            remedy=_range_remedy(low, high),
        )
    stored = allocate(images.shape, "uint16", "photographs")
    for into, image in zip(stored, images, strict=True):
        into[:] = np.rint(WHITE_16_BIT * image.astype(np.float64))
    return stored


def _range_remedy(low: float, high: float) -> str:
    if 2 < high <= 255:
        return "photographs / 255, if 255 is white; or photographs.astype(np.uint8)"
    if 255 < high <= WHITE_16_BIT:
        return "photographs / the camera's white level, such as 4095 or 65535"
    black = "below the black level is no light" if low < 0 else ""
    white = "what is brighter than white is saturated" if high > 1 else ""
    why = " and ".join(filter(None, (black, white)))
    return f"np.clip(photographs, 0, 1): {why}"


def _depth(depth: Any) -> tuple[Floats, Array]:
    """Metres (K, h, w) float32, NaN = no measurement, and why: indices into validate.HOLES."""
    require_plain(depth, "depth", "depth.filled(np.nan)", "np.asarray(depth)")
    if depth.dtype.kind in "iu":
        raise CaptureError(
            "whole numbers without a unit",
            source="depth",
            seen=str(depth.dtype),
            needed="metres in floating point",
            remedy="depth / 1000.0, if they are millimetres",
        )
    if depth.dtype.kind != "f" or depth.dtype.itemsize < 4:
        raise CaptureError(
            "this kind of depth is not read",
            source="depth",
            seen=str(depth.dtype),
            needed="metres as float32 or float64",
            remedy="depth.astype(np.float32); float16 holds steps of half a millimetre at best"
            if depth.dtype.kind == "f"
            else "give the depth itself, in metres",
        )
    depth = np.asarray(depth)  # a matrix has two axes always
    maps = depth[None] if depth.ndim == 2 else depth
    if maps.ndim != 3 or 0 in maps.shape or (depth.ndim == 3 and depth.shape[-1] in (1, 3)):
        one = depth.ndim in (3, 4) and depth.shape[-1] == 1
        raise CaptureError(
            "not depth maps",
            source="depth",
            seen=str(depth.shape),
            needed="(h, w) or (K, h, w), none of them 0",
            remedy="depth[..., 0]" if one else "give the depth itself, one channel, metres",
        )
    with np.errstate(over="ignore", invalid="ignore"):  # of wild values, not finite afterwards
        depth_m = maps.astype(np.float32)
        codes = [validate.HOLES.index(hole) for hole in ("zero", "negative", "not finite")]
        holes = np.select([depth_m == 0, depth_m < 0, ~np.isfinite(depth_m)], codes, default=0)
    _refuse_negative(depth_m)
    depth_m[holes > 0] = np.nan
    holes = holes.astype(np.uint8)
    mark_no_distances(depth_m, holes)
    return depth_m, holes


def _refuse_negative(depth_m: Floats) -> None:
    """Raise CaptureError where all of the depth (K, h, w) is negative: another frame's z.

    Beside positive depth, negative values are holes, and may be most of them: -1, -9999.
    """
    nonzero_m = depth_m[np.isfinite(depth_m) & (depth_m != 0)]
    if nonzero_m.size and np.mean(nonzero_m > 0) < validate.LEAST_MEASURED:
        raise CaptureError(
            "negative depth",
            source="depth",
            seen=f"median {float(np.median(nonzero_m.astype(np.float64))):.3g} m",
            needed="metres along the optical axis, positive",
            remedy="-depth, if z points backwards in its frame",
        )


def _marked(capture: Capture, mask: Any) -> tuple[Mask, tuple[Finding, ...]]:
    """The object's mask: the one given, or what is nearest; and what is to say of it."""
    if mask is None:
        return object_mask(capture, "depth", "check depth_camera and depth_to_color")
    marked = _mask(mask, capture.camera.shape)
    return marked, validate.soft_mask_findings(np.asarray(mask), marked, "mask")


def _mask(mask: Any, shape: tuple[int, ...]) -> Mask:
    """(H, W) bool of any numbers; raises CaptureError unless it has the photographs' `shape`."""
    require_plain(mask, "mask", "mask.filled(0)", "np.asarray(mask)")
    if mask.dtype.kind not in "biuf":
        raise CaptureError(
            "not a mask",
            source="mask",
            seen=str(mask.dtype),
            needed="bool or numbers, non-zero = object",
            remedy="mask != 0, or whatever marks the object",
        )
    if mask.shape != shape:
        height, width = shape
        remedy = (
            f"resize it: cv2.resize(mask, ({width}, {height}), interpolation=cv2.INTER_NEAREST)"
        )
        if mask.ndim == 3:
            remedy = f"mask.any(axis={0 if mask.shape[1:] == shape else -1})"
        elif mask.shape == (width, height):
            remedy = "mask.T"
        raise CaptureError(
            "the mask has another size than the photographs",
            source="mask",
            seen=str(mask.shape),
            needed=f"{shape}",
            remedy=remedy,
        )
    if np.isnan(mask).any():
        raise CaptureError(
            "a mask with holes",
            source="mask",
            seen=f"{int(np.count_nonzero(np.isnan(mask)))} NaN",
            needed="bool or numbers, non-zero = object",
            remedy="np.nan_to_num(mask)",
        )
    return np.asarray(mask != 0)
