"""Result folders read back as the Result that was written."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path

import msgspec
import numpy as np

from rakelight.capture.headers import read_header
from rakelight.capture.images import decode_image
from rakelight.errors import InputError
from rakelight.export.lights import parse_lights
from rakelight.export.summary import MARKER, Summary, parse_summary, told
from rakelight.files import MAX_TEXT_BYTES, as_path, clear_errors, read_bytes
from rakelight.folders import put_back
from rakelight.model import Array, Floats, Lights, Result
from rakelight.prepare.linear import to_linear

FLOAT32, UINT16, UINT8 = np.dtype(np.float32), np.dtype(np.uint16), np.dtype(np.uint8)


def load_result(folder: str | PathLike[str]) -> Result:
    """Read a result folder; nothing in it is changed.

    folder : as `rakelight refine` or `rakelight.save_result` wrote it.  An older one
        that a killed run had moved aside is put back first

    Returns the Result with every field.  Exact are depth, normals, prepared_depth, their expected
    errors (None where the method gave none), camera, findings and all numbers of result.json.  As
    precise as their files are

    - albedo: 16-bit sRGB, to 2e-5, and nothing above 1 (its 99th percentile is 1)
    - confidence: 8 bits, to 0.002
    - lights: to rounding; a distant lamp among near ones stands at `FARTHEST_M` again
    - options: a tuple comes back as a list; a number that was not finite as None, elsewhere as NaN

    The folder does not say what truth its report was compared with.

    Raises InputError when `folder` is not a result, or one of these files is missing, damaged or of
    another result; it names the file.  MachineError when one cannot be read.
    """
    folder = put_back(as_path(folder, "folder"))
    summary = read_summary(folder)
    camera = summary.camera.as_camera()
    shape, files = camera.shape, _Files(folder)
    white, one = summary.conventions.albedo_white, summary.conventions.confidence_one
    return Result(
        depth=files.image("depth.tiff", shape, FLOAT32),
        normals=files.image("normals.tiff", (*shape, 3), FLOAT32),
        albedo=_linear(files.image("albedo.png", (*shape, 3), UINT16), white),
        confidence=files.image("confidence.png", shape, UINT8).astype(np.float32) / one,
        lights=_lights(files, summary.photographs),
        camera=camera,
        prepared_depth=files.image("prepared_depth.tiff", shape, FLOAT32),
        depth_sigma=_expected(files, summary, "depth_sigma.tiff"),
        normal_sigma=_expected(files, summary, "normal_sigma.tiff"),
        **told(msgspec.structs.asdict(summary)),
    )


def read_summary(folder: Path) -> Summary:
    """The content of a result folder's result.json.

    Raises InputError when `folder` is not a result, or its result.json is damaged.
    """
    with clear_errors(str(folder), "cannot be read"):
        there = (folder / MARKER).is_file()
    if not there:
        raise InputError(
            "not a result folder",
            source=str(folder),
            needed=f"a folder with {MARKER}",
            remedy="name the folder that `rakelight refine` wrote",
        )
    path = folder / MARKER
    with _said_whole(path):
        return parse_summary(read_bytes(path, max_bytes=MAX_TEXT_BYTES), source=str(path))


class _Files:
    """The files of a result folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def content(self, name: str, *, max_bytes: int | None = None) -> bytes:
        """The bytes of a file, which has to be there."""
        path = self.folder / name
        if not os.path.lexists(path):
            raise InputError("this file of the result is missing", source=str(path))
        return read_bytes(path) if max_bytes is None else read_bytes(path, max_bytes=max_bytes)

    def image(self, name: str, shape: tuple[int, ...], dtype: np.dtype[np.generic]) -> Array:
        """An image, which has to have this shape and type."""
        source = str(self.folder / name)
        with _said_whole(self.folder / name):
            data = self.content(name)
            header = read_header(data, source)
            if header.shape != shape or header.dtype != dtype:
                raise InputError(
                    "this file does not belong to the result beside it",
                    source=source,
                    seen=f"{header.shape} {header.dtype}",
                    needed=f"{shape} {dtype}, as {MARKER} says",
                )
            return decode_image(data, source)


@contextmanager
def _said_whole(path: Path) -> Iterator[None]:
    """Errors about a file of the result say what is needed and what to do."""
    try:
        yield
    except InputError as error:
        error.source = error.source or str(path)
        error.needed = error.needed or "the whole file as rakelight wrote it"
        error.remedy = error.remedy or "copy the result folder again, or refine the capture again"
        raise


def _linear(values: Array, white: float) -> Floats:
    return np.asarray(to_linear(values, "srgb") * np.float32(white))


def _expected(files: _Files, summary: Summary, name: str) -> Floats | None:
    """An expected error, which not every method gives."""
    shape = summary.camera.as_camera().shape
    return files.image(name, shape, FLOAT32) if name in summary.files else None


def _lights(files: _Files, photographs: Sequence[str]) -> Lights:
    path = files.folder / "lights.json"
    with _said_whole(path):
        lights = parse_lights(
            files.content("lights.json", max_bytes=MAX_TEXT_BYTES), source=str(path)
        )
        if photographs and len(lights) != len(photographs):
            raise InputError(
                "this file does not belong to the result beside it",
                source=str(path),
                seen=f"{len(lights)} photographs",
                needed=f"{len(photographs)}, as {MARKER} says",
            )
    return lights
