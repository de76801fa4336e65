"""OpenEXR: linear light as half or float, and depth in a channel Z."""

from __future__ import annotations

import io
import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from rakelight.capture.headers import check_size, damaged
from rakelight.errors import CaptureError
from rakelight.model import Array

MAGIC = b"v/1\x01"
# Bits of the version field: deep data and several parts are other files than ours.
_DEEP, _SEVERAL_PARTS = 0x800, 0x1000
_MOST_ATTRIBUTES = 1000
_DEPTH = re.compile(r"(?:.*\.)?(?:Z|depth(?:\.[VYZ])?)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ExrHeader:
    """Size in pixels and the channels of an OpenEXR file.

    width, height : of the picture, which is the display window
    stored : (left, top, width, height) of the pixels that the file has, the data window, in the
        picture; it may be smaller (programs cut off what is empty) or larger
    color : names of red, green and blue (three times the same for grey); () where there are none
    depth : name of the depth, "" where there is none
    """

    width: int
    height: int
    stored: tuple[int, int, int, int]
    color: tuple[str, ...]
    depth: str


def read_exr_header(data: bytes, source: str = "") -> ExrHeader:
    """The header of an OpenEXR file; raises CaptureError where it is none of ours.

    >>> read_exr_header(MAGIC + bytes(4), "a.exr")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: a.exr: the image is damaged (seen no size or no channels). ...
    """
    try:
        magic, version = struct.unpack_from("<4sI", data)
        if magic != MAGIC:
            raise damaged(source, "not an OpenEXR")
        if version & (_DEEP | _SEVERAL_PARTS):
            raise CaptureError(
                "this kind of EXR is not read",
                source=source,
                seen="deep data or several parts",
                needed="one image",
                remedy="export one plain image",
            )
        attributes = _attributes(data)
        picture, stored = (_window(attributes, name) for name in ("displayWindow", "dataWindow"))
        names = _channel_names(attributes.get("channels", b""))
    except (struct.error, ValueError, IndexError) as error:
        raise damaged(source, "no size or no channels") from error
    for _, _, width, height in (picture, stored):
        check_size(width, height, source)
    depth = sorted((name for name in names if _DEPTH.fullmatch(name)), key=len)
    color = _color(names)
    if len(names) == 1 and not color:  # such as R alone, as Record3D exports depth
        depth = list(names)
    place = (stored[0] - picture[0], stored[1] - picture[1], *stored[2:])
    return ExrHeader(*picture[2:], place, color, depth[0] if depth else "")


def _window(attributes: dict[str, bytes], name: str) -> tuple[int, int, int, int]:
    """(left, top, width, height) of a box, whose right and bottom belong to it."""
    left, top, right, bottom = struct.unpack("<4i", attributes.get(name, b"")[:16])
    return left, top, right - left + 1, bottom - top + 1


def _attributes(data: bytes) -> dict[str, bytes]:
    """Name -> value of the header's attributes."""
    found: dict[str, bytes] = {}
    at = 8
    for _ in range(_MOST_ATTRIBUTES):
        if data[at] == 0:
            return found
        end = data.index(0, at, at + 256)
        name = data[at:end].decode("latin-1")
        at = data.index(0, end + 1, end + 257) + 1
        (size,) = struct.unpack_from("<I", data, at)
        if at + 4 + size > len(data):
            raise ValueError("cut short")
        found[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    raise ValueError("too many attributes")


def _channel_names(value: bytes) -> tuple[str, ...]:
    names: list[str] = []
    at = 0
    while value[at] != 0:
        end = value.index(0, at)
        names.append(value[at:end].decode("latin-1"))
        at = end + 1 + 16
    return tuple(names)


def _color(names: tuple[str, ...]) -> tuple[str, ...]:
    """Red, green and blue: the plain ones, those of the first layer, or Y."""
    layers = ["", *sorted(name[:-1] for name in names if name.endswith(".R"))]
    for layer in layers:
        color = tuple(layer + channel for channel in "RGB")
        if set(color) <= set(names):
            return color
    return ("Y", "Y", "Y") if "Y" in names else ()


def decode(data: bytes) -> tuple[dict[str, Array], dict[str, Any]]:
    """`color` (H, W, 3) and `depth` (H, W), float32, those that there are; 0 where none is stored.

    To be called in `decoder_child` only.
    """
    import OpenEXR

    header = read_exr_header(data)
    left, top, width, height = header.stored
    channels = OpenEXR.File(io.BytesIO(data), separate_channels=True, num_threads=0).channels()

    def pixels(name: str) -> Array:
        values = np.asarray(channels[name].pixels)
        if values.dtype.kind != "f" or values.shape != (height, width):
            raise CaptureError(
                "this kind of EXR is not read",
                seen=f"channel {name}: {values.shape} {values.dtype}",
                needed="half or float, one value per pixel",
                remedy="export one plain image",
            )
        with np.errstate(invalid="ignore"):  # of NaN with unusual bits
            values = values.astype(np.float32)
        if header.stored == (0, 0, header.width, header.height):
            return values
        picture = np.zeros((header.height, header.width), np.float32)
        seen = values[max(-top, 0) :, max(-left, 0) :]
        shown = picture[max(top, 0) :, max(left, 0) :][: len(seen), : seen.shape[1]]
        shown[...] = seen[: len(shown), : shown.shape[1]]
        return picture

    arrays = {}
    if header.color:
        arrays["color"] = np.stack([pixels(name) for name in header.color], axis=-1)
    if header.depth:
        arrays["depth"] = pixels(header.depth)
    return arrays, {}
