"""PFM: one float channel, rows from the bottom up."""

from __future__ import annotations

import re

import numpy as np

from rakelight.capture.headers import check_size, damaged
from rakelight.errors import CaptureError
from rakelight.model import Array

MAGIC = (b"Pf", b"PF")
_HEADER = re.compile(rb"(P[fF])\s+(\d{1,9})\s+(\d{1,9})\s+(-?[0-9.eE+-]{1,30})(?:\r\n|\s)")


def decode_pfm(data: bytes, source: str = "") -> Array:
    """(H, W) float32, the first row on top.

    Raises CaptureError for a file that is cut short, too large or in colour.

    >>> data = b"Pf 2 1 -1.0 " + np.array([0.5, 2.0], "<f4").tobytes()
    >>> decode_pfm(data).tolist()
    [[0.5, 2.0]]
    """
    found = _HEADER.match(data[:200])
    if found is None:
        raise damaged(source, "no valid PFM header")
    width, height = int(found[2]), int(found[3])
    check_size(width, height, source)
    if found[1] == b"PF":
        raise CaptureError(
            "a PFM in colour is not read",
            source=source,
            needed="depth, which is one channel",
            remedy="export the depth itself as PFM",
        )
    pixels = data[found.end() :]
    if len(pixels) < 4 * width * height:
        raise damaged(source, "its pixels are cut short")
    dtype = "<f4" if found[4].startswith(b"-") else ">f4"  # the sign of the scale says the order
    values = np.frombuffer(pixels, dtype, width * height).reshape(height, width)
    return np.ascontiguousarray(values[::-1]).astype(np.float32)
