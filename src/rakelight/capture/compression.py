"""Compressed pixels unpacked, strictly: whole, of the size they have to have, or refused.

Decoders leave out without a word what they cannot unpack, or print about it.
"""

from __future__ import annotations

import zlib

import numpy as np

from rakelight.capture.headers import Compression, damaged
from rakelight.model import Array

# The most bytes that one compressed byte can stand for: what claims more is refused before
# memory is taken for it.
_LARGEST_RATIO: dict[Compression, int] = {"none": 1, "deflate": 1032, "LZW": 2730, "PackBits": 64}


def unpacked(
    data: bytes, compression: Compression, size: int, source: str, *, most: int = 0
) -> Array:
    """The `size` bytes (uint8) that `data` holds; CaptureError where it does not.

    most : how many bytes it may hold, of which the first `size` are returned; 0 for just `size`

    >>> unpacked(zlib.compress(b"abc"), "deflate", 3, "0.png").tobytes()
    b'abc'
    >>> unpacked(bytes([254, 7, 0, 9]), "PackBits", 5, "0.tiff")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: 0.tiff: the image is damaged (seen its compressed ...
    """
    most = max(most, size)
    if size > _LARGEST_RATIO[compression] * len(data):
        raise damaged(source, "its pixels are cut short")
    if compression == "none":
        return np.frombuffer(data, np.uint8, size)
    if compression == "deflate":
        whole = np.frombuffer(inflated(data, most, source)[0], np.uint8)
    else:
        from rakelight.capture._kernels import unpack_lzw, unpack_packbits

        whole = np.empty(most, np.uint8)
        unpack = unpack_lzw if compression == "LZW" else unpack_packbits
        count = unpack(np.frombuffer(data, np.uint8), whole)
        if count < 0:
            raise damaged(source, "its compressed pixels contradict themselves")
        whole = whole[:count]
    if len(whole) not in (size, most):
        raise damaged(source, "its compressed pixels have another size than the image")
    return whole[:size]


def inflated(data: bytes, most: int, source: str) -> tuple[bytes, int]:
    """What a zlib stream holds, at most one byte more than `most`, and how many bytes it takes.

    Raises CaptureError where it is not whole or its checksum is wrong.
    """
    stream = zlib.decompressobj()
    try:
        whole = stream.decompress(data, most + 1)
    except zlib.error as error:
        raise damaged(source, "its compressed pixels contradict themselves") from error
    if not stream.eof:
        raise damaged(source, "its compressed pixels have another size than the image")
    return whole, len(data) - len(stream.unused_data)
