"""Readers that share no code with rakelight's writers."""

import struct
import zlib

import numpy as np


def read_png(data):
    """Values of a non-interlaced grey or RGB PNG (Pillow cuts 16-bit RGB to 8 bits)."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    position, packed = 8, b""
    while position < len(data):
        length, kind = struct.unpack(">I4s", data[position : position + 8])
        body = data[position + 8 : position + 8 + length]
        if kind == b"IHDR":
            width, height, depth, colour, *_, interlace = struct.unpack(">IIBBBBB", body)
            assert interlace == 0
        elif kind == b"IDAT":
            packed += body
        position += length + 12
    channels = {0: 1, 2: 3}[colour]
    step = channels * depth // 8
    lines = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(height, 1 + width * step)
    above, rows = bytes(width * step), []
    for line in lines:
        above = _unfiltered(int(line[0]), line[1:].tobytes(), above, step)
        rows.append(above)
    values = np.frombuffer(b"".join(rows), f">u{depth // 8}")
    shape = (height, width) if channels == 1 else (height, width, channels)
    return values.reshape(shape).astype(int)


def _unfiltered(kind, line, above, step):
    out = bytearray(line)
    for i in range(len(out)):
        left = out[i - step] if i >= step else 0
        corner = above[i - step] if i >= step else 0
        up = above[i]
        guess = left + up - corner
        paeth = min((left, up, corner), key=lambda value: abs(guess - value))
        predicted = (0, left, up, (left + up) // 2, paeth)[kind]
        out[i] = (out[i] + predicted) & 255
    return bytes(out)


def read_ply(data):
    """Vertices (V, 9: position, normal, colour) and faces (F, 3) of our binary PLY."""
    header, body = data.split(b"end_header\n", 1)
    lines = header.decode("ascii").splitlines()
    assert "format binary_little_endian 1.0" in lines
    counts = {line.split()[1]: int(line.split()[2]) for line in lines if "element" in line}
    vertices = [struct.unpack_from("<6f3B", body, i * 27) for i in range(counts["vertex"])]
    start = counts["vertex"] * 27
    faces = [struct.unpack_from("<B3i", body, start + i * 13) for i in range(counts["face"])]
    assert start + counts["face"] * 13 == len(body)
    assert {face[0] for face in faces} <= {3}
    return np.array(vertices), np.array(faces)[:, 1:]


def from_srgb(code):
    """Linear light of sRGB code values 0..1."""
    code = np.asarray(code, float)
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
