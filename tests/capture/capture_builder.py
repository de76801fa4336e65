"""A small sound capture, and files to damage it with."""

import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from rakelight.capture import load_capture, write_capture
from rakelight.model import Camera, Capture, Lights, Truth

WIDTH, HEIGHT = 32, 24


def small_capture(photographs=4, dtype=np.uint8, factor=2, maps=2, **changes):
    """(N, 24, 32, 3) photographs of middle brightness and depth around 0.6 m."""
    random = np.random.default_rng(7)
    white = np.iinfo(dtype).max
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    mask = (rows - 11.5) ** 2 + (columns - 15.5) ** 2 < 9**2
    depth_m = random.normal(0.6, 0.01, (maps, HEIGHT // factor, WIDTH // factor))
    depth_m[:, 0, 0] = np.nan
    values = random.uniform(0.2, 0.8, (photographs, HEIGHT, WIDTH, 3)) * white
    capture = Capture(
        photographs=values.astype(dtype),
        depth_m=depth_m.astype(np.float32),
        mask=mask,
        camera=Camera(WIDTH, HEIGHT, 40.0, 40.5, 15.25, 11.75),
    )
    return replace(capture, **changes)


def told_apart(capture):
    """The capture with lowest bits changed in a corner: no photograph is a copy of another."""
    photographs = capture.photographs.copy()
    photographs[:, 0, 0, 0] ^= np.arange(len(photographs), dtype=photographs.dtype)
    return replace(capture, photographs=photographs)


def small_truth():
    """Truth for `small_capture`, NaN outside the mask."""
    random = np.random.default_rng(8)
    mask = small_capture().mask
    maps = random.normal(size=(7, HEIGHT, WIDTH)).astype(np.float32)
    maps[:4, ~mask] = np.nan
    return Truth(
        depth=maps[0],
        normals=np.moveaxis(maps[1:4], 0, -1).copy(),
        albedo=np.moveaxis(maps[4:], 0, -1).copy(),
        lights=Lights(
            vector=random.normal(size=(4, 3, 3)),
            ambient=random.normal(size=(4, 3)),
            position_m=random.normal(size=(4, 3, 3)),
            middle_m=random.normal(size=3),
        ),
    )


def build(folder, depth_scale=1000.0, **options):
    """Write `small_capture(**options)` and return the folder."""
    write_capture(small_capture(**options), folder, depth_scale=depth_scale)
    return Path(folder)


def edit_config(folder, old, new):
    """Replace text in capture.toml, which has to be there."""
    path = folder / "capture.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def codes(folder):
    """The codes of what the reader noticed."""
    return [finding.code for finding in load_capture(folder).findings]


def png_chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(width, height, bits, colour_type, rows, extra=b""):
    """A PNG from raw rows (bytes without filter type), for what encoders do not write."""
    header = struct.pack(">IIBBBBB", width, height, bits, colour_type, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row for row in rows))
    chunks = png_chunk(b"IHDR", header) + extra + png_chunk(b"IDAT", data) + png_chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def exif(orientation):
    """A little-endian EXIF block with this orientation only."""
    entry = struct.pack("<HHIHH", 274, 3, 1, orientation, 0)
    return b"II*\0" + struct.pack("<IH", 8, 1) + entry + bytes(4)
