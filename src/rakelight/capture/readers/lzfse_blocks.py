"""Apple's LZFSE, unpacked only where its blocks say that it is not larger than it should be.

The library takes what memory the data ask for; a few kilobytes can ask for gigabytes.
Layout: the header structures of lzfse_internal.h (github.com/lzfse/lzfse).
"""

from __future__ import annotations

import struct

from rakelight.errors import CaptureError, parsing
from rakelight.extras import needs

# Bytes that a match of a compressed block can stand for: the longest literal and match.
_LONGEST_MATCH = 315 + 2359
# Bytes that the matches of all blocks may stand for, whatever the blocks say of their size: above
# those of a map of 960x720 with a match for each of its numbers.
_MOST_BYTES = 2 << 30
# Bytes of the header of a compressed block, without its tables.
_LEAST_HEADER = 32
# Bytes by which data that cannot be packed grow.
_SLACK = 4096


def unpack(data: bytes, size: int, source: str) -> bytes:
    """The `size` bytes that were packed; raises CaptureError for damage or another size."""
    if len(data) == size and data[:3] != b"bvx":
        return data  # older recordings are not packed
    stated = _stated_size(data, source) if len(data) <= size + _SLACK else len(data)
    if stated != size:
        raise _damaged(source, f"{stated} bytes", f"{size}")
    library = needs("lzfse", "recordings", source)
    with parsing(source, "the LZFSE data are damaged", CaptureError):
        unpacked = library.decompress(data)
    if len(unpacked) != size:
        raise _damaged(source, f"{len(unpacked)} bytes", f"{size}")
    return bytes(unpacked)


def stated_size(data: bytes, source: str) -> int:
    """How many bytes the blocks say that they hold; raises CaptureError for damaged ones."""
    return len(data) if data[:3] != b"bvx" else _stated_size(data, source)


def _stated_size(data: bytes, source: str) -> int:
    total = matches = at = 0
    with parsing(source, "the LZFSE data are damaged", CaptureError):
        while (magic := data[at : at + 4]) != b"bvx$":
            (held,) = struct.unpack_from("<I", data, at + 4)
            if magic == b"bvx-":
                at += 8 + held
            elif magic == b"bvxn":
                at += 12 + int(struct.unpack_from("<I", data, at + 8)[0])
            elif magic == b"bvx2":
                first, second, third = struct.unpack_from("<QQQ", data, at + 8)
                header = third & 0xFFFFFFFF
                if header < _LEAST_HEADER:
                    raise _damaged(source, f"a header of {header} bytes", f"{_LEAST_HEADER}")
                matches += first >> 40 & 0xFFFFF
                at += header + (first >> 20 & 0xFFFFF) + (second >> 40 & 0xFFFFF)
            else:
                raise _damaged(source, f"a block {magic!r} at byte {at}", "LZFSE")
            total += held
    if matches * _LONGEST_MATCH > _MOST_BYTES:
        raise _damaged(source, f"{matches} matches", "fewer")
    return total


def _damaged(source: str, seen: str, needed: str) -> CaptureError:
    return CaptureError(
        "the LZFSE data are damaged",
        source=source,
        seen=seen,
        needed=needed,
        remedy="copy the recording again",
    )
