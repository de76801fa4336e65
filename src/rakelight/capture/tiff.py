"""The pixels of a TIFF file.

Read here because libtiff fills in zeros for what is damaged, prints about it, turns the picture
by its orientation and is hard to hold to one reading of contradictory tags.
"""

from __future__ import annotations

from itertools import islice, product

import numpy as np

from rakelight.capture.compression import unpacked
from rakelight.capture.headers import TIFF_COMPRESSIONS, Header, TiffTags, damaged
from rakelight.model import Array


def decode_tiff(data: bytes, header: Header, source: str) -> Array:
    """(H, W) or (H, W, 3) of the first image of a file that `read_header` accepted.

    Raises CaptureError where a strip or tile is missing, too short, or cannot be unpacked to just
    the bytes that its pixels take.
    """
    tags = TiffTags(data)
    compression = TIFF_COMPRESSIONS[tags.first("compression", 1)]
    predictor = tags.first("predictor", 1) if compression in ("deflate", "LZW") else 1
    stored: np.dtype[np.generic] = np.dtype(header.dtype).newbyteorder(tags.order)
    planes = header.channels if tags.first("planar", 1) == 2 else 1
    samples = header.channels // planes
    tiled = "tile_width" in tags
    if tiled:
        rows, columns = tags.first("tile_height", 0), tags.first("tile_width", 0)
        offsets, counts = tags.all("tile_offsets"), tags.all("tile_byte_counts")
    else:
        rows = min(tags.first("rows_per_strip", header.height), header.height)
        columns = header.width
        offsets, counts = tags.all("strip_offsets"), tags.all("strip_byte_counts")
    if compression == "none":  # the sizes that are stated are not needed, and often wrong
        counts = [rows * columns * samples * stored.itemsize] * len(offsets)
    if rows < 1:
        raise damaged(source, "strips without rows")
    tops, lefts = range(0, header.height, rows), range(0, header.width, columns)
    needed = planes * len(tops) * len(lefts)
    if needed > min(len(offsets), len(counts)):
        raise damaged(source, "strips or tiles are missing")
    blocks = product(range(planes), tops, lefts)

    pixels = np.empty((header.height, header.width, header.channels), header.dtype)
    row_bytes = columns * samples * stored.itemsize
    places = islice(zip(offsets, counts, strict=False), needed)
    held = sum(min(count, max(len(data) - offset, 0)) for offset, count in places)
    if compression != "none" and held > len(data):
        raise damaged(source, "strips or tiles lie in each other")
    for (plane, top, left), offset, count in zip(blocks, offsets, counts, strict=False):
        here = rows if tiled else min(rows, header.height - top)
        block = unpacked(
            data[offset : offset + count],
            compression,
            here * row_bytes,
            source,
            most=rows * row_bytes,  # some programs fill up the last strip
        )
        values = _predicted(block.reshape(here, -1), predictor, stored, samples)
        part = pixels[top : top + here, left : left + columns, plane : plane + samples]
        part[...] = values.reshape(here, columns, samples)[: part.shape[0], : part.shape[1]]
    return pixels[..., 0] if header.channels == 1 else pixels


def _predicted(block: Array, predictor: int, stored: np.dtype[np.generic], samples: int) -> Array:
    """The samples (rows, n) of a block of bytes (rows, n * itemsize), differences added up.

    predictor : 1 none; 2 each sample is stored as its difference from the one to the left;
        3 floating point: the same of bytes, the highest bytes of a row first
    """
    rows, itemsize = len(block), stored.itemsize
    if predictor == 3:
        summed = block.reshape(rows, -1, samples).cumsum(axis=1, dtype=np.uint8)
        highest_first = summed.reshape(rows, itemsize, -1).swapaxes(1, 2)
        return np.ascontiguousarray(highest_first).view(stored.newbyteorder(">")).reshape(rows, -1)
    if predictor == 2:
        unsigned = np.dtype(f"u{itemsize}")
        differences = block.view(unsigned.newbyteorder(stored.byteorder))
        summed = differences.reshape(rows, -1, samples).cumsum(axis=1, dtype=unsigned)
        return summed.reshape(rows, -1).view(stored.newbyteorder("="))
    return block.view(stored)
