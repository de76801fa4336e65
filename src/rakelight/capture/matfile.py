"""MATLAB's .mat files of version 5: arrays of real numbers, and nothing else.

SciPy's reader makes objects of what a file states and is not hardened, so the little that is needed
is read here: headers first, sizes checked against the bytes that follow, and only variables that
are asked for.  Files of version 7.3 are HDF5 and refused, as are objects, cells and structures.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Iterator

import numpy as np

from rakelight.errors import CaptureError
from rakelight.memory import require_memory
from rakelight.model import Array

# How data are stored, by their number; then the type of each class.
_STORED = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_MATRIX, _COMPRESSED = 14, 15
_CLASSES = {
    6: "float64", 7: "float32", 8: "int8", 9: "uint8", 10: "int16", 11: "uint16", 12: "int32",
    13: "uint32", 14: "int64", 15: "uint64",
}  # fmt: skip
_OTHER_CLASSES = {1: "a cell", 2: "a structure", 3: "an object", 4: "text", 5: "a sparse matrix"}
_COMPLEX = 0x0800
_HEADER = 128
AS_VERSION_7 = "in MATLAB: load('old.mat'); save('new.mat', 'I', 'z0', 'mask', 'K', '-v7')"
# How files of version 7.3 begin: as MATLAB writes them, and without its own words before the HDF5.
_HDF5 = (b"MATLAB 7.3 MAT-file", b"\x89HDF\r\n\x1a\n")
# Bytes at the start of a variable in which its type, size and name lie.
_PREAMBLE = 4096
# Values of one variable: 100 photographs of 2 megapixels in colour.
MOST_VALUES = 600_000_000
# Axes, and variables in a file.
_MOST_AXES, _MOST_VARIABLES = 8, 1000


def is_mat(start: bytes) -> bool:
    """Whether the first bytes of a file are those of a .mat file, of any version from 5 on."""
    return start.startswith((b"MATLAB 5.0 MAT-file", *_HDF5))


def refuse_hdf5(start: bytes, source: str) -> None:
    """Raise CaptureError where a file begins as those of version 7.3, which are HDF5.

    >>> refuse_hdf5(b"MATLAB 7.3 MAT-file, Platform", "data.mat")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: data.mat: HDF5 is not read, and so no .mat file of version
    7.3 (needed ...
    """
    if start.startswith(_HDF5):
        raise CaptureError(
            "HDF5 is not read, and so no .mat file of version 7.3",
            source=source,
            needed="a .mat file of version 5 to 7",
            remedy=AS_VERSION_7,
        )


def read_mat(data: bytes, wanted: Collection[str], source: str = "") -> dict[str, Array]:
    """The variables called `wanted` that a file holds, by their names.

    Raises CaptureError for another format, damage, or a wanted variable that is no array of real
    numbers; MachineError where there is too little memory for one.

    >>> read_mat(b"a text", ["I"], "data.mat")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: data.mat: not a .mat file of version 5 to 7. Fix: ...
    """
    refuse_hdf5(data[:32], source)
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if not data.startswith(b"MATLAB 5.0 MAT-file") or order is None:
        raise CaptureError(
            "not a .mat file of version 5 to 7",
            source=source,
            remedy=AS_VERSION_7,
        )
    found: dict[str, Array] = {}
    try:
        for count, (kind, start, end) in enumerate(_elements(data, _HEADER, len(data), order)):
            if count >= _MOST_VARIABLES:
                raise _damaged(source, f"more than {_MOST_VARIABLES} variables")
            variable = _Variable(data, kind, start, end, order, source)
            if variable.name in wanted:
                if variable.name in found:
                    raise _damaged(source, f"{variable.name} twice")
                found[variable.name] = variable.values()
    except (struct.error, zlib.error, IndexError, UnicodeDecodeError) as error:
        raise _damaged(source, str(error)) from error
    return found


def _damaged(source: str, how: str) -> CaptureError:
    return CaptureError(
        "the .mat file is damaged", source=source, seen=how, remedy="copy or export it again"
    )


def _tag(data: bytes, at: int, order: str) -> tuple[int, int, int]:
    """Kind, first byte and length of the element at `at`; small ones lie in the tag itself."""
    kind, length = struct.unpack_from(f"{order}II", data, at)
    if kind >> 16:
        return kind & 0xFFFF, at + 4, min(kind >> 16, 4)
    return kind, at + 8, length


def _elements(data: bytes, at: int, end: int, order: str) -> Iterator[tuple[int, int, int]]:
    """(kind, start, end) of the elements in data[at:end]; raises struct.error."""
    while at < end:
        kind, start, length = _tag(data, at, order)
        if start + length > end:
            raise struct.error("its end is missing")
        yield kind, start, start + length
        # All but compressed elements are padded to eight bytes.
        at = start + length if kind == _COMPRESSED else start + -(-length // 8) * 8


class _Variable:
    """One variable: what its first bytes say, and its values when they are asked for."""

    def __init__(
        self, data: bytes, kind: int, start: int, end: int, order: str, source: str
    ) -> None:
        self.order, self.source, self.packed = order, source, kind == _COMPRESSED
        self.data = memoryview(data)[start:end]
        head = bytes(self.data[:_PREAMBLE])
        self.length = len(self.data)
        if self.packed:
            head = zlib.decompressobj().decompress(bytes(self.data), _PREAMBLE)
            kind, self.skip, self.length = _tag(head, 0, order)
            head = head[self.skip :]
        if kind != _MATRIX:
            raise _damaged(source, f"element of kind {kind}")
        self._read_head(head)

    def _read_head(self, head: bytes) -> None:
        _, at, _ = _tag(head, 0, self.order)
        (flags,) = struct.unpack_from(f"{self.order}I", head, at)
        self.kind, self.complex = flags & 0xFF, bool(flags & _COMPLEX)
        kind, start, length = _tag(head, 16, self.order)
        if kind != 5 or not 4 * 2 <= length <= 4 * _MOST_AXES:
            # such as a function handle, which has no size
            self.shape, self.name = (), ""
            return
        self.shape = struct.unpack_from(f"{self.order}{length // 4}i", head, start)
        at = start + -(-length // 8) * 8
        _, start, length = _tag(head, at, self.order)
        self.name = head[start : start + min(length, 63)].decode("ascii")
        self.at = at + 8 if start - at == 4 else start + -(-length // 8) * 8

    def values(self) -> Array:
        """The array, as MATLAB shapes it; raises CaptureError."""
        if self.kind not in _CLASSES or self.complex:
            raise CaptureError(
                f"variable {self.name} is no array of real numbers",
                source=self.source,
                seen="complex numbers" if self.complex else _OTHER_CLASSES.get(self.kind, "other"),
                needed="numbers",
                remedy="save it as an array of numbers",
            )
        count = math.prod(self.shape)
        if min(self.shape) < 1 or count > MOST_VALUES:
            raise CaptureError(
                f"variable {self.name} is empty or too large",
                source=self.source,
                seen=" x ".join(map(str, self.shape)),
                needed=f"1 to {MOST_VALUES} numbers",
                remedy="save what it should hold, or fewer photographs",
            )
        if self.length > self.at + 8 + 8 * count + 8:
            raise _damaged(self.source, f"{self.name} is longer than its size")
        body: bytes | memoryview = self.data
        if self.packed:
            require_memory(self.length, source=self.source, remedy="use fewer images")
            unpacker = zlib.decompressobj()
            body = unpacker.decompress(bytes(self.data), self.skip + self.length)[self.skip :]
        stored, start, length = _tag(bytes(body[self.at : self.at + 8]), 0, self.order)
        dtype = np.dtype(self.order + _STORED.get(stored, "V1"))
        if stored not in _STORED or length != dtype.itemsize * count:
            raise _damaged(self.source, f"{self.name}: {length} bytes for {count} numbers")
        numbers = np.frombuffer(body, np.uint8)[self.at + start :][:length]
        if len(numbers) != length:
            raise _damaged(self.source, f"the end of {self.name} is missing")
        values = numbers.view(dtype).astype(_CLASSES[self.kind])
        return values.reshape(self.shape, order="F")
