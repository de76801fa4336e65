"""The pictures in messages of ROS: sensor_msgs/Image and CompressedImage."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal

import cv2
import numpy as np

from rakelight.capture.headers import MAX_PIXELS, PNG_MAGIC
from rakelight.capture.images import as_rgb, decode_image
from rakelight.capture.readers.ros_bag import AGAIN, LONGEST, Bag, unpacked_zstd
from rakelight.capture.recording import Stream
from rakelight.errors import CaptureError, parsing
from rakelight.model import Array, Camera, Floats

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")

# Bytes per pixel and how RGB is made of them, by the names of ROS and of librealsense.
_COLOURS: dict[str, tuple[int, str | int]] = {
    "rgb8": (3, "RGB"),
    "bgr8": (3, "BGR"),
    "rgba8": (4, "RGB"),
    "bgra8": (4, "BGR"),
    "mono8": (1, "grey"),
    "8uc1": (1, "grey"),
    "y8": (1, "grey"),
    "yuyv": (2, cv2.COLOR_YUV2RGB_YUY2),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUY2),
    "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
}
_DEPTHS, _FLOAT = ("16uc1", "mono16", "z16"), "32fc1"
# What librealsense writes of pictures that PNG cannot hold: "YUYV; zstd; 640x480 step=1280".
_ZSTD = re.compile(r"(\w+); zstd; ([0-9]{1,6})x([0-9]{1,6}) step=([0-9]{1,8})")
# Bytes before the PNG of a depth map: a quantisation of ROS that 16 bit depth does not use, and
# that some writers leave out.
_DEPTH_HEADERS = (0, 12)
_MILLIMETRES, _TOO_FAR = 1000.0, 65535
_JPEG, _JPEG_MAGIC = "mjpeg", b"\xff\xd8\xff"


def stream_of(
    bag: Bag, name: str, camera: Camera, start_ns: int, pixels: Callable[[Any, str], Array]
) -> Stream:
    """The pictures of a topic, which are of the camera's size; times are from `start_ns` on."""

    def walk(wanted: Sequence[int]) -> Iterator[tuple[int, Array]]:
        for number in wanted:
            frame = f"{bag.source}, frame {number} of {name}"
            image = pixels(bag.message(name, number, IMAGES), frame)
            if image.shape[:2] != camera.shape:
                raise CaptureError(
                    "its size is not that of its camera",
                    source=frame,
                    seen=f"{image.shape[1]} x {image.shape[0]}",
                    needed=f"{camera.width} x {camera.height}",
                    remedy=AGAIN,
                )
            yield number, image

    # When the frames arrived: the one clock that the two cameras of a device always share.
    return Stream((bag.topics[name].times_ns - start_ns) / 1e9, camera.shape, walk)


def color_of(message: Any, source: str) -> Array:
    """(H, W, 3) uint8 RGB of a message; raises CaptureError.

    source : names the frame in messages
    """
    jpeg = _jpeg(message, source)
    if jpeg is not None:
        return as_rgb(decode_image(jpeg, source))
    packed = _png(message, source, befores=(0,))
    if packed is not None:
        if packed.dtype != np.uint8:
            raise _not_read(f"{packed.dtype} PNG", "colour with 8 bits", source)
        return as_rgb(packed)
    encoding, rows, (height, width) = _raw(message, source)
    if encoding not in _COLOURS:
        raise _not_read(encoding, "one of " + ", ".join(_COLOURS), source)
    channels, how = _COLOURS[encoding]
    pixels = _cut(rows, height, width, channels, source)
    if how == "grey":
        return as_rgb(pixels[..., 0])
    if isinstance(how, int):
        if width % 2:
            raise _not_read(f"{width} columns of {encoding}", "an even number", source)
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), how))
    return np.ascontiguousarray(pixels[..., 2::-1] if how == "BGR" else pixels[..., :3])


def depth_of(message: Any, source: str) -> Array:
    """(h, w) uint16 as stored, of a message; raises CaptureError.

    source : names the frame in messages
    """
    packed = _png(message, source, _DEPTH_HEADERS)
    if packed is not None:
        if packed.dtype != np.uint16 or packed.ndim != 2:
            raise _not_read(f"{packed.dtype} PNG {packed.shape}", "depth with 16 bits", source)
        return packed
    encoding, rows, (height, width) = _raw(message, source)
    if encoding not in _DEPTHS:
        raise _not_read(encoding, "one of " + ", ".join(_DEPTHS), source)
    pixels = np.ascontiguousarray(_cut(rows, height, width, 2, source))
    order: Literal[">u2", "<u2"] = ">u2" if getattr(message, "is_bigendian", 0) else "<u2"
    return pixels.view(order)[..., 0].astype(np.uint16)


