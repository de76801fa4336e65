# mypy: disable-error-code="no-untyped-def"
"""Compressed bytes of a TIFF unpacked, strictly: compiled loops.

Both return how many bytes they wrote to `out`, or -1 where the data contradict themselves or do
not fit into it.
"""

from __future__ import annotations

import numpy as np

from rakelight.jit import helper

_CLEAR, _END, _FIRST = 256, 257, 258  # LZW codes: empty the table, the end, the first free one


@helper
def unpack_lzw(data, out):
    """TIFF's LZW: codes of 9 to 12 bits, highest bit first, each wider one code early."""
    # A code stands for bytes that were written before: where they start, and how many.
    starts, lengths = np.empty(4096, np.int64), np.empty(4096, np.int64)
    width, free, before, written = 9, -1, 0, 0  # free: the next free code; -1 until a clear code
    bits, held = 0, 0  # read and not used yet, how many
    for byte in data:
        bits, held = (bits << 8 | byte) & 0xFFFFF, held + 8
        if held < width:
            continue
        held -= width
        code = bits >> held & ((1 << width) - 1)
        if code == _END:
            break
        if code == _CLEAR:
            width, free, before = 9, _FIRST, 0
            continue
        if free < 0:
            return -1
        if before > 0:  # the string before and the first byte of this one
            if free == 4096:
                return -1
            starts[free], lengths[free] = written - before, before + 1
            free += 1
            if free > (1 << width) - 2 and width < 12:
                width += 1
        length = 1 if code < _CLEAR else lengths[code]
        if code >= free or written + length > out.size:
            return -1
        if code < _CLEAR:
            out[written] = code
        else:
            for i in range(length):  # one by one: the string may reach into what is written
                out[written + i] = out[starts[code] + i]
        written += length
        before = length
    return written


@helper
def unpack_packbits(data, out):
    """PackBits: runs of one byte, and bytes as they are; one byte of padding is allowed."""
    at, written = 0, 0
    while at + 1 < data.size and written < out.size:
        head = data[at]
        at += 1
        if head == 128:
            continue
        count = 257 - head if head > 128 else head + 1
        needed = 1 if head > 128 else count
        if at + needed > data.size or written + count > out.size:
            return -1
        for i in range(count):
            out[written + i] = data[at] if head > 128 else data[at + i]
        at += needed
        written += count
    return written if data.size - at <= 1 else -1
