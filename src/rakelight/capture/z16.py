"""Depth that the RealSense Viewer saves as a snapshot: bare 16-bit values, their size in a CSV.

x_Depth.raw lies beside x_Depth_metadata.csv, with lines such as "Format,Z16" and "Resolution
x,848", and beside x_Depth.png, a coloured picture for people (github.com/realsenseai/librealsense,
issues 3632 and 11701).
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rakelight.capture.headers import check_size, damaged
from rakelight.capture.text_tables import text_of
from rakelight.errors import CaptureError
from rakelight.files import read_bytes
from rakelight.model import Array

SUFFIX = ".raw"
_MAX_CSV_BYTES = 100_000
_LINES = re.compile(r"^(Format|Resolution x|Resolution y),(\w{1,9})\s*$", re.MULTILINE)


def stated_shape(path: Path) -> tuple[int, int] | None:
    """(height, width) of a .raw by the metadata beside it; None where these are not of depth.

    Raises CaptureError for a size that no image has.

    >>> stated_shape(Path("a_Depth.raw")) is None
    True
    """
    beside = path.with_name(f"{path.stem}_metadata.csv")
    if path.suffix.lower() != SUFFIX or not beside.is_file():
        return None
    data = read_bytes(beside, source=str(beside), max_bytes=_MAX_CSV_BYTES)
    stated = dict(_LINES.findall(text_of(data) or ""))
    sides = [stated.get(f"Resolution {axis}", "") for axis in "yx"]
    if stated.get("Format") != "Z16" or not all(re.fullmatch("[0-9]+", side) for side in sides):
        return None
    height, width = map(int, sides)
    check_size(width, height, str(beside))
    return height, width


def size_not_stated(source: str) -> CaptureError:
    """The error for a .raw of depth whose size no metadata beside it states."""
    return CaptureError(
        "depth of a size that is not known", source=source,
        needed=f"{Path(source).stem}_metadata.csv beside it, with Format,Z16 and the Resolution",
        remedy="put it there: the RealSense Viewer saves it with a snapshot",
    )  # fmt: skip


def decode_z16(data: bytes, shape: tuple[int, int], source: str = "") -> Array:
    """(H, W) uint16 of so many values, little-endian; raises CaptureError for another number.

    >>> decode_z16(bytes([1, 0, 2, 0]), (1, 2)).tolist()
    [[1, 2]]
    """
    if len(data) != 2 * shape[0] * shape[1]:
        raise damaged(source, f"{len(data)} bytes for {shape[1]}x{shape[0]} values of 16 bit")
    return np.frombuffer(data, "<u2").astype(np.uint16).reshape(shape)