def is_depth(message: Any) -> bool:
    """Whether a picture holds depth by its encoding."""
    encoding: str = message.format if hasattr(message, "format") else message.encoding
    return encoding.lower().startswith((*_DEPTHS, _FLOAT))


def metres_of(message: Any, source: str) -> Floats:
    """(h, w) float32 metres of a node's message, NaN = no measurement; raises CaptureError.

    16 bits are millimetres, floating point metres (REP 118).
    """
    packed = hasattr(message, "format")
    if not (message.format if packed else message.encoding).lower().startswith(_FLOAT):
        values = depth_of(message, source)
        metres = np.where(values < _TOO_FAR, values / _MILLIMETRES, np.nan)
    elif packed:
        metres = _inverted(message, source)
    else:
        _, rows, (height, width) = _raw(message, source)
        pixels = np.ascontiguousarray(_cut(rows, height, width, 4, source))
        metres = pixels.view(">f4" if message.is_bigendian else "<f4")[..., 0]
    return np.where(np.isfinite(metres) & (metres > 0), metres, np.nan).astype(np.float32)


def _inverted(message: Any, source: str) -> Floats:
    """(h, w) metres of a PNG of inverse depth, quantised as the 12 bytes before it say."""
    values = _png(message, source, _DEPTH_HEADERS[1:])
    if values is None or values.dtype != np.uint16 or values.ndim != 2:
        raise _not_read(message.format, "compressedDepth as PNG", source)
    _, a, b = struct.unpack("<iff", message.data[: _DEPTH_HEADERS[1]].tobytes())
    with np.errstate(all="ignore"):
        return np.where(values > 0, a / (values - np.float64(b)), np.nan)


def _png(message: Any, source: str, befores: tuple[int, ...]) -> Array | None:
    """The pixels of a CompressedImage that holds a PNG after so many bytes; None of others."""
    if not hasattr(message, "format"):
        return None
    for before in befores:
        data = message.data[before:].tobytes()
        if data.startswith(PNG_MAGIC):
            return decode_image(data, source)
    return None


def _jpeg(message: Any, source: str) -> bytes | None:
    """The JPEG that a message holds: as it is, or packed as librealsense does; None of others."""
    if not hasattr(message, "format"):
        return message.data.tobytes() if message.encoding.lower() == _JPEG else None
    data: bytes = message.data.tobytes()
    if data.startswith(_JPEG_MAGIC):
        return data
    stated = _ZSTD.fullmatch(message.format)
    if stated is None or stated[1].lower() != _JPEG:
        return None
    with parsing(source, "its JPEG cannot be unpacked", CaptureError):
        return unpacked_zstd(data, LONGEST, fewer=True)


def _raw(message: Any, source: str) -> tuple[str, Array, tuple[int, int]]:
    """The encoding, (height, step) bytes, and (height, width) of a picture without PNG."""
    if hasattr(message, "format"):
        stated = _ZSTD.fullmatch(message.format)
        if stated is None:
            raise _not_read(message.format, "PNG, JPEG, or raw pixels packed by Zstandard", source)
        encoding = stated[1]
        width, height, step = (int(number) for number in stated.groups()[1:])
        _check_size(height, width, step, source)
        with parsing(source, "its pixels cannot be unpacked", CaptureError):
            data = np.frombuffer(unpacked_zstd(message.data.tobytes(), height * step), np.uint8)
    else:
        encoding, data = message.encoding, message.data
        width, height, step = message.width, message.height, message.step
        _check_size(height, width, step, source)
    if data.size != height * step:
        raise _cut_off(f"{data.size} bytes", f"{height} rows of {step}", source)
    return encoding.lower(), data.reshape(height, step), (height, width)


def _check_size(height: int, width: int, step: int, source: str) -> None:
    if not (0 < height * width <= MAX_PIXELS and 0 < height * step <= LONGEST):
        seen = f"{width} x {height}, {step} bytes each row"
        raise _cut_off(seen, f"at most {LONGEST / 1e6:.0f} MB", source)


def _cut(rows: Array, height: int, width: int, channels: int, source: str) -> Array:
    """(height, width, channels) uint8 without what fills the rows up."""
    if rows.shape[1] < width * channels:
        needed = f"{width} x {channels}"
        raise _cut_off(f"{rows.shape[1]} bytes each row", needed, source)
    return rows[:, : width * channels].reshape(height, width, channels)


def _not_read(seen: str, needed: str, source: str) -> CaptureError:
    return CaptureError(
        "this kind of picture is not read",
        source=source,
        seen=seen,
        needed=needed,
        remedy="record colour as RGB8, BGR8, Y8, YUYV or MJPEG and depth as Z16",
    )


def _cut_off(seen: str, needed: str, source: str) -> CaptureError:
    return CaptureError(
        "its size is not what it says",
        source=source,
        seen=seen,
        needed=needed,
        remedy=AGAIN,
    )
