"""Colour and depth of a recording as image files in a folder."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from rakelight.capture.defaults import chosen_encoding
from rakelight.capture.headers import Header, read_header
from rakelight.capture.images import as_rgb, decode_image
from rakelight.capture.listing import SUFFIXES, inside
from rakelight.capture.npy import decode_npy
from rakelight.capture.recording import Stream
from rakelight.capture.tone_curve import read_photograph_header, stated_encoding
from rakelight.errors import CaptureError
from rakelight.files import MAX_BYTES, clear_errors, read_bytes
from rakelight.model import Array, Finding, Floats

NPY = ".npy"
# What a sensor writes into 16 bit that is too far.
_TOO_FAR = 65535
_SAY_ENCODING = "where they are srgb, export them with an sRGB profile, or as 8-bit PNG"
JPEG_FINDING = Finding("note", "compressed", "frames are JPEG; its compression looks like relief")


def read_within(root: Path, name: str, max_bytes: int = MAX_BYTES) -> bytes:
    """The file `name` of the folder `root`, by the rules of `inside`."""
    return read_bytes(inside(root, name), source=f"{root}/{name}", max_bytes=max_bytes)


def numbered_files(
    root: Path, folder: str, suffixes: Sequence[str] = SUFFIXES, alone: bool = False
) -> dict[int, str]:
    """Names of the images in a subfolder by the number in them; empty files are left out.

    alone : whether names that hold more than a number are left out, too
    Raises CaptureError where two have the same number, or there are none.
    """
    source, found = f"{root}/{folder}", dict[int, str]()
    if not (root / folder).is_dir():
        raise CaptureError(
            f"no folder {folder} in it", source=str(root), needed="the recording whole",
            remedy="copy it again with all its folders",
        )  # fmt: skip
    with clear_errors(source, "cannot be read"):
        paths = sorted(p for p in (root / folder).iterdir() if p.suffix.lower() in suffixes)
        # A recording that was broken off ends with files that nothing was written into.
        paths = [p for p in paths if p.name[0] != "." and (p.is_symlink() or p.stat().st_size)]
    for path in paths:
        digits = re.findall(r"[0-9]+", path.stem)
        if not digits or (alone and digits[0] != path.stem):
            continue
        number = int(digits[-1][-18:])
        if number in found:
            raise CaptureError(
                "two images of one number",
                source=source,
                seen=f"{found[number]} and {folder}/{path.name}",
                remedy="remove one of them",
            )
        found[number] = f"{folder}/{path.name}"
    if not found:
        raise CaptureError(
            "no numbered files in it", source=source, needed=" or ".join(suffixes),
            remedy="copy the recording again, whole",
        )  # fmt: skip
    return dict(sorted(found.items()))


def color_stream(
    root: Path, names: Sequence[str], times_s: Floats
) -> tuple[Stream, tuple[Finding, ...]]:
    """The stream of colour images, of one size and encoding, and what to say of them."""
    first = read_photograph_header(read_within(root, names[0]), f"{root}/{names[0]}")
    if first.dtype not in ("uint8", "uint16"):
        raise CaptureError(
            "this kind of image is not read",
            source=f"{root}/{names[0]}",
            seen=first.dtype,
            needed="8 or 16 bit",
            remedy="export the frames as 8-bit PNG or JPEG",
        )

    def walk(wanted: Sequence[int]) -> Iterator[tuple[int, Array]]:
        for number in wanted:
            name, source = names[number], f"{root}/{names[number]}"
            data = read_within(root, name)
            pixels = as_rgb(decode_image(data, source))
            check_same(pixels, (first.height, first.width, 3), first.dtype, source)
            header = read_photograph_header(data, source)
            stated_encoding({names[0]: first, name: header}, str(root))
            yield number, pixels

    stated = stated_encoding({names[0]: first}, str(root))
    kind = "8-bit" if first.dtype == "uint8" else "16-bit"
    encoding, said = chosen_encoding(stated, kind, _SAY_ENCODING)
    if encoding == "srgb":  # as the frames of recordings of every kind
        said = ()
    stream = Stream(times_s, (first.height, first.width), walk, encoding)
    return stream, (*said, *compressed_finding(names))


def depth_stream(
    root: Path,
    names: Sequence[str],
    times_s: Floats,
    scale: float,
    confidence: Mapping[int, str] | None = None,
) -> Stream:
    """The stream of 16-bit depth images, or arrays, of `scale` values per metre, 0 = nothing.

    confidence : by the numbers of the stream, images of the same size where 0 is no measurement
    """
    shape = _depth_shape(root, names[0])

    def walk(wanted: Sequence[int]) -> Iterator[tuple[int, Array]]:
        for number in wanted:
            values = depth_values(root, names[number])
            check_same(values, shape, "uint16", f"{root}/{names[number]}")
            hole = (values == 0) | (values == _TOO_FAR)
            if confidence is not None and number in confidence:
                source = f"{root}/{confidence[number]}"
                sure = decode_image(read_within(root, confidence[number]), source)
                check_same(sure, shape, "uint8", source)
                hole |= sure == 0
            yield number, np.where(hole, np.nan, values / scale).astype(np.float32)

    return Stream(times_s, shape, walk)


def _depth_shape(root: Path, name: str) -> tuple[int, int]:
    """(height, width) of a depth map; raises CaptureError where it is none."""
    if name.lower().endswith(NPY):
        values = depth_values(root, name)
        what, (height, width) = f"array {values.dtype}", values.shape
        is_depth = values.dtype == np.uint16
    else:
        header = _header(root, name)
        what, height, width = f"{header.format} {header}", header.height, header.width
        is_depth = (header.format, header.dtype, header.channels) == ("PNG", "uint16", 1)
    if not is_depth:
        raise CaptureError(
            "this is no depth map",
            source=f"{root}/{name}",
            seen=what,
            needed="16-bit grey PNG",
            remedy="export the depth as 16-bit grey PNG, as the recorder does",
        )
    return height, width


def depth_values(root: Path, name: str) -> Array:
    """A depth map as stored: an image, or an array."""
    data, source = read_within(root, name), f"{root}/{name}"
    return decode_npy(data, source) if name.lower().endswith(NPY) else decode_image(data, source)


def check_same(pixels: Array, shape: tuple[int, ...], dtype: str, source: str) -> None:
    """Raise CaptureError for a frame of another size or kind than the first."""
    if pixels.shape != shape or pixels.dtype != dtype:
        raise CaptureError(
            "the frames are of different kinds",
            source=source,
            seen=f"{pixels.shape} {pixels.dtype}",
            needed=f"{shape} {dtype}, as the first",
            remedy="take the odd ones out",
        )


def compressed_finding(names: Sequence[str]) -> tuple[Finding, ...]:
    """A note where the colour frames are JPEG."""
    if not names[0].lower().endswith((".jpg", ".jpeg")):
        return ()
    return (JPEG_FINDING,)


def _header(root: Path, name: str) -> Header:
    return read_header(read_within(root, name), f"{root}/{name}")
