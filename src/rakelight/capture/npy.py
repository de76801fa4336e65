"""NumPy's .npy: an image of numbers, its header checked before anything is evaluated."""

from __future__ import annotations

import io
import re
from typing import IO

import numpy as np

from rakelight.errors import InputError
from rakelight.model import Array

MAGIC = b"\x93NUMPY"
MAX_SIDE = 16384
_LONGEST_HEADER = 10_000  # bytes at the start of an array; numpy writes about 128


def decode_npy(data: bytes, source: str = "") -> Array:
    """(H, W) of numbers; raises InputError for anything else, objects (pickles) included.

    >>> file = io.BytesIO()
    >>> np.save(file, np.eye(2))
    >>> decode_npy(file.getvalue()).tolist()
    [[1.0, 0.0], [0.0, 1.0]]
    """
    file = io.BytesIO(data)
    shape, columns_first, dtype = npy_header(file, "the array", source)
    size = shape[0] * shape[1] * dtype.itemsize
    values = file.read()
    if len(values) != size:
        raise InputError(
            "the array is not of the size it states",
            source=source,
            seen=f"{len(values)} bytes",
            needed=f"{size} for {shape}",
            remedy="copy it, or numpy.save it again",
        )
    return np.frombuffer(values, dtype).reshape(shape, order="F" if columns_first else "C")


def npy_header(
    member: IO[bytes], key: str, source: str
) -> tuple[tuple[int, int], bool, np.dtype[np.generic]]:
    """Shape, whether columns come first, and type; the values come next in `member`.

    Looked for in the text: numpy would evaluate it, and warn about what it finds.
    """
    start = member.read(8)
    width = {1: 2, 2: 4, 3: 4}.get(start[6], 0) if len(start) == 8 else 0  # bytes of its length
    length = int.from_bytes(member.read(width), "little")
    if not start.startswith(b"\x93NUMPY") or not 0 < length <= _LONGEST_HEADER:
        raise InputError(
            f"{key} is damaged",
            source=source,
            seen="no header of an array",
            remedy="copy it, or numpy.save it again",
        )
    text = member.read(length).decode("latin-1")
    dtype = re.search(r"""['"]descr['"]: *['"]([<>|=]?(?:b1|[iu][1248]|f[248]))['"]""", text)
    order = re.search(r"""['"]fortran_order['"]: *(True|False)""", text)
    shape = re.search(r"""['"]shape['"]: *\( *(\d{1,9})L?, *(\d{1,9})L? *,? *\)""", text)
    if not (dtype and order and shape):
        raise InputError(
            f"{key} is not an image of numbers",
            source=source,
            seen=text.strip(),
            needed="(H, W)",
            remedy="save one image of numbers (H, W)",
        )
    height, columns = int(shape[1]), int(shape[2])
    if not (0 < height <= MAX_SIDE and 0 < columns <= MAX_SIDE):
        raise InputError(
            f"{key} is not an image of numbers",
            source=source,
            seen=f"{height} x {columns}",
            needed=f"at most {MAX_SIDE} x {MAX_SIDE}",
            remedy="save one image of numbers (H, W)",
        )
    return (height, columns), order[1] == "True", np.dtype(dtype[1])
