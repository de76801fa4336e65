"""What an image file says about itself, checked before any pixel is decoded.

Decoders disagree about damaged files, turn some pictures by their EXIF tag and not others, and
believe any size they are told.  So the few bytes that matter are read here.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from rakelight.errors import CaptureError

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
MAX_PIXELS = 100_000_000
_PIECE = 1 << 20  # bytes that are inflated at a time

_OTHER_FORMATS = (
    (b"II+\0", "a BigTIFF"),
    (b"MM\0+", "a BigTIFF"),
    (b"GIF8", "a GIF"),
    (b"BM", "a BMP"),
    (b"RIFF", "a WebP"),
    (b"%PDF", "a PDF"),
    (b"PK", "a ZIP archive"),
    (b"\x93NUMPY", "a NumPy array"),
    (b"v/1\x01", "an OpenEXR"),
    (b"version https://git-lfs", "a Git LFS pointer: run `git lfs pull`"),
    (b"<", "HTML or XML"),
)
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}  # by colour type; a palette is expanded
_TIFF_DTYPES = {  # by bits and sample format
    (8, 1): "uint8",
    (16, 1): "uint16",
    (32, 1): "uint32",
    (8, 2): "int8",
    (16, 2): "int16",
    (32, 2): "int32",
    (32, 3): "float32",
    (64, 3): "float64",
}
_TIFF_INTEGERS = {1: "B", 3: "H", 4: "I"}
_WIDTH, _HEIGHT, _BITS, _PHOTOMETRIC, _ORIENTATION = 256, 257, 258, 262, 274
_COMPRESSION, _DEFLATE = 259, (8, 32946)
_CHANNELS, _SAMPLE_FORMAT, _TILE_WIDTH, _TILE_HEIGHT = 277, 339, 322, 323
_BLOCK_TAGS = ((273, 279), (324, 325))  # offsets and byte counts of strips, of tiles


@dataclass(frozen=True, slots=True)
class Header:
    """Format, size in pixels and sample type of an image file.

    channels : as stored: 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha
    orientation : the EXIF tag; 1 = as stored

    >>> print(Header("PNG", width=1280, height=960, channels=3, dtype="uint8"))
    1280x960x3 uint8
    """

    format: Literal["PNG", "TIFF", "JPEG"]
    width: int
    height: int
    channels: int
    dtype: str
    orientation: int = 1

    def __str__(self) -> str:
        return f"{self.width}x{self.height}x{self.channels} {self.dtype}"


def read_header(data: bytes, source: str = "") -> Header:
    """The header of a PNG, TIFF or JPEG file; the file's structure is checked to its end.

    Raises CaptureError when it is another format, truncated, has a wrong PNG checksum, claims
    more than 100 megapixels, or stores its samples in a way that rakelight does not read.

    >>> read_header(b"<!DOCTYPE html>", "depth/000.png")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: depth/000.png: not an image file (seen HTML or XML, ...)
    """
    try:
        if data.startswith(PNG_MAGIC):
            return _png_header(data, source)
        if data.startswith((b"II*\0", b"MM\0*")):
            return _tiff_header(data, source)
        if data.startswith(b"\xff\xd8\xff"):
            return _jpeg_header(data, source)
    except (struct.error, IndexError) as error:
        raise damaged(source, "its header is cut short") from error
    if not data:
        raise CaptureError("the file is empty", source=source)
    raise CaptureError(
        "not an image file", source=source, seen=_what_it_is(data), needed="PNG or TIFF"
    )


def damaged(source: str, how: str) -> CaptureError:
    """The error of a file that is broken."""
    return CaptureError(
        "the image is damaged", source=source, seen=how, remedy="copy or export it again"
    )


def without_extras(data: bytes) -> bytes:
    """A PNG reduced to size, palette and pixels: no colour profile, transparency, animation.

    The decoder would print warnings about some of these and act on others.
    """
    kept = (b"IHDR", b"PLTE", b"IDAT", b"IEND")
    chunks = (data[start:end] for kind, start, end in _png_chunks(data, "") if kind in kept)
    return PNG_MAGIC + b"".join(chunks)


def _inflated(data: bytes | bytearray, size: int, source: str) -> Iterator[bytes]:
    """What a whole zlib stream holds, in pieces; CaptureError where it is not sound, or longer.

    >>> b"".join(_inflated(zlib.compress(b"abc"), 3, "0.png"))
    b'abc'
    """
    stream = zlib.decompressobj()
    try:
        for start in range(0, len(data), _PIECE):
            left, full = data[start : start + _PIECE], False
            while (left or full) and size >= 0 and not stream.eof:
                piece = stream.decompress(left, _PIECE)
                left, full = stream.unconsumed_tail, len(piece) == _PIECE
                size -= len(piece)
                yield piece
    except zlib.error as error:
        raise damaged(source, "its compressed pixels contradict themselves") from error
    if size < 0 or not stream.eof:
        raise damaged(source, "its compressed pixels have another size than the image")


def without_orientation(data: bytes) -> bytes:
    """A TIFF whose orientation tag says "as stored"; OpenCV turns the pixels by it."""
    tags = _tiff_tags(data)
    if _ORIENTATION not in tags:
        return data
    order = "<" if data.startswith(b"II") else ">"
    at = tags[_ORIENTATION][1]
    return data[:at] + struct.pack(order + "H", 1) + data[at + 2 :]


def _what_it_is(data: bytes) -> str:
    start = data[:64].lstrip()
    if data[4:8] == b"ftyp":
        return "HEIC or a video"
    for magic, name in _OTHER_FORMATS:
        if start.startswith(magic):
            return name
    return f"a file that starts with {data[:8]!r}"


def _check_size(width: int, height: int, source: str) -> None:
    if width < 1 or height < 1:
        raise damaged(source, f"a size of {width}x{height}")
    if width * height > MAX_PIXELS:
        raise CaptureError(
            "the image is too large",
            source=source,
            seen=f"{width}x{height}",
            needed=f"at most {MAX_PIXELS // 1_000_000} megapixels",
            remedy="crop it to the object",
        )


def _png_header(data: bytes, source: str) -> Header:
    length, kind, width, height, bits, colour = struct.unpack_from(">I4sIIBB", data, 8)
    if kind != b"IHDR" or length != 13 or colour not in _PNG_CHANNELS:
        raise damaged(source, "no valid PNG header")
    _check_size(width, height, source)
    orientation, view = 1, memoryview(data)
    for chunk, start, end in _png_chunks(data, source):
        if zlib.crc32(view[start + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            raise damaged(source, f"wrong checksum at byte {start}")
        if chunk == b"eXIf":
            orientation = _exif_orientation(data[start + 8 : end - 4])
    dtype = "uint16" if bits == 16 else "uint8"
    return Header("PNG", width, height, _PNG_CHANNELS[colour], dtype, orientation)


def _png_chunks(data: bytes, source: str) -> Iterator[tuple[bytes, int, int]]:
    """(kind, start, end) of every chunk up to IEND; length and checksum are part of it."""
    start = len(PNG_MAGIC)
    while start + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, start)
        end = start + 12 + length
        if end > len(data):
            break
        yield kind, start, end
        if kind == b"IEND":
            return
        start = end
    raise damaged(source, "the end of the PNG is missing")


def _jpeg_header(data: bytes, source: str) -> Header:
    header: Header | None = None
    orientation, at = 1, 2
    while data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF:  # padding
            at += 1
            continue
        (length,) = struct.unpack_from(">H", data, at + 2)
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            header = _jpeg_frame(data, at + 4, source)
        elif marker == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            orientation = _exif_orientation(data[at + 10 : at + 2 + length])
        elif marker == 0xDA:
            break
        at += 2 + length
    if header is None:
        raise damaged(source, "no valid JPEG header")
    if data.rfind(b"\xff\xd9") < at:
        raise damaged(source, "the end of the JPEG is missing")
    return Header("JPEG", header.width, header.height, header.channels, header.dtype, orientation)


def _jpeg_frame(data: bytes, at: int, source: str) -> Header:
    bits, height, width, channels = struct.unpack_from(">BHHB", data, at)
    _check_size(width, height, source)
    if channels not in (1, 3) or bits != 8:
        raise CaptureError(
            "this kind of JPEG is not read",
            source=source,
            seen="CMYK" if channels == 4 else f"{channels} channels of {bits} bit",
            needed="8-bit grey or RGB",
            remedy="export it as RGB PNG",
        )
    return Header("JPEG", width, height, channels, "uint8")


def _tiff_header(data: bytes, source: str) -> Header:
    tags = _tiff_tags(data)

    def first(tag: int, default: int) -> int:
        values = tags.get(tag, ((), 0))[0]
        return values[0] if values else default

    width, height = first(_WIDTH, 0), first(_HEIGHT, 0)
    _check_size(width, height, source)
    if _TILE_WIDTH in tags:
        _check_size(first(_TILE_WIDTH, 0), first(_TILE_HEIGHT, 0), source)
    for offsets, counts in _BLOCK_TAGS:
        if offsets in tags and counts in tags:
            ends = (a + n for a, n in zip(tags[offsets][0], tags[counts][0], strict=False))
            if any(end > len(data) for end in ends):
                raise damaged(source, "the end of the TIFF is missing")
    channels, bits = first(_CHANNELS, 1), first(_BITS, 1)
    dtype = _TIFF_DTYPES.get((bits, first(_SAMPLE_FORMAT, 1)))
    # OpenCV multiplies the alpha of a TIFF into its colours and leaves inverted grey inverted.
    if dtype is None or channels not in (1, 3) or first(_PHOTOMETRIC, 1) not in (1, 2):
        raise CaptureError(
            "this kind of TIFF is not read",
            source=source,
            seen=f"{channels} channels of {bits} bit, photometric {first(_PHOTOMETRIC, 1)}",
            needed="grey or RGB without alpha, 8, 16 or 32 bit",
            remedy="export it as PNG, or as plain RGB or grey TIFF",
        )
    if first(_COMPRESSION, 1) in _DEFLATE and _TILE_WIDTH not in tags:
        # OpenCV leaves out, without a word, what it cannot inflate.
        left = width * height * channels * bits // 8
        for at, count in zip(*(tags.get(tag, ((), 0))[0] for tag in _BLOCK_TAGS[0]), strict=False):
            left -= sum(map(len, _inflated(data[at : at + count], left, source)))
    return Header("TIFF", width, height, channels, dtype, first(_ORIENTATION, 1))


def _tiff_tags(data: bytes) -> dict[int, tuple[tuple[int, ...], int]]:
    """Tag -> (its integers, where they lie) of the first image; raises struct.error."""
    order = "<" if data.startswith(b"II") else ">"
    (directory,) = struct.unpack_from(order + "I", data, 4)
    (entries,) = struct.unpack_from(order + "H", data, directory)
    tags: dict[int, tuple[tuple[int, ...], int]] = {}
    for entry in range(directory + 2, directory + 2 + 12 * entries, 12):
        tag, kind, count = struct.unpack_from(order + "HHI", data, entry)
        if kind not in _TIFF_INTEGERS:
            continue
        code = _TIFF_INTEGERS[kind]
        at = entry + 8  # up to four bytes lie in the entry itself
        size = struct.calcsize(order + code) * count
        if size > 4:
            (at,) = struct.unpack_from(order + "I", data, at)
        if at + size > len(data):  # before a lying count is believed
            raise struct.error("tag outside the file")
        tags[tag] = struct.unpack_from(f"{order}{count}{code}", data, at), at
    return tags


def _exif_orientation(exif: bytes) -> int:
    """The orientation in an EXIF block (a small TIFF); 1 when there is none to be read."""
    try:
        values = _tiff_tags(exif).get(_ORIENTATION, ((1,), 0))[0]
    except struct.error:
        return 1
    return values[0] if values else 1
