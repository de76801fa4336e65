"""Depth maps, from files or arrays, as shapes."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rakelight.capture.npy import npy_header
from rakelight.errors import InputError, parsing
from rakelight.files import read_bytes
from rakelight.geometry.camera import ALL, pixel_rays
from rakelight.geometry.grid import bounding_window
from rakelight.model import Array, Camera, Floats, Mask
from rakelight.synthetic.implicit import Surface
from rakelight.synthetic.shapes import Shape

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline as Spline


FARTHEST_M = 1000


def shape_from_file(
    path: str | PathLike[str], camera: Camera | None = None, focal_px: float = 3750.0
) -> Shape:
    """A depth map as a shape: cubic splines through log depth.

    path : .npz with `depth_mm` (H, W) millimetres and, if any, `mask` (H, W); or .tif/.tiff with
        (H, W) floating-point metres.  What is not between 0 and 1000 m is outside
    camera : that saw it; None for one with the principal point in the middle and `focal_px`
        (the default stands for 0.4 mm per pixel at 1.5 m)

    The object can be looked at from that camera's place only.  Arrays of objects (pickles) are
    refused, sizes are checked before anything is loaded.  Raises InputError, MachineError.
    """
    source = str(path)
    data = read_bytes(Path(path))
    kind = Path(path).suffix.lower()
    if kind == ".npz":
        depth_m = _depth_from_npz(data, source)
    elif kind in (".tif", ".tiff"):
        depth_m = _depth_from_tiff(data, source)
    else:
        raise InputError(
            "not a depth map that can be a shape", source=source, seen=kind, needed=".npz or .tiff"
        )
    seen_by = camera or _centred_camera(depth_m.shape, focal_px)
    if seen_by.shape != depth_m.shape:
        raise InputError(
            "the camera is for another size",
            source=source,
            seen=f"{depth_m.shape}",
            needed=f"{seen_by.shape}",
        )
    try:
        return shape_from_depth(Path(path).stem, depth_m, seen_by)
    except InputError as error:
        error.source = source
        raise


def shape_from_depth(name: str, depth_m: Floats, camera: Camera) -> Shape:
    """The surface of a depth map (H, W), metres, NaN outside, as `camera` saw it.

    Its view is cropped to the object, with sides that are multiples of 4 and a margin.  Raises
    InputError when there is too little depth for a surface.
    """
    with np.errstate(invalid="ignore"):
        mask = (depth_m > 0) & (depth_m < FARTHEST_M)
    if min(depth_m.shape) < 4 or not _whole_cells(mask).any():
        raise InputError(
            "too little depth for a surface",
            source=name,
            seen=f"{np.count_nonzero(mask)} pixels of {depth_m.shape}",
            needed=f"a connected area of depth between 0 and {FARTHEST_M} m",
        )
    rows, columns = bounding_window(mask)
    view = _with_margin(camera.cropped(rows, columns))
    return Shape(name, view, partial(_render_depth, _log_depth_spline(depth_m, mask), mask, camera))


def _with_margin(camera: Camera, margin: int = 8) -> Camera:
    """The camera with at least `margin` pixels more on each side and sides divisible by 4."""
    width, height = (-(-(side + 2 * margin) // 4) * 4 for side in (camera.width, camera.height))
    left, top = (width - camera.width) // 2, (height - camera.height) // 2
    return replace(camera, width=width, height=height, cx=camera.cx + left, cy=camera.cy + top)


def _centred_camera(shape: tuple[int, ...], focal_px: float) -> Camera:
    height, width = shape
    return Camera(width, height, focal_px, focal_px, (width - 1) / 2, (height - 1) / 2)


def _whole_cells(mask: Mask) -> Mask:
    """(H-1, W-1) True where all four corners are on the object."""
    return mask[1:, 1:] & mask[1:, :-1] & mask[:-1, 1:] & mask[:-1, :-1]


def _log_depth_spline(depth_m: Floats, mask: Mask) -> Spline:
    from scipy.interpolate import RectBivariateSpline

    log_depth = _continued(np.log(np.where(mask, depth_m, 1.0)), mask)
    rows, columns = (np.arange(float(side)) for side in mask.shape)
    return RectBivariateSpline(rows, columns, log_depth)


def _continued(values: Floats, measured: Mask, reach_px: float = 6.0) -> Floats:
    """`values` carried on beyond their rim with its slope, so that splines do not ring there.

    A pixel takes the value that mirrors, through the rim pixel nearest to it, one inside.
    """
    from scipy.ndimage import distance_transform_edt

    distance, rim = distance_transform_edt(~measured, return_indices=True)
    here = np.indices(measured.shape)
    sides = np.reshape(measured.shape, (2, 1, 1))
    inner = tuple(np.clip(2 * rim - here, 0, sides - 1))
    rim = tuple(rim)
    mirrored = 2 * values[rim] - values[inner]
    return np.asarray(np.where(measured[inner] & (distance < reach_px), mirrored, values[rim]))


def _render_depth(
    spline: Spline, mask: Mask, seen_by: Camera, camera: Camera, rows: slice = ALL
) -> Surface:
    """The spline at the rays of `camera`, which stands where `seen_by` did."""
    offset_x, offset_y = np.broadcast_arrays(*pixel_rays(camera, rows))
    x, y = offset_x * (seen_by.fx / camera.fx), offset_y * (seen_by.fy / camera.fy)
    u, v = x + seen_by.cx, y + seen_by.cy
    row, column = np.floor(v).astype(int), np.floor(u).astype(int)
    height, width = mask.shape
    inside = (row >= 0) & (row < height - 1) & (column >= 0) & (column < width - 1)
    inside[inside] = _whole_cells(mask)[row[inside], column[inside]]
    at = v[inside], u[inside]
    depth = np.full(u.shape, np.nan)
    depth[inside] = np.exp(spline.ev(*at))
    p_v, p_u = spline.ev(*at, dx=1), spline.ev(*at, dy=1)
    normals = np.full((*u.shape, 3), np.nan)
    outward = np.stack(
        [seen_by.fx * p_u, seen_by.fy * p_v, -(1 + x[inside] * p_u + y[inside] * p_v)], axis=-1
    )
    normals[inside] = outward / np.linalg.norm(outward, axis=-1, keepdims=True)
    return Surface(depth, normals)


def _depth_from_npz(data: bytes, source: str) -> Floats:
    with (
        parsing(source, "not a whole .npz archive"),
        zipfile.ZipFile(io.BytesIO(data)) as archive,
    ):
        _check_names(archive, source)
        depth_mm = _npz_array(archive, "depth_mm", source)
        has_mask = "mask.npy" in archive.namelist()
        mask = _npz_array(archive, "mask", source) != 0 if has_mask else np.isfinite(depth_mm)
    if mask.shape != depth_mm.shape:
        raise InputError(
            "depth and mask are of different size",
            source=source,
            seen=f"{mask.shape}",
            needed=f"{depth_mm.shape}",
        )
    return np.where(mask, depth_mm / 1000, np.nan)


def _check_names(archive: zipfile.ZipFile, source: str) -> None:
    for name in archive.namelist():
        if any(sign in name for sign in ("/", "\\", "..")):
            raise InputError(
                "an archive with paths in it", source=source, seen=name, needed="arrays only"
            )


def _npz_array(archive: zipfile.ZipFile, key: str, source: str) -> Floats:
    """One (H, W) array of numbers; its header is checked before its values are read."""
    if f"{key}.npy" not in archive.namelist():
        raise InputError(
            "an array is missing",
            source=source,
            seen=", ".join(archive.namelist()[:8]) or "an empty archive",
            needed=f"{key}.npy",
        )
    with archive.open(f"{key}.npy") as member:
        shape, fortran_order, dtype = npy_header(member, key, source)
        size = shape[0] * shape[1] * dtype.itemsize
        stated = archive.getinfo(f"{key}.npy").file_size - member.tell()
        values = member.read(size + 1) if stated == size else b""
    if len(values) != size:
        raise InputError(
            f"{key} is not of the size it states",
            source=source,
            seen=f"{stated} bytes",
            needed=f"{size} for {shape}",
        )
    array = np.frombuffer(values, dtype).reshape(shape, order="F" if fortran_order else "C")
    return _as_floats(array)


def _as_floats(values: Array) -> Floats:
    with np.errstate(invalid="ignore"):  # of NaN with unusual bits
        return values.astype(float)


def _depth_from_tiff(data: bytes, source: str) -> Floats:
    from rakelight.capture.headers import read_header
    from rakelight.capture.images import decode_image

    header = read_header(data, source)
    if header.channels != 1 or not header.dtype.startswith("float"):
        raise InputError(
            "not a depth map in metres",
            source=source,
            seen=str(header),
            needed="(H, W) floating point",
        )
    return _as_floats(decode_image(data, source))
