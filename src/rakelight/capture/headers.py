"""What an image file says about itself, checked before any pixel is decoded.

Decoders disagree about damaged files, turn some pictures by their EXIF tag and not others, and
accept any size that a file states.  So the few bytes that matter are read here.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rakelight.errors import CaptureError

Compression = Literal["none", "deflate", "LZW", "PackBits"]

PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
MAX_PIXELS = 100_000_000
# A JPEG is decoded once per scan; progressive ones have about ten, and more than this only to
# keep a decoder busy.
_MOST_SCANS = 200
# A marker of JPEG: not the 0 that escapes a coded 255, nor a restart among coded pixels, nor
# padding.
_JPEG_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
_JPEG_END, _JPEG_SCAN, _JPEG_WITHOUT_LENGTH = 0xD9, 0xDA, (0x01, 0xD8)

_HEIC = "HEIC or a video"
_OTHER_IMAGES = (
    (b"II+\0", "a BigTIFF"),
    (b"MM\0+", "a BigTIFF"),
    (b"GIF8", "a GIF"),
    (b"BM", "a BMP"),
    (b"RIFF", "a WebP or an AVI"),
    (b"v/1\x01", "an OpenEXR"),
)
_OTHER_FORMATS = (
    *_OTHER_IMAGES,
    (b"%PDF", "a PDF"),
    (b"PK", "a ZIP archive"),
    (b"\x93NUMPY", "a NumPy array"),
    (b"version https://git-lfs", "a Git LFS pointer: run `git lfs pull`"),
    (b"<", "HTML or XML"),
    (b"SQLite format 3\0", "an SQLite file"),
    (b"\x89MCAP", "MCAP"),
    *(
        (magic, "a packed file")
        for magic in (b"\x1f\x8b", b"7z\xbc\xaf", b"Rar!", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd")
    ),
)
# By colour type: channels (a palette is expanded), and the bits that a sample may have.
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
_PNG_BITS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}
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
_TIFF_UNDEFINED = 7
_SMALLER_OR_MASK = 1 | 4  # bits of a subfile's type: a preview, or the transparency of the image
_TIFF_TAGS = {
    "subfile": 254,
    "width": 256,
    "height": 257,
    "bits": 258,
    "compression": 259,
    "photometric": 262,
    "fill_order": 266,
    "strip_offsets": 273,
    "orientation": 274,
    "channels": 277,
    "rows_per_strip": 278,
    "strip_byte_counts": 279,
    "planar": 284,
    "predictor": 317,
    "tile_width": 322,
    "tile_height": 323,
    "tile_offsets": 324,
    "tile_byte_counts": 325,
    "sample_format": 339,
}
TIFF_COMPRESSIONS: dict[int, Compression] = {
    1: "none",
    5: "LZW",
    8: "deflate",
    32946: "deflate",
    32773: "PackBits",
}
_OTHER_COMPRESSIONS = {6: "JPEG", 7: "JPEG", 34925: "LZMA", 50000: "ZSTD", 50001: "WebP"}


@dataclass(frozen=True, slots=True)
class Header:
    """Format, size in pixels and sample type of an image file.

    channels : as stored: 1 grey, 2 grey and alpha, 3 colour, 4 colour and alpha
    orientation : the EXIF tag; 1 = as stored
    half_light : light, white being 1, of a value half as large as white, as the file states it
        (tone_curve.py); None where it states none, or of 8 bit none that is linear

    >>> print(Header("PNG", width=1280, height=960, channels=3, dtype="uint8"))
    1280x960x3 uint8
    """

    format: Literal["PNG", "TIFF", "JPEG"]
    width: int
    height: int
    channels: int
    dtype: str
    orientation: int = 1
    half_light: float | None = None

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the decoded array: (height, width), and the channels when there are several."""
        size = (self.height, self.width)
        return size if self.channels == 1 else (*size, self.channels)

    def __str__(self) -> str:
        return f"{self.width}x{self.height}x{self.channels} {self.dtype}"


