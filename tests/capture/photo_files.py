"""Photographs in the formats of phones and cameras, each written by the format's own library."""

import io
import struct

import numpy as np
import OpenEXR
import pillow_heif

from rakelight.prepare.linear import srgb


def dng(mosaic, black=0, white=65535, orientation=1, neutral=(1.0, 1.0, 1.0), focal_35mm=0):
    """A DNG: one mosaic (H, W) uint16, red green / green blue, which no library writes."""
    height, width = mosaic.shape
    pixels = np.ascontiguousarray(mosaic, "<u2").tobytes()

    def ratios(code, *values):
        return b"".join(struct.pack("<" + 2 * code, round(1e4 * v), 10_000) for v in values)

    def shorts(*values):
        return struct.pack(f"<{len(values)}H", *values)

    def long(value):
        return struct.pack("<I", value)

    tags = [
        (254, 4, 1, long(0)), (256, 4, 1, long(width)), (257, 4, 1, long(height)),
        (258, 3, 1, shorts(16)), (259, 3, 1, shorts(1)), (262, 3, 1, shorts(32803)),
        (271, 2, 5, b"Test\0"), (272, 2, 5, b"Test\0"), (273, 4, 1, long(0)),
        (274, 3, 1, shorts(orientation)), (277, 3, 1, shorts(1)), (278, 4, 1, long(height)),
        (279, 4, 1, long(len(pixels))), (284, 3, 1, shorts(1)), (33421, 3, 2, shorts(2, 2)),
        (33422, 1, 4, bytes([0, 1, 1, 2])), (41989, 3, 1, shorts(focal_35mm)),
        (50706, 1, 4, bytes([1, 4, 0, 0])), (50707, 1, 4, bytes([1, 1, 0, 0])),
        (50708, 2, 5, b"Test\0"), (50713, 3, 2, shorts(1, 1)), (50714, 4, 1, long(black)),
        (50717, 4, 1, long(white)), (50721, 10, 9, ratios("i", 1, 0, 0, 0, 1, 0, 0, 0, 1)),
        (50728, 5, 3, ratios("I", *neutral)), (50778, 3, 1, shorts(21)),
    ]  # fmt: skip
    at = 8 + 2 + 12 * len(tags) + 4
    outside = sum(len(value) + len(value) % 2 for *_, value in tags if len(value) > 4)
    directory, extra = struct.pack("<H", len(tags)), b""
    for tag, kind, count, value in tags:
        value = long(at + outside) if tag == 273 else value
        if len(value) > 4:
            directory += struct.pack("<HHII", tag, kind, count, at + len(extra))
            extra += value + bytes(len(value) % 2)
        else:
            directory += struct.pack("<HHI", tag, kind, count) + value.ljust(4, b"\0")
    return b"II*\0" + struct.pack("<I", 8) + directory + bytes(4) + extra + pixels


def mosaic_of(light, black=1000, white=16000):
    """(H, W) uint16: what a sensor counts of linear light (H, W, 3), red green / green blue."""
    rows, columns = np.indices(light.shape[:2])
    channel = rows % 2 + columns % 2
    counted = np.take_along_axis(light, channel[..., None], axis=2)[..., 0]
    return np.clip(np.rint(black + (white - black) * counted), 0, white).astype(np.uint16)


def heic(pixels, quality=-1, exif=None):
    """A HEIC of (H, W, 3) uint8, or of uint16 with 10 bits; without loss but for its YCbCr."""
    mode = "RGB" if pixels.dtype == np.uint8 else "RGB;16"
    size = pixels.shape[1], pixels.shape[0]
    image = pillow_heif.from_bytes(mode, size, np.ascontiguousarray(pixels).tobytes())
    file = io.BytesIO()
    image.save(file, quality=quality, chroma=444, **({} if exif is None else {"exif": exif}))
    return file.getvalue()


def heic_of(light, quality=-1):
    """A HEIC, 8 bit, of linear light (H, W, 3)."""
    return heic(np.rint(255 * srgb(light)).astype(np.uint8), quality)


def exr(path, compression=OpenEXR.ZIP_COMPRESSION, windows=None, **channels):
    """Write an EXR of named channels.  windows : (left, top, right, bottom) of data and display"""
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    for name, box in zip(("dataWindow", "displayWindow"), windows or (), strict=False):
        header[name] = (np.array(box[:2], np.int32), np.array(box[2:], np.int32))
    OpenEXR.File(header, {n: np.ascontiguousarray(c) for n, c in channels.items()}).write(str(path))


def pfm(depth):
    """A PFM of (h, w) floats, little-endian, the last row first."""
    height, width = depth.shape
    return f"Pf\n{width} {height}\n-1.0\n".encode() + depth[::-1].astype("<f4").tobytes()
