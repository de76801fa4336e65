"""Image bytes to arrays and back, without the surprises of the decoders.

Channels are red, green, blue (, alpha); integer samples keep their 8 or 16 bit; palettes are
expanded; EXIF orientation, colour profiles and the transparent colours of a PNG are ignored, of
which `decode_opacity` tells.
CMYK, TIFF with alpha, and anything but PNG, TIFF and JPEG is refused, and so is every file whose
pixels cannot be read to the last.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import cast

import cv2
import numpy as np

from rakelight.capture.headers import Header, damaged, read_header
from rakelight.capture.png import opacity_as_palette, plain_png, transparent_colour
from rakelight.capture.tiff import decode_tiff
from rakelight.errors import InputError, MachineError
from rakelight.model import Array

_SILENT = 0  # OpenCV's log level


def decode_image(data: bytes, source: str = "") -> Array:
    """The pixels of a PNG, TIFF or JPEG file, exactly as stored.

    Parameters
    ----------
    data : the whole file
    source : its name, for messages

    Returns
    -------
    (H, W) grey or (H, W, C), C = 2 grey and alpha, 3 RGB, 4 RGBA; the sample type of the file

    Raises
    ------
    CaptureError
        another format, damaged, truncated, more than 100 megapixels, or a kind not read

    Examples
    --------
    >>> red = np.zeros((1, 2, 3), np.uint16)
    >>> red[..., 0] = 65535
    >>> decode_image(encode_png(red)).tolist()
    [[[65535, 0, 0], [65535, 0, 0]]]
    """
    header = read_header(data, source)
    try:
        if header.format == "TIFF":
            pixels = decode_tiff(data, header, source)
        elif header.format == "JPEG":
            pixels = _decode_jpeg(data, header, source)
        else:
            pixels = _decode_png(plain_png(data, source), header, source)
    except MemoryError as error:
        raise MachineError("too little memory to decode the image", source=source) from error
    if pixels.shape != header.shape or pixels.dtype != header.dtype:
        raise damaged(source, f"{header}, decoded as {pixels.shape} {pixels.dtype}")
    return pixels


def decode_opacity(data: bytes, source: str = "") -> Array | None:
    """(H, W) how opaque each pixel of a PNG is, 0 = not at all; None where the file does not say.

    By its alpha channel, or by the colours that it says to be transparent.  The parameters and the
    errors are those of `decode_image`.

    >>> decode_opacity(encode_png(np.full((1, 2, 4), 7, np.uint8))).tolist()
    [[7, 7]]
    """
    header = read_header(data, source)
    if header.channels in (2, 4):
        return decode_image(data, source)[..., -1]
    if header.format != "PNG":
        return None
    opacities = opacity_as_palette(data, source)
    if opacities is not None:
        return decode_image(opacities, source)[..., 0]
    colour = transparent_colour(data, source)
    if colour is None:
        return None
    pixels = decode_image(data, source).reshape(header.height, header.width, -1)
    transparent = (pixels == np.array(colour, pixels.dtype)).all(axis=2)
    return np.where(transparent, np.uint8(0), np.uint8(255))


def _decode_jpeg(data: bytes, header: Header, source: str) -> Array:
    """By libjpeg with its default (exact) settings; what it complains of is an error."""
    from simplejpeg import decode_jpeg

    colours = "GRAY" if header.channels == 1 else "RGB"
    try:
        pixels = decode_jpeg(data, colours, fastdct=False, fastupsample=False, strict=True)
    except ValueError as error:
        raise damaged(source, str(error)) from error
    return np.asarray(pixels).reshape(header.shape)


def _decode_png(data: bytes, header: Header, source: str) -> Array:
    try:
        with _quiet_opencv():
            # Any other flag would cut 16 bit to 8 or drop channels.
            decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        decoded = None
    if decoded is None:
        raise damaged(source, "its PNG data cannot be decoded")
    pixels = np.asarray(decoded)
    if header.channels == 2:  # decoded as blue, green, red, alpha
        return np.ascontiguousarray(pixels[..., 2:])
    return _reversed_colours(pixels, out=pixels)


def as_rgb(pixels: Array) -> Array:
    """(H, W, 3) of what `decode_image` returns: grey repeated, alpha dropped.

    >>> as_rgb(np.array([[7]], np.uint8)).tolist()
    [[[7, 7, 7]]]
    """
    if pixels.ndim == 2:
        return np.repeat(pixels[..., None], 3, axis=2)
    if pixels.shape[2] == 2:
        return np.repeat(pixels[..., :1], 3, axis=2)
    return pixels[..., :3]


def encode_png(pixels: Array) -> bytes:
    """A PNG file of (H, W) grey, (H, W, 3) RGB or (H, W, 4) RGBA, uint8 or uint16; lossless.

    >>> encode_png(np.zeros((2, 2), np.uint8))[:4]
    b'\\x89PNG'
    """
    _check_encodable(pixels, "PNG", (np.dtype(np.uint8), np.dtype(np.uint16)), (3, 4))
    return _encode(".png", pixels, [])


def encode_jpeg(pixels: Array, quality: int = 88) -> bytes:
    """A JPEG file of (H, W) grey or (H, W, 3) RGB, uint8, for pictures that people look at.

    >>> encode_jpeg(np.zeros((2, 2), np.uint8))[:2].hex()
    'ffd8'
    """
    _check_encodable(pixels, "JPEG", (np.dtype(np.uint8),), (3,))
    return _encode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])


def encode_tiff(pixels: Array) -> bytes:
    """A TIFF file of (H, W) or (H, W, 3) float32; lossless, NaN included, channels in order.

    >>> depth_m = np.array([[0.5, np.nan]], np.float32)
    >>> decode_image(encode_tiff(depth_m)).tolist()
    [[0.5, nan]]
    """
    _check_encodable(pixels, "TIFF", (np.dtype(np.float32),), (3,))
    # Given explicitly: OpenCV 4 writes three float channels as lossy LogLuv otherwise, and its
    # floating-point predictor is read by few programs.
    deflate = [cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_ADOBE_DEFLATE]
    return _encode(".tiff", pixels, [*deflate, cv2.IMWRITE_TIFF_PREDICTOR, 1])


def _encode(suffix: str, pixels: Array, options: list[int]) -> bytes:
    try:
        done, encoded = cv2.imencode(suffix, _reversed_colours(pixels), options)
    except (cv2.error, MemoryError) as error:
        raise MachineError(f"too little memory to write a {suffix} image") from error
    if not done:
        raise MachineError(f"the {suffix} image could not be encoded")
    return encoded.tobytes()


def _check_encodable(
    pixels: Array, kind: str, dtypes: tuple[np.dtype[np.generic], ...], channels: tuple[int, ...]
) -> None:
    shaped = pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] in channels)
    if not shaped or pixels.size == 0 or pixels.dtype not in dtypes:
        raise InputError(
            f"this array is not written as {kind}",
            seen=f"{pixels.shape} {pixels.dtype}",
            needed=" or ".join(map(str, dtypes)) + f", 1 or {channels} channels",
        )


def _reversed_colours(pixels: Array, out: Array | None = None) -> Array:
    """RGB(A) <-> BGR(A), contiguous; grey as it is.  Into `out` where that can be."""
    if pixels.ndim == 2:
        return np.ascontiguousarray(pixels)
    order = [2, 1, 0, 3][: pixels.shape[2]]
    if pixels.dtype in (np.uint8, np.uint16, np.float32):  # the types that cvtColor knows
        code = cv2.COLOR_BGR2RGB if len(order) == 3 else cv2.COLOR_BGRA2RGBA
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), code, out))
    return np.ascontiguousarray(pixels[..., order])


class _Quiet:
    """How many decoders run at this moment, and the log level to go back to."""

    lock = threading.Lock()
    running = 0
    level = 0


@contextmanager
def _quiet_opencv() -> Iterator[None]:
    """Keep OpenCV from printing about images that we report ourselves."""
    set_level = _set_log_level()
    with _Quiet.lock:
        if _Quiet.running == 0:
            _Quiet.level = set_level(_SILENT)
        _Quiet.running += 1
    try:
        yield
    finally:
        with _Quiet.lock:
            _Quiet.running -= 1
            if _Quiet.running == 0:
                set_level(_Quiet.level)


def _set_log_level() -> Callable[[int], int]:
    """OpenCV's function that sets the log level and returns the one before."""
    if hasattr(cv2, "setLogLevel"):  # OpenCV 4
        return cast(Callable[[int], int], cv2.setLogLevel)
    return cv2.utils.logging.setLogLevel
