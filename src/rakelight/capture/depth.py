"""Depth files to metres.

One channel of PNG or TIFF.  16-bit integers need `depth_scale`; float is metres and admits no
other `depth_scale` than 1.  Zero, negative, NaN, infinity, the largest integer (a sensor's "too
far") and what rakelight.capture.no_distance finds are no measurement.
"""

from __future__ import annotations

import numpy as np

from rakelight.capture import validate
from rakelight.capture.config import CONFIG, CaptureTable
from rakelight.capture.headers import Header
from rakelight.capture.listing import Images, Root, allocate
from rakelight.capture.no_distance import mark_no_distances
from rakelight.errors import CaptureError
from rakelight.files import in_threads
from rakelight.model import Array, Camera, Floats, RigidTransform, SensorNoise

UNKNOWN_SENSOR = SensorNoise()
MILLIMETRE = 1e-3
ROUNDED = 1e-6  # of a scale whose reciprocal is no whole number


def check_depth_kind(depth: Images, table: CaptureTable, root: Root) -> None:
    """Every file is one channel of 16-bit or float depth, and depth_scale fits that."""
    for name, header in zip(depth.names, depth.headers, strict=True):
        check_depth_header(header, depth.shown(name))
    validate.check_same_kind(dict(zip(depth.names, depth.headers, strict=True)), depth.source)
    _check_depth_scale(depth, table.depth_scale, root.shown(CONFIG))


def check_depth_header(header: Header, source: str) -> None:
    """Raise CaptureError unless it is one channel of 16-bit or float depth."""
    if header.format == "JPEG":
        raise CaptureError(
            "JPEG cannot carry depth",
            source=source,
            seen="a JPEG, by its first bytes",
            needed="PNG or TIFF",
            remedy="export the depth as 16-bit PNG",
        )
    if header.channels != 1:
        raise CaptureError(
            "depth has one channel",
            source=source,
            seen=f"{header.channels} channels",
            remedy="export the depth itself, not a coloured picture of it",
        )
    refuse_8_bit(header.dtype, source)
    if header.dtype not in ("uint16", "int16", "float32", "float64"):
        raise CaptureError(
            "this kind of depth is not read",
            source=source,
            seen=header.dtype,
            needed="16-bit PNG or float TIFF",
            remedy="export the depth as 16-bit PNG, millimetres",
        )


def refuse_8_bit(dtype: str, source: str) -> None:
    """Raise CaptureError for depth of so few levels."""
    if dtype in ("uint8", "int8", "bool"):
        raise CaptureError(
            "256 levels cannot carry millimetres",
            source=source,
            seen="8-bit depth",
            needed="16-bit PNG or float TIFF",
            remedy="export the depth as 16-bit PNG",
        )


def _check_depth_scale(depth: Images, depth_scale: float | None, source: str) -> None:
    if depth_scale is not None and not (np.isfinite(depth_scale) and depth_scale > 0):
        raise CaptureError(
            "key 'depth_scale' is not positive",
            source=source,
            seen=f"{depth_scale:g}",
            needed="depth values per metre",
            remedy="depth_scale = 1000.0 where they are millimetres",
        )
    is_float = depth.headers[0].dtype.startswith("float")
    if is_float and depth_scale not in (None, 1.0):
        raise CaptureError(
            "key 'depth_scale' does not apply to float depth",
            source=source,
            seen=f"{depth_scale:g}",
            needed="metres in the files",
            remedy="remove the key; divide the files if they are not metres",
        )
    if not is_float and depth_scale is None:
        values = depth.read(0)
        values = values[values > 0]
        raise CaptureError(
            "key 'depth_scale' is missing",
            source=source,
            needed="depth values per metre, for integer depth",
            remedy=validate.plausible_scales(float(np.median(values))) if values.size else "",
        )


def depth_geometry(
    table: CaptureTable, shape: tuple[int, int], source: str
) -> tuple[Camera | None, RigidTransform | None]:
    """The depth camera and its place, None when depth is in the colour camera's frame."""
    if table.depth_intrinsics is None:
        if table.depth_to_color is not None:
            raise CaptureError(
                "[depth_to_color] without [depth_intrinsics]",
                source=source,
                remedy="give both, or neither when the depth is aligned to the colour",
            )
        return None, None
    camera = table.depth_intrinsics.camera("depth_intrinsics", source)
    validate.check_camera(camera, shape, source, "depth_intrinsics", of_depth=True)
    if table.depth_to_color is None:
        return camera, RigidTransform(np.eye(3), np.zeros(3))
    transform = RigidTransform(
        _numbers(table.depth_to_color.rotation, (3, 3), source, "depth_to_color.rotation"),
        _numbers(table.depth_to_color.translation, (3,), source, "depth_to_color.translation"),
    )
    validate.check_transform(transform, source)
    return camera, transform