def read_header(data: bytes, source: str = "") -> Header:
    """The header of a PNG, TIFF or JPEG file; the file's structure is checked to its end.

    Raises CaptureError when it is another format, truncated, has a wrong PNG checksum, claims
    more than 100 megapixels, or stores its samples in a way that rakelight does not read.

    >>> read_header(b"<!DOCTYPE html>", "depth/000.png")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: depth/000.png: not an image file (seen HTML or XML, ...
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
        raise CaptureError("the file is empty", source=source, remedy="copy or export it again")
    seen = what_it_is(data)
    image = seen in (_HEIC, *(name for _, name in _OTHER_IMAGES))
    raise CaptureError(
        "not an image file", source=source, seen=seen, needed="PNG or TIFF",
        remedy="export it as PNG" if image else "copy, download or export it again",
    )  # fmt: skip


def damaged(source: str, how: str) -> CaptureError:
    """The error of a file that is broken."""
    return CaptureError(
        "the image is damaged", source=source, seen=how, remedy="copy or export it again"
    )


def png_chunks(data: bytes, source: str = "") -> Iterator[tuple[bytes, int, int]]:
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


class TiffTags:
    """The integers of the tags that describe one image of a TIFF; raises struct.error.

    directory : where they are listed; if left away, those of the first image.  The attribute
        `following` is where those of the next image are, 0 without one.
    Only what is asked for is read, so that a lying count costs nothing.
    """

    def __init__(self, data: bytes, directory: int | None = None) -> None:
        self.data = data
        self.order: Literal["<", ">"] = "<" if data.startswith(b"II") else ">"
        if directory is None:
            (directory,) = struct.unpack_from(self.order + "I", data, 4)
        (entries,) = struct.unpack_from(self.order + "H", data, directory)
        self.places: dict[int, tuple[np.dtype[np.generic], int, int]] = {}  # dtype, start, count
        self.blocks: dict[int, tuple[int, int]] = {}  # start, count of bytes
        for entry in range(directory + 2, directory + 2 + 12 * entries, 12):
            tag, kind, count = struct.unpack_from(self.order + "HHI", data, entry)
            if kind == _TIFF_UNDEFINED and count > 4:
                (at,) = struct.unpack_from(self.order + "I", data, entry + 8)
                self.blocks.setdefault(tag, (at, count))
            if kind not in _TIFF_INTEGERS or tag in self.places:
                continue
            dtype = np.dtype(self.order + _TIFF_INTEGERS[kind])
            at = entry + 8  # up to four bytes lie in the entry itself
            if dtype.itemsize * count > 4:
                (at,) = struct.unpack_from(self.order + "I", data, at)
            if at + dtype.itemsize * count > len(data):
                raise struct.error("tag outside the file")
            self.places[tag] = dtype, at, count
        after = data[directory + 2 + 12 * entries :][:4]
        self.following = struct.unpack(self.order + "I", after)[0] if len(after) == 4 else 0

    def __contains__(self, name: str) -> bool:
        return _TIFF_TAGS[name] in self.places

    def all(self, name: str) -> list[int]:
        """Every value of a tag; none when it is not there."""
        dtype, at, count = self.places.get(_TIFF_TAGS[name], (np.dtype("B"), 0, 0))
        return [int(value) for value in np.frombuffer(self.data, dtype, count, at)]

    def bytes_of(self, tag: int) -> bytes:
        """The bytes of a tag of undefined type; none when it is not there."""
        at, count = self.blocks.get(tag, (0, 0))
        return self.data[at : at + count]

    def first(self, name: str, default: int) -> int:
        """The first value of a tag."""
        dtype, at, count = self.places.get(_TIFF_TAGS[name], (np.dtype("B"), 0, 0))
        return int(np.frombuffer(self.data, dtype, 1, at)[0]) if count else default


def what_it_is(data: bytes) -> str:
    """What a file is that is none of the images read here, by its first bytes.

    >>> what_it_is(b"PK\\3\\4"), what_it_is(b"")
    ('a ZIP archive', 'an empty file')
    """
    start = data[:64].lstrip()
    if data[4:8] == b"ftyp":
        return _HEIC
    if not data:
        return "an empty file"
    for magic, name in _OTHER_FORMATS:
        if start.startswith(magic):
            return name
    return f"a file that starts with {data[:8]!r}"


def check_size(width: int, height: int, source: str) -> None:
    """Raise CaptureError for an empty image, and for one beyond 100 megapixels."""
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
    length, kind, width, height, bits, colour, compression, filtering, interlace = (
        struct.unpack_from(">I4sIIBBBBB", data, 8)
    )
    sound = kind == b"IHDR" and length == 13 and bits in _PNG_BITS.get(colour, ())
    if not sound or compression != 0 or filtering != 0 or interlace > 1:
        raise damaged(source, "no valid PNG header")
    check_size(width, height, source)
    orientation, view = 1, memoryview(data)
    for chunk, start, end in png_chunks(data, source):
        if zlib.crc32(view[start + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            raise damaged(source, f"wrong checksum at byte {start}")
        if chunk == b"eXIf":
            orientation = _exif_orientation(data[start + 8 : end - 4])
    dtype = "uint16" if bits == 16 else "uint8"
    return Header("PNG", width, height, _PNG_CHANNELS[colour], dtype, orientation)


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
        elif marker == _JPEG_SCAN:
            break
        at += 2 + length
    if header is None:
        raise damaged(source, "no valid JPEG header")
    _check_scans(data, at, source)
    return Header("JPEG", header.width, header.height, header.channels, header.dtype, orientation)


def _check_scans(data: bytes, at: int, source: str) -> None:
    """Raise CaptureError unless the JPEG ends, after few scans, the first of them at `at`.

    What follows its end is not looked at: the video of a phone's motion photo, other pictures.
    """
    scans = 0
    while scans <= _MOST_SCANS:
        marker = _JPEG_MARKER.search(data, at)
        if marker is None:
            raise damaged(source, "the end of the JPEG is missing")
        kind, at = marker[0][1], marker.end()
        if kind == _JPEG_END:
            return
        scans += kind == _JPEG_SCAN
        if kind not in _JPEG_WITHOUT_LENGTH:
            at += int(struct.unpack_from(">H", data, at)[0])
    raise damaged(source, f"more than {_MOST_SCANS} scans")


def _jpeg_frame(data: bytes, at: int, source: str) -> Header:
    bits, height, width, channels = struct.unpack_from(">BHHB", data, at)
    check_size(width, height, source)
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
    tags = TiffTags(data)
    width, height = tags.first("width", 0), tags.first("height", 0)
    check_size(width, height, source)
    if "tile_width" in tags:
        check_size(tags.first("tile_width", 0), tags.first("tile_height", 0), source)
    channels, bits = tags.first("channels", 1), tags.first("bits", 1)
    dtype = _TIFF_DTYPES.get((bits, tags.first("sample_format", 1)))
    photometric = tags.first("photometric", 1)
    if dtype is None or channels not in (1, 3) or photometric not in (1, 2):
        half = ", floating point" if tags.first("sample_format", 1) == 3 else ""
        raise _unread_tiff(
            source,
            seen=f"{channels} channels of {bits} bit{half}, photometric {photometric}",
            needed="grey or RGB without alpha, 8, 16 or 32 bit",
        )
    compression = tags.first("compression", 1)
    if compression not in TIFF_COMPRESSIONS:
        raise _unread_tiff(
            source,
            seen=f"compression {_OTHER_COMPRESSIONS.get(compression, compression)}",
            needed="none, deflate, LZW or PackBits",
        )
    _refuse_others(tags, (width, height), source)
    predictor, fill_order = tags.first("predictor", 1), tags.first("fill_order", 1)
    if predictor not in (1, 2, 3) or (predictor == 3 and dtype[0] != "f") or fill_order != 1:
        raise _unread_tiff(source, seen=f"predictor {predictor}, fill order {fill_order}")
    return Header("TIFF", width, height, channels, dtype, tags.first("orientation", 1))


def _refuse_others(tags: TiffTags, size: tuple[int, int], source: str) -> None:
    """Raise CaptureError where a second image of this size follows, which would be left out."""
    if not tags.following:
        return
    try:
        second = TiffTags(tags.data, tags.following)
    except struct.error:  # no image there
        return
    alike = (second.first("width", 0), second.first("height", 0)) == size
    if alike and not second.first("subfile", 0) & _SMALLER_OR_MASK:
        raise CaptureError(
            "several images in one TIFF", source=source, seen=f"a second of {size[0]}x{size[1]}",
            needed="one in each file", remedy="save each as a file of its own",
        )  # fmt: skip


def _unread_tiff(source: str, *, seen: str, needed: str = "") -> CaptureError:
    return CaptureError(
        "this kind of TIFF is not read",
        source=source,
        seen=seen,
        needed=needed,
        remedy="export it as PNG, or as plain RGB or grey TIFF",
    )


def _exif_orientation(exif: bytes) -> int:
    """The orientation in an EXIF block (a small TIFF); 1 when there is none to be read."""
    try:
        return TiffTags(exif).first("orientation", 1)
    except struct.error:
        return 1
