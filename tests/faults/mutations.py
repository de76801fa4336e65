"""Ways to damage a file, on its outside and behind its checksums."""

from __future__ import annotations

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from random import Random

WILD_NUMBERS = (
    "9" * 5000, "1" + "0" * 400, "1e999", "-1", "0", "nan", "inf", "1e-320", "0x" + "f" * 5000,
    "true", '"', "[" * 1000, "{" * 1000, '{"a":' * 1000, "[]", "null", "2147483648", "1e308",
)  # fmt: skip
WILD_INTEGERS = (0, 1, 127, 128, 255, 256, 32767, 65535, 65536, 2**24, 2**31 - 1, 2**31, 2**32 - 1)


def flip_bits(random: Random, data: bytes) -> bytes:
    """One bit, or a few."""
    damaged = bytearray(data)
    for _ in range(random.choice((1, 1, 2, 8))):
        damaged[random.randrange(len(data))] ^= 1 << random.randrange(8)
    return bytes(damaged)


def truncate(random: Random, data: bytes) -> bytes:
    """The start only, or the start and a few bytes of the end."""
    return data[: random.randrange(len(data))] + data[len(data) - random.choice((0, 2, 12)) :]


def cut_out(random: Random, data: bytes) -> bytes:
    """Without a part in the middle."""
    start = random.randrange(len(data))
    return data[:start] + data[start + random.choice((1, 2, 16, 200)) :]


def insert(random: Random, data: bytes) -> bytes:
    """With a part that does not belong there, or belongs elsewhere."""
    start, count = random.randrange(len(data)), random.choice((1, 2, 16, 200))
    source = random.randrange(len(data))
    added = random.choice((random.randbytes(count), bytes(count), data[source : source + count]))
    return data[:start] + added + data[start:]


def swap_blocks(random: Random, data: bytes) -> bytes:
    """Two neighbouring parts exchanged."""
    size = random.choice((1, 4, 12, 64, 512))
    start = random.randrange(len(data))
    first, second = data[start : start + size], data[start + size : start + 2 * size]
    return data[:start] + second + first + data[start + 2 * size :]


def overwrite(random: Random, data: bytes) -> bytes:
    """A part of zeros, ones or noise, as from a bad sector."""
    start, count = random.randrange(len(data)), random.choice((1, 4, 32, 512))
    filling = random.choice((bytes(count), b"\xff" * count, random.randbytes(count)))
    return data[:start] + filling + data[start + count :]


def lie(random: Random, data: bytes) -> bytes:
    """An integer of 2 or 4 bytes that is not true, mostly in the header."""
    damaged = bytearray(data.ljust(8, b"\0"))
    end = len(damaged) if random.random() < 0.3 else min(len(damaged), 400)
    size = random.choice((2, 4))
    value = random.choice(WILD_INTEGERS) % 256**size
    at = random.randrange(end - size)
    damaged[at : at + size] = value.to_bytes(size, random.choice(("little", "big")))
    return bytes(damaged)


def lie_in_text(random: Random, data: bytes) -> bytes:
    """A number, or another word, replaced by something wild."""
    words = list(re.finditer(rb"-?[0-9][0-9.e+-]*|\"[^\"]*\"|[a-z_]+", data)) or [
        re.match(b"", data)
    ]
    word = random.choice(words)
    return data[: word.start()] + random.choice(WILD_NUMBERS).encode() + data[word.end() :]


BYTES = (flip_bits, flip_bits, truncate, cut_out, insert, swap_blocks, overwrite, lie, lie)
TEXT = (*BYTES, *6 * (lie_in_text,))


def mutated(random: Random, data: bytes, other: bytes) -> bytes:
    """`data` damaged in one or two ways; sometimes joined to a file of another kind."""
    if random.random() < 0.03:
        return data[: random.randrange(len(data))] + other[random.randrange(len(other)) :]
    ways = TEXT if (data[:1].isalpha() and data.isascii()) or data[:1] in (b"{", b"[") else BYTES
    if data.startswith((b"\x89PNG", b"PK")) and random.random() < 0.5:
        return _png(random, data) if data.startswith(b"\x89PNG") else _archive(random, data)
    return apply(random, ways, data)


def apply(random: Random, ways: tuple[Callable[[Random, bytes], bytes], ...], data: bytes) -> bytes:
    """`data` damaged in one of the ways, or in two."""
    for _ in range(random.choice((1, 1, 2))):
        data = random.choice(ways)(random, data or b"\0")
    return data


def _png(random: Random, data: bytes) -> bytes:
    """Damaged inside, the checksums made anew."""
    chunks, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    chosen = random.randrange(len(chunks) - 1)
    kind, body = chunks[chosen]
    if kind == b"IDAT" and random.random() < 0.6:
        body = zlib.compress(apply(random, BYTES, zlib.decompress(body)))
    else:
        body = apply(random, BYTES, body)
    chunks[chosen] = kind, body
    if random.random() < 0.2:
        chunks.insert(random.randrange(len(chunks)), random.choice(chunks))
    return data[:8] + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in chunks
    )


def _archive(random: Random, data: bytes) -> bytes:
    """The same of an archive of arrays."""
    file = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(data)) as old, zipfile.ZipFile(file, "w") as new:
        for name in old.namelist():
            ways = (*BYTES, _lie_in_header, _lie_in_header, _lie_in_header)
            method = random.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))
            # The time is given: the same case has the same bytes tomorrow.
            new.writestr(zipfile.ZipInfo(name), apply(random, ways, old.read(name)), method)
    return file.getvalue()


def _lie_in_header(random: Random, data: bytes) -> bytes:
    """Another shape, type or order in the header of an array."""
    start, end = data.find(b"{"), data.find(b"}")
    descr = random.choice(
        ("|O", "<f2", ">f8", "<M8", "V9", "<U5", "<f16", "|b1", "<c8", "[('a','f4')]")
    )
    shape = random.choice(("(24,)", "()", "(-24, 32)", "(24, 32, 1)", "(99999999, 99999999)"))
    wild = f"({random.choice(WILD_NUMBERS)}, 32)"
    descr = descr if random.random() < 0.5 else "<f4"
    order = random.choice(("True", "False", "7"))
    shape = random.choice((shape, wild, "(24, 32)", "(24L, 32L)", "(32, 24)"))
    header = f"{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}"
    return data[:start] + header.encode().ljust(end + 1 - start) + data[end + 1 :]