def _numbers(values: object, shape: tuple[int, ...], source: str, key: str) -> Floats:
    try:
        numbers = np.array(values, np.float64).reshape(shape)
    except ValueError as error:
        raise CaptureError(
            f"key '{key}' has a wrong shape",
            source=source,
            needed="x".join(map(str, shape)) + " numbers",
            remedy="write all its numbers, rows first",
        ) from error
    if not np.isfinite(numbers).all():
        raise CaptureError(
            f"key '{key}' is not a number",
            source=source,
            seen=str(values),
            remedy="calibrate the two cameras again",
        )
    return numbers


def read_depth(
    depth: Images, depth_scale: float | None, camera: Camera | None = None, config: str = ""
) -> tuple[Floats, Array]:
    """Metres (K, h, w) float32 with NaN = no measurement, and why: (K, h, w) indices into
    rakelight.capture.validate.HOLES.

    camera : of its own, as the file `config` has it, whose lens is checked by what is measured
    """
    shape = (len(depth.names), *depth.shape)
    depth_m = allocate(shape, "float32", depth.source)
    holes = allocate(shape, "uint8", depth.source)

    def read(index: int) -> None:
        raw = depth.read(index)
        largest = np.iinfo(raw.dtype).max if raw.dtype.kind in "iu" else np.nan
        with np.errstate(over="ignore", invalid="ignore"):  # of wild values, NaN afterwards
            metres = (raw if depth_scale is None else raw / depth_scale).astype(np.float32)
            reasons = [raw == 0, raw < 0, raw == largest, ~np.isfinite(metres)]
        holes[index] = np.select(reasons, [1, 2, 3, 4], default=0)
        depth_m[index] = np.where(holes[index] > 0, np.float32(np.nan), metres)

    in_threads(read, range(len(depth.names)))
    mark_no_distances(depth_m, holes)
    if camera is not None:
        validate.check_depth_lens(camera, depth_m, config, "key 'depth_intrinsics.distortion'")
    return depth_m, holes


def depth_values(depth_m: Floats, depth_scale: float, noise: SensorNoise = UNKNOWN_SENSOR) -> Array:
    """uint16 values with 0 = no measurement, of depth that a sensor measured with such noise.

    Raises CaptureError when one does not fit, or the steps are coarser than the depth is precise.
    """
    measured = np.isfinite(depth_m) & (depth_m > 0)
    values = np.rint(np.where(measured, depth_m, 0) * float(depth_scale))
    largest = np.iinfo(np.uint16).max - 1  # the largest itself is read as "too far"
    if not ((values[measured] >= 1) & (values[measured] <= largest)).all():
        raise CaptureError(
            "the depth does not fit 16 bit at this scale",
            source="depth_scale",
            seen=f"{depth_m[measured].min():.3g} to {depth_m[measured].max():.3g} m "
            f"at {depth_scale:g} values per metre",
            needed=f"values from 1 to {largest}",
            remedy="choose another depth_scale, or none to write float TIFF",
        )
    if measured.any():
        _refuse_coarse_steps(float(np.median(depth_m[measured])), float(depth_scale), noise)
    return values.astype(np.uint16)


def _refuse_coarse_steps(median_m: float, depth_scale: float, noise: SensorNoise) -> None:
    """Raise CaptureError where rounding to 1 / depth_scale metres adds more noise than there is.

    Rounding to steps s has the standard deviation s / sqrt(12).  Millimetres are always taken:
    depth cameras store them, also where they measure more finely.
    """
    coarsest_m = max(MILLIMETRE, float(np.sqrt(12) * noise.at(np.array(median_m))))
    if depth_scale * coarsest_m < 1 - ROUNDED:
        raise CaptureError(
            "this scale rounds the depth to steps coarser than its own noise",
            source="depth_scale",
            seen=f"steps of {1000 / depth_scale:.3g} mm at a median depth of {median_m:.3g} m",
            needed=f"at most {1000 * coarsest_m:.3g} mm: {np.ceil(1 / coarsest_m):g} or more "
            "values per metre",
            remedy="choose a larger depth_scale, or none to write float TIFF",
        )
