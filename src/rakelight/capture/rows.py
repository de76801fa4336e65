"""Images written to a file some rows at a time, without ever holding the whole."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rakelight.capture.headers import PNG_MAGIC
from rakelight.capture.png import chunk
from rakelight.files import bytes_needed, clear_errors
from rakelight.model import Array

# The modulus of zlib's checksum (RFC 1950).
_ADLER = 65521
# Of zlib: looking for matches in photographs with noise takes longer and packs less
# (`python benchmarks/synth.py --packing`).
_PNG_STRATEGY = zlib.Z_RLE
# Of maps in floating point: level 6 takes half as long again for 1 % less (the same).
_TIFF_LEVEL = 1
# TIFF types of a tag's values.
_SHORT, _LONG = 3, 4


# ---- PNG


@dataclass(frozen=True)
class PackedRows:
    """Some rows of a PNG, compressed apart from the others.

    data : deflate blocks, none of them the last; size, checksum : of what they hold
    """

    data: bytes
    size: int
    checksum: int


def pack_png_rows(values: Array) -> PackedRows:
    """Rows (h, W, 3) uint8 or uint16 RGB, packed; of the same image others may follow.

    Stored as they are or as differences along the row, as packs the middle one smaller.

    >>> rows = np.zeros((2, 5, 3), np.uint8)
    >>> b"".join(png_parts((4, 5), np.uint8, [pack_png_rows(rows)] * 2))[1:4]
    b'PNG'
    """
    stored = np.ascontiguousarray(values, values.dtype.newbyteorder(">")).view(np.uint8)
    plain = stored.reshape(len(values), -1)
    pixel = 3 * values.dtype.itemsize
    changes = plain.copy()
    changes[:, pixel:] -= plain[:, :-pixel]
    middle = len(values) // 2
    kind, rows = min(enumerate((plain, changes)), key=lambda each: len(_deflated(each[1][middle])))
    lines = np.empty((len(rows), 1 + rows.shape[1]), np.uint8)
    lines[:, 0], lines[:, 1:] = kind, rows
    return PackedRows(_deflated(lines), lines.size, zlib.adler32(lines.data))


def _deflated(values: Array) -> bytes:
    """Deflate blocks that end with a whole byte."""
    packer = zlib.compressobj(1, zlib.DEFLATED, -15, 9, _PNG_STRATEGY)
    return packer.compress(np.ascontiguousarray(values).data) + packer.flush(zlib.Z_SYNC_FLUSH)


def png_parts(
    shape: tuple[int, int], dtype: type[np.unsignedinteger], rows: Iterable[PackedRows]
) -> Iterator[bytes]:
    """A PNG of (height, width) RGB pixels, part by part, from all its rows in order."""
    height, width = shape
    header = struct.pack(">IIBBBBB", width, height, 8 * np.dtype(dtype).itemsize, 2, 0, 0, 0)
    yield PNG_MAGIC + chunk(b"IHDR", header)
    low, high, start = 1, 0, b"\x78\x01"
    for each in rows:
        yield chunk(b"IDAT", start + each.data)
        # The checksum of both together: sums of bytes, and of these sums.
        more, sums = each.checksum & 0xFFFF, each.checksum >> 16
        high = (high + sums + each.size * (low - 1)) % _ADLER
        low, start = (low + more - 1) % _ADLER, b""
    last = b"\x03\x00"  # an empty block that is the last
    yield chunk(b"IDAT", start + last + struct.pack(">HH", high, low)) + chunk(b"IEND", b"")


# ---- TIFF


def pack_tiff_rows(values: Array) -> bytes:
    """Rows (h, W[, C]) float32 of a `TiffFile`, packed."""
    return zlib.compress(np.ascontiguousarray(values, "<f4").data, _TIFF_LEVEL)


class TiffFile:
    """A float32 TIFF that is written strip by strip.

    >>> from tempfile import TemporaryDirectory
    >>> from rakelight.capture.images import decode_image
    >>> with TemporaryDirectory() as scratch:
    ...     with TiffFile(Path(scratch) / "depth.tiff", (2, 1), rows=1) as file:
    ...         for value in (0.5, np.nan):
    ...             file.append(pack_tiff_rows(np.full((1, 1), value, np.float32)))
    ...     decode_image((Path(scratch) / "depth.tiff").read_bytes()).tolist()
    [[0.5], [nan]]
    """

    def __init__(self, path: Path, shape: tuple[int, ...], rows: int) -> None:
        """Begin a file of a map (H, W) or (H, W, C) in strips of so many rows, but for the last."""
        self.path, self.shape, self.rows = path, shape, rows
        self._counts: list[int] = []
        self._file: BinaryIO

    def __enter__(self) -> TiffFile:
        with self._clear():
            self._file = self.path.open("wb")
            self._file.write(bytes(8))  # where the directory is, in the end
        return self

    def append(self, strip: bytes) -> None:
        """Write the next strip, of `pack_tiff_rows`.  Raises MachineError, as `write_bytes`."""
        with self._clear():
            self._counts.append(len(strip))
            self._file.write(strip)

    def __exit__(self, kind: object, *_: object) -> None:
        try:
            if kind is None:
                with self._clear():
                    self._end()
        finally:
            self._file.close()

    def _end(self) -> None:
        """Write the directory of tags, and where it is."""
        height, width, channels = (*self.shape, 1)[:3]
        starts = 8 + np.cumsum([0, *self._counts[:-1]])
        tags = (  # number, type, values
            (256, _LONG, [width]), (257, _LONG, [height]), (258, _SHORT, [32] * channels),
            (259, _SHORT, [8]),  # deflate
            (262, _SHORT, [1 if channels == 1 else 2]),  # grey or RGB
            (273, _LONG, starts.tolist()), (277, _SHORT, [channels]), (278, _LONG, [self.rows]),
            (279, _LONG, self._counts), (284, _SHORT, [1]), (339, _SHORT, [3] * channels),
        )  # fmt: skip
        place = 8 + sum(self._counts)
        place += self._file.write(bytes(place % 2))  # the directory lies at an even place
        after = place + 2 + 12 * len(tags) + 4
        entries, long = struct.pack("<H", len(tags)), b""
        for number, kind, values in tags:
            data = struct.pack(f"<{len(values)}{'HI'[kind - _SHORT]}", *values)
            if len(data) > 4:
                place_of_data, long = after + len(long), long + data + bytes(len(data) % 4)
                data = struct.pack("<I", place_of_data)
            entries += struct.pack("<HHI", number, kind, len(values)) + data.ljust(4, b"\0")
        self._file.write(entries + bytes(4) + long)
        self._file.seek(0)
        self._file.write(b"II*\0" + struct.pack("<I", place))

    def _clear(self) -> AbstractContextManager[None]:
        needed = bytes_needed(sum(self._counts), "more than ")
        return clear_errors(str(self.path), "cannot be written", needed=needed)
