"""How sure the depth maps of a folder are, by maps beside them: 0 is no measurement."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rakelight.capture.images import decode_image
from rakelight.capture.loose_files import LooseFile, LooseFiles
from rakelight.capture.npy import decode_npy, stated_shape
from rakelight.errors import listed
from rakelight.files import read_bytes
from rakelight.model import Array, Finding, Floats


def without_unsure(depth_m: Floats, files: LooseFiles) -> tuple[Finding, ...]:
    """Set depth (K, h, w) to NaN, in place, where the map of its number is 0; what was done.

    Maps are those of the depth where they are as many, with the same numbers in their names, of the
    depth's size, and not 0 everywhere.  Others are left alone, with a warning.
    Raises CaptureError for a map that is damaged.
    """
    maps = files.confidence
    if not maps:
        return ()
    if not _of_same_numbers(files.depth, maps):
        return _not_used(maps, f"not one for each of {len(files.depth)} depth maps")
    unsure = [_unsure(file, depth_m.shape[1:]) for file in maps]
    if any(each is None for each in unsure):
        height, width = depth_m.shape[1:]
        needed = f"one channel of the depth's {width}x{height} pixels, as PNG, TIFF or NPY"
        return _not_used(maps, f"not {needed}")
    doubtful = np.stack([each for each in unsure if each is not None])
    measured = np.isfinite(depth_m)
    lost = measured & doubtful
    if lost.sum() == measured.sum():
        return _not_used(maps, "no depth would be left")
    depth_m[lost] = np.nan
    share = lost.sum() / measured.sum()
    message = f"{share:.1%} of the depth left out, where {_names(maps)} is 0"
    return (Finding("note", "confidence-applied", message),)


def _unsure(file: LooseFile, shape: tuple[int, ...]) -> Array | None:
    """(h, w) True where a map is 0; None for another size, or a format that is not read."""
    data = None if file.exr is not None else read_bytes(file.path, source=file.source)
    if data is None or (file.header is not None and file.header.shape != shape):
        return None
    if file.header is not None and file.header.format != "JPEG":
        return np.asarray(decode_image(data, file.source) == 0)
    if file.kind != "npy" or stated_shape(io.BytesIO(data), file.source) != shape:
        return None
    return np.asarray(decode_npy(data, file.source) == 0)


def _of_same_numbers(depth: Sequence[LooseFile], maps: Sequence[LooseFile]) -> bool:
    """Whether there is one map for each depth map; of several by the last number in their names."""
    if len(depth) == len(maps) == 1:
        return True
    return [_number(file) for file in depth] == [_number(file) for file in maps]


def _number(file: LooseFile) -> int:
    """The last number in a name, -1 without one."""
    digits = re.findall(r"[0-9]+", Path(file.name).stem)
    return int(digits[-1][-18:]) if digits else -1


def _not_used(maps: Sequence[LooseFile], why: str) -> tuple[Finding, ...]:
    message = f"not used, all depth counts as measured: {_names(maps)}: {why}"
    return (Finding("warning", "ignored-files", message, "set depth that is not sure to 0"),)


def _names(files: Sequence[LooseFile]) -> str:
    return listed([file.name for file in files])
