"""The tone curve that a PNG or TIFF states: its ICC profile, or PNG's own chunks.

Photo editors write 16 bit as sRGB, Adobe RGB or ProPhoto RGB, with a profile.  Of 8 bit only a
linear curve is looked at: all others count as sRGB, as those of cameras and phones are.  PNG's
chunks come in the order of its specification (third edition, 4.3): cICP, iCCP, sRGB, gAMA.  Of gAMA
only a linear one of 8 bit is looked at: converters write sRGB's into linear images of 16 bit, too.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from rakelight.capture.headers import PNG_MAGIC, Header, TiffTags, png_chunks, read_header
from rakelight.errors import CaptureError, printable
from rakelight.model import Encoding, Finding

# Light, white being 1, of a value half as large as white: linear, sRGB.  Adobe RGB's is within a
# hundredth of sRGB's (0.218), ProPhoto RGB's (0.287) and BT.709's (0.260) are not.
_HALF: dict[Encoding, float] = {"linear": 0.5, "srgb": 0.214}
_ALIKE = 0.01
_CICP_HALF = {8: _HALF["linear"], 13: _HALF["srgb"]}  # by H.273's codes of transfer
_GAMA_LINEAR = 100_000  # an exponent of 1, in 100,000ths
_ICC_TAG, _MOST_PROFILE_BYTES = 34675, 5_000_000


def half_light(data: bytes) -> float | None:
    """The light, white being 1, of a value half as large as white; None where a file states none.

    data : of a PNG or TIFF.  A profile that is damaged, or has no curve, states none.

    >>> half_light(PNG_MAGIC) is None
    True
    """
    try:
        if data.startswith(PNG_MAGIC):
            return _of_png(data)
        profile = TiffTags(data).bytes_of(_ICC_TAG)
        return _of_profile(profile) if profile else None
    except (struct.error, zlib.error, ValueError, IndexError, ArithmeticError, CaptureError):
        return None


def read_photograph_header(data: bytes, source: str = "") -> Header:
    """`read_header`, and the tone curve that the file states; raises CaptureError."""
    header = read_header(data, source)
    half = half_light(data) if header.dtype in ("uint8", "uint16") else None
    if header.dtype == "uint8" and _encoding(half) != "linear":
        half = None
    return replace(header, half_light=half)


def stated_encoding(headers: Mapping[str, Header], source: str) -> Encoding | None:
    """The encoding that images (name -> header) state; None where none states any.

    Raises CaptureError for different curves, and for one that is neither linear nor sRGB's.

    >>> stated_encoding({"0.png": Header("PNG", 4, 3, 3, "uint16", half_light=0.218)}, "rgb")
    'srgb'
    """
    halves = {header.half_light for header in headers.values()}
    if halves == {None}:
        return None
    found = {_encoding(half) for half in halves}
    if len(found) == 1 and (encoding := found.pop()) is not None:
        return encoding
    described = (f"{name} {_described(header.half_light)}" for name, header in headers.items())
    raise CaptureError(
        "the tone curve of the photographs is not read",
        source=source,
        seen=_few(described),
        needed="all linear, or all sRGB",
        remedy="export all of them with an sRGB or a linear profile, or none",
    )


def contradicted(headers: Mapping[str, Header], given: Encoding) -> tuple[Finding, ...]:
    """A warning where images (name -> header) state another encoding than the one that is given.

    >>> adobe = Header("TIFF", 4, 3, 3, "uint16", half_light=0.218)
    >>> [finding.code for finding in contradicted({"rgb/0.tiff": adobe}, "linear")]
    ['encoding-contradicted']
    """
    halves = ((name, header.half_light) for name, header in headers.items())
    stated = [(name, half) for name, half in halves if half is not None]
    others = [(name, half) for name, half in stated if _encoding(half) != given]
    if not others:
        return ()
    name, half = others[0]
    message = (
        f"the photographs are said to be {given}, of which half of white is {_HALF[given]:.2f} of "
        f"its light; {printable(name)} comes {_described(half)}"
    )
    remedy = "leave `encoding` out of capture.toml where the profile is right"
    return (Finding("warning", "encoding-contradicted", message, remedy),)


def _encoding(half: float | None) -> Encoding | None:
    near = (name for name, at in _HALF.items() if half is not None and abs(half - at) < _ALIKE)
    return next(near, None)


def _described(half: float | None) -> str:
    if half is None:
        return "without a profile"
    return f"with a profile by which half of white is {half:.2f} of its light"


def _few(each: Iterable[str]) -> str:
    first, *others = each
    other = next((one for one in others if one.partition(" ")[2] != first.partition(" ")[2]), "")
    return f"{first}; {other}" if other else first


def _of_png(data: bytes) -> float | None:
    chunks: dict[bytes, bytes] = {}
    for kind, start, end in png_chunks(data):
        if kind == b"IDAT":
            break
        chunks.setdefault(kind, data[start + 8 : end - 4])
    if b"cICP" in chunks:
        return _CICP_HALF.get(chunks[b"cICP"][1], 0.0)  # others are of film and video
    if b"iCCP" in chunks:
        name, _, packed = chunks[b"iCCP"].partition(b"\0")
        unpack = zlib.decompressobj()
        return _of_profile(unpack.decompress(packed[1:], _MOST_PROFILE_BYTES)) if name else None
    if b"sRGB" in chunks:
        return _HALF["srgb"]
    if b"gAMA" in chunks and chunks[b"IHDR"][8] == 8:
        (gamma,) = struct.unpack(">I", chunks[b"gAMA"])
        return _HALF["linear"] if gamma == _GAMA_LINEAR else None
    return None


def _of_profile(profile: bytes) -> float | None:
    """Of an ICC profile: the curve of green, or of grey (ICC.1:2010, 10.5 and 10.15)."""
    (count,) = struct.unpack_from(">I", profile, 128)
    for entry in range(132, 132 + 12 * min(count, 100), 12):
        name, at, _ = struct.unpack_from(">4sII", profile, entry)
        if name in (b"gTRC", b"kTRC"):
            kind = profile[at : at + 4]
            return _of_table(profile, at) if kind == b"curv" else _of_formula(profile, at)
    return None


def _of_table(profile: bytes, at: int) -> float:
    """Of a curve of type curv: none, an exponent, or a table."""
    (count,) = struct.unpack_from(">I", profile, at + 8)
    if count == 0:
        return 0.5
    if count == 1:
        (exponent,) = struct.unpack_from(">H", profile, at + 12)
        return float(0.5 ** (exponent / 256))
    table = np.frombuffer(profile, ">u2", count, at + 12) / 65535
    return float(np.interp(0.5, np.linspace(0, 1, count), table))


def _of_formula(profile: bytes, at: int) -> float | None:
    """Of a curve of type para, whose half is on its power law."""
    if profile[at : at + 4] != b"para":
        return None
    (form,) = struct.unpack_from(">H", profile, at + 8)
    numbers = {0: 1, 1: 3, 2: 4, 3: 5, 4: 7}.get(form)
    if numbers is None:
        return None
    values = [value / 65536 for value in struct.unpack_from(f">{numbers}i", profile, at + 12)]
    values += (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)[numbers - 1 :]
    exponent, a, b, c, d, e, _ = values
    if form >= 3 and d > 0.5:
        return None  # linear up to beyond the half: no curve of a photograph
    offset = {2: c, 4: e}.get(form, 0.0)
    return float(max(a * 0.5 + b, 0.0) ** exponent + offset)
