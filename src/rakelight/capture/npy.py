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
    return _values(file, *npy_header(file, "the array", source), source)


def stated_shape(file: IO[bytes], source: str = "") -> tuple[int, int] | None:
    """(H, W) of an array by its header; None for one of another number of axes, or of no numbers.

    >>> file = io.BytesIO()
    >>> np.save(file, np.zeros((4, 3, 3)))
    >>> stated_shape(io.BytesIO(file.getvalue())) is None
    True
    """
    stated = _stated(_header(file, "the array", source))
    return None if stated is None else stated[0]


def decode_few(data: bytes, most: int, source: str = "") -> Array | None:
    """(H, W), or (1, N) of a list of numbers; None for another array, or one of more than `most`.

    >>> file = io.BytesIO()
    >>> np.save(file, np.arange(3))
    >>> decode_few(file.getvalue(), 3).tolist(), decode_few(file.getvalue(), 2)
    ([[0, 1, 2]], None)
    """
    file = io.BytesIO(data)
    stated = _stated(_header(file, "the array", source), lists=True)
    if stated is None or not 0 < stated[0][0] * stated[0][1] <= most:
        return None
    return _values(file, *stated, source)


def _values(
    file: IO[bytes],
    shape: tuple[int, int],
    columns_first: bool,
    dtype: np.dtype[np.generic],
    source: str,
) -> Array:
    """What stands behind the header of an array."""
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
    text = _header(member, key, source)
    stated = _stated(text)
    if stated is None:
        raise InputError(
            f"{key} is not an image of numbers",
            source=source,
            seen=text.strip(),
            needed="(H, W)",
            remedy="save one image of numbers (H, W)",
        )
    (height, columns), _, _ = stated
    if not (0 < height <= MAX_SIDE and 0 < columns <= MAX_SIDE):
        raise InputError(
            f"{key} is not an image of numbers",
            source=source,
            seen=f"{height} x {columns}",
            needed=f"at most {MAX_SIDE} x {MAX_SIDE}",
            remedy="save one image of numbers (H, W)",
        )
    return stated


def _header(member: IO[bytes], key: str, source: str) -> str:
    """The text that says what an array is; raises InputError where there is none."""
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
    return member.read(length).decode("latin-1")


def _stated(
    text: str, lists: bool = False
) -> tuple[tuple[int, int], bool, np.dtype[np.generic]] | None:
    """What the text of a header states, as `npy_header`; None where it is no (H, W) of numbers.

    lists : whether a list (N,) counts as (1, N)
    """
    dtype = re.search(r"""['"]descr['"]: *['"]([<>|=]?(?:b1|[iu][1248]|f[248]))['"]""", text)
    order = re.search(r"""['"]fortran_order['"]: *(True|False)""", text)
    shape = re.search(
        r"""['"]shape['"]: *\( *(?:(\d{1,9})L?, *)?(\d{1,9})L? *,? *\)""",
        text,
    )
    if not (dtype and order and shape) or not (shape[1] or lists):
        return None
    return (int(shape[1] or 1), int(shape[2])), order[1] == "True", np.dtype(dtype[1])
