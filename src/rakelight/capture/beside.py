"""Photographs in a folder, and what has to lie beside them: depth in metres, calibration, a mask.

Datasets with known lights hold neither depth nor, often, intrinsics: the user puts both there.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rakelight.capture.from_arrays import capture_from_arrays
from rakelight.capture.headers import Header, read_header
from rakelight.capture.images import as_rgb, decode_image
from rakelight.capture.listing import (
    check_numbers,
    check_photograph_kind,
    looked_at,
    read_photographs,
)
from rakelight.capture.loose_depth import MILLIMETRES
from rakelight.errors import CaptureError, named_in, parsing, printable
from rakelight.files import MAX_TEXT_BYTES, read_bytes
from rakelight.model import Array, Camera, Capture, Encoding, Finding, Floats, GivenLights

DEPTH_NAMES = ("depth.tiff", "depth.tif", "depth.png")
INTRINSICS_NAME = "K.txt"
MASK_NAME = "mask.png"


def capture_beside(
    folder: Path,
    names: Sequence[str],
    chosen: Sequence[int] | None,
    lights: GivenLights,
    encoding: Encoding | None,
) -> Capture:
    """The capture of photographs with known lights and the depth and calibration beside them.

    names : of all photographs, files of the folder itself; chosen : numbers of those to read
    Raises CaptureError where depth or calibration are missing, and for damaged files.
    """
    depth_m, assumed = _depth(folder)
    if chosen is not None:
        check_numbers(chosen, len(names))
        names, lights = [names[i] for i in chosen], lights.select(chosen)
    images = looked_at(folder, str(folder), names, ())
    check_photograph_kind(images)
    photographs = read_photographs(images)
    camera = _camera(folder, photographs.shape[1:3])
    mask = None
    if os.path.lexists(folder / MASK_NAME):
        mask = as_rgb(_image(folder, MASK_NAME)[1]).max(axis=-1)
    with named_in(str(folder)):
        capture = capture_from_arrays(
            photographs, depth_m, camera, mask=mask, encoding=encoding, lighting="moving-lamp",
            names=tuple(map(printable, names)), lights=lights,
        )  # fmt: skip
    findings = (*assumed, *capture.findings)
    return replace(capture, findings=findings, source=str(folder))


def _image(folder: Path, name: str) -> tuple[Header, Array]:
    source = f"{folder}/{printable(name)}"
    data = read_bytes(folder / name, source=source)
    return read_header(data, source), decode_image(data, source)


def _depth(folder: Path) -> tuple[Floats, tuple[Finding, ...]]:
    """(h, w) float32 metres, and a note where their unit is assumed."""
    present = [name for name in DEPTH_NAMES if os.path.lexists(folder / name)]
    if len(present) != 1:
        raise CaptureError(
            "photographs and lights, but not one depth map" if not present else "two depth maps",
            source=str(folder),
            seen=", ".join(present),
            needed="depth.tiff beside the photographs: floating point, metres along the optical "
            "axis, of the whole field of view, or depth.png: 16 bit, millimetres",
            remedy="put the depth camera's map there" if not present else "keep one of them",
        )
    header, values = _image(folder, present[0])
    source = f"{folder}/{present[0]}"
    if header.channels != 1 or header.dtype not in ("uint16", "float32", "float64"):
        raise CaptureError(
            "this kind of depth is not read", source=source, seen=str(header),
            needed="one channel, 16-bit integers or floating point",
        )  # fmt: skip
    if header.dtype != "uint16":
        return values, ()
    largest = np.iinfo(np.uint16).max
    depth_m = np.where(values == largest, 0, values / MILLIMETRES).astype(np.float32)
    middle_m = float(np.median(depth_m[depth_m > 0])) if (depth_m > 0).any() else 0.0
    message = f"integer depth counts as millimetres: median depth {middle_m:.3g} m"
    return depth_m, (Finding("note", "depth-unit-assumed", message, "give depth.tiff in metres"),)


def _camera(folder: Path, shape: tuple[int, int]) -> Camera:
    """The camera of K.txt: three lines of three numbers, pixels."""
    source = f"{folder}/{INTRINSICS_NAME}"
    if not os.path.lexists(folder / INTRINSICS_NAME):
        raise CaptureError(
            "no intrinsics: how large a pixel is on the object is not known without them",
            source=str(folder),
            needed=f"{INTRINSICS_NAME} beside the photographs: fx 0 cx, 0 fy cy, 0 0 1 in pixels, "
            "pixel centres at integers from 0",
            remedy="calibrate the camera; of a far one without perspective, fx = fy = distance "
            "over the size of a pixel on the object",
        )
    data = read_bytes(folder / INTRINSICS_NAME, source=source, max_bytes=MAX_TEXT_BYTES // 1000)
    with parsing(source, "not a calibration matrix", CaptureError):
        words = data.decode("utf-8-sig").replace(",", " ").replace(";", " ").split()
        matrix = np.array([float(word) for word in words])
    if matrix.size != 9:
        raise CaptureError(
            "not a calibration matrix", source=source, seen=f"{matrix.size} numbers",
            needed="three lines of three",
        )  # fmt: skip
    with named_in(source):
        return Camera.from_matrix(matrix.reshape(3, 3), shape)
