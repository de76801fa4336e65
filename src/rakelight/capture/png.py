"""A PNG made so plain and sound that its decoder has nothing to say."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import numpy as np

from rakelight.capture.compression import inflated
from rakelight.capture.headers import PNG_MAGIC, damaged, png_chunks

_SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # per pixel, by colour type; 3 is a palette
_PALETTE, _ALPHA = 3, 4  # a colour type, and a bit of it
# Adam7, the interlaced order: first column and row of each pass, steps along both.
_PASSES = (
    (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)
)  # fmt: skip
_LARGEST_FILTER = 4  # none, left, above, average, Paeth


def plain_png(data: bytes, source: str) -> bytes:
    """A PNG that `read_header` accepted, reduced to size, palette and pixels.

    No colour profile, transparency or animation is left, about which the decoder would print
    warnings or change the pixels.  Raises CaptureError where the pixels cannot be unpacked to just
    the bytes that they take, a row has a filter that does not exist, or the palette is unsound.
    """
    width, height, bits, colour, _, _, interlace = struct.unpack_from(">IIBBBBB", data, 16)
    chunks = list(png_chunks(data, source))
    kept = [data[8:33]]
    if colour == _PALETTE:
        palettes = [data[start:end] for kind, start, end in chunks if kind == b"PLTE"]
        sizes = [len(palette) - 12 for palette in palettes]
        if len(sizes) != 1 or sizes[0] % 3 or not 3 <= sizes[0] <= 3 << bits:
            raise damaged(source, "no valid palette")
        kept += palettes
    pixels = b"".join(data[start + 8 : end - 4] for kind, start, end in chunks if kind == b"IDAT")
    passes = list(_passes(width, height, bits * _SAMPLES[colour], interlace))
    total = sum(count * size for count, size in passes)
    whole, used = inflated(pixels, total, source)
    if len(whole) != total:
        raise damaged(source, "its compressed pixels have another size than the image")
    rows = np.frombuffer(whole, np.uint8)
    at = 0
    for count, size in passes:
        if count and (rows[at : at + count * size : size] > _LARGEST_FILTER).any():
            raise damaged(source, "its compressed pixels contradict themselves")
        at += count * size
    kept += [chunk(b"IDAT", pixels[:used]), chunk(b"IEND", b"")]
    return PNG_MAGIC + b"".join(kept)


def transparent_colour(data: bytes, source: str) -> tuple[int, ...] | None:
    """The value of grey, or of red, green and blue, that is transparent, as it is decoded.

    None where no one colour of the PNG is.  Raises CaptureError where its size is another.
    """
    bits, colour = data[24:26]
    stated = _transparency(data, source)
    if stated is None or colour == _PALETTE:
        return None
    if len(stated) != 2 * _SAMPLES[colour]:
        raise damaged(source, "no valid transparent colour")
    values = struct.unpack(f">{_SAMPLES[colour]}H", stated)
    to_8_bit = 255 // (2**bits - 1) if bits < 8 else 1
    return tuple((value & (2**bits - 1)) * to_8_bit for value in values)


def opacity_as_palette(data: bytes, source: str) -> bytes | None:
    """The PNG with how opaque each colour of its palette is in that colour's place.

    None where it has no palette, or one that is opaque.
    """
    stated = _transparency(data, source)
    if stated is None or data[25] != _PALETTE:
        return None
    parts = [PNG_MAGIC]
    for kind, start, end in png_chunks(data, source):
        colours = (end - start - 12) // 3
        opacities = stated[:colours].ljust(colours, b"\xff")  # 255 where none is stated
        greys = bytes(value for value in opacities for _ in "RGB")
        parts.append(chunk(kind, greys) if kind == b"PLTE" else data[start:end])
    return b"".join(parts)


def _transparency(data: bytes, source: str) -> bytes | None:
    """What the PNG says to be transparent; None where it does not, or has an alpha channel."""
    bodies = (
        data[at + 8 : end - 4] for kind, at, end in png_chunks(data, source) if kind == b"tRNS"
    )
    return None if data[25] & _ALPHA else next(bodies, None)


def _passes(width: int, height: int, bits: int, interlace: int) -> Iterator[tuple[int, int]]:
    """(rows, bytes of a row) of every pass; each row begins with the byte that says its filter."""
    for left, top, across, down in _PASSES if interlace else ((0, 0, 1, 1),):
        columns, rows = -(-(width - left) // across), -(-(height - top) // down)
        if columns > 0 and rows > 0:
            yield rows, 1 + -(-columns * bits // 8)


def chunk(kind: bytes, body: bytes) -> bytes:
    """A chunk of a PNG: its length, kind, content and checksum."""
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
