"""Files that once hung the program, or ended it with something else than one clear line."""

import os
import socket
import struct
import tracemalloc
import zipfile
import zlib

import numpy as np
import pytest

from rakelight.capture import load_capture, load_truth
from rakelight.capture.images import decode_image
from rakelight.errors import InputError
from rakelight.export import load_result
from rakelight.files import read_bytes
from rakelight.synthetic.depth_file import shape_from_file
from tests.faults.sound_files import DEPTH_M, make_kinds


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Folder of all files; whoever changes one puts it back."""
    folder = tmp_path_factory.mktemp("sound") / "files"
    make_kinds(folder)
    return folder


@pytest.fixture
def changed(sound):
    """Function that replaces a file for this test, or removes it."""
    kept = {}

    def change(name, content=None):
        path = sound / name
        kept[path] = path.read_bytes()
        path.unlink()
        if content is not None:
            path.write_bytes(content)
        return path

    yield change
    for path, content in kept.items():
        if path.is_dir() and not path.is_symlink():
            path.rmdir()
        elif os.path.lexists(path):
            path.unlink()
        path.write_bytes(content)


def refusal(read, *arguments):
    with pytest.raises(InputError) as caught:
        read(*arguments)
    line = str(caught.value)
    assert caught.value.exit_code == 2
    assert line.isprintable()
    assert len(line) < 2000
    return line


def chunk(kind, body):
    """Of a PNG."""
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


# --- what is no file ---

READERS = {
    "capture/mask.png": ("capture", load_capture),
    "capture/capture.toml": ("capture", load_capture),
    "capture/rgb/001.png": ("capture", load_capture),
    "capture/depth/001.png": ("capture", load_capture),
    "capture/truth/depth.tiff": ("capture", load_truth),
    "capture/truth/lights.json": ("capture", load_truth),
    "result/depth.tiff": ("result", load_result),
    "result/confidence.png": ("result", load_result),
    "result/depth_sigma.tiff": ("result", load_result),
    "result/lights.json": ("result", load_result),
    "result/albedo.png": ("result", load_result),
    "result/result.json": ("result", load_result),
    "stored.npz": ("stored.npz", shape_from_file),
    "shape.tiff": ("shape.tiff", shape_from_file),
}


def bind_socket(path, monkeypatch):
    monkeypatch.chdir(path.parent)  # the name of a socket is short
    socket.socket(socket.AF_UNIX).bind(path.name)


THINGS = {
    "a pipe": lambda path, _: os.mkfifo(path),
    "a folder": lambda path, _: path.mkdir(),
    "a socket": bind_socket,
    "a device": lambda path, _: path.symlink_to("/dev/zero"),
    "No such file": lambda path, _: path.symlink_to("nowhere"),
}


@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.parametrize("thing", THINGS)
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_file(sound, changed, name, thing, monkeypatch):
    THINGS[thing](changed(name), monkeypatch)
    folder, read = READERS[name]
    line = refusal(read, sound / folder)
    if name != "result/result.json":  # without it a folder is no result
        assert line.startswith(str(sound / name))
        assert thing in line


def test_files_larger_than_any_of_ours(sound, changed):
    for name, (folder, read) in READERS.items():
        with changed(name, b"").open("wb") as file:
            file.truncate(2_000_000_000)
        assert "file too large (seen 2000 MB" in refusal(read, sound / folder)
    assert "at most 10 MB" in refusal(load_result, sound / "result")


def test_a_pipe_that_comes_later_keeps_nobody_waiting(tmp_path, monkeypatch):
    """Between the look at its kind and the opening."""
    monkeypatch.setattr("rakelight.files._require_regular", lambda mode, source: None)
    os.mkfifo(tmp_path / "pipe")
    assert read_bytes(tmp_path / "pipe") == b""


def test_a_mask_that_is_a_bomb(sound, changed):
    """100 megapixels in a file of 100 kB: its size is wrong, and nothing is unpacked."""
    side = 10_000
    rows = zlib.compress(bytes((1 + side) * side), 9)
    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    chunks = chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    changed("capture/mask.png", b"\x89PNG\r\n\x1a\n" + chunks)
    tracemalloc.start()
    assert "another size than the photographs" in refusal(load_capture, sound / "capture")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


# --- text ---

NINES, POWER = "9" * 5000, "1" + "0" * 400


@pytest.mark.parametrize("number", [NINES, POWER, "0x" + "f" * 5000, "-" + NINES, "1e999"])
@pytest.mark.parametrize(
    "line", ["fx = 40.0", "width = 32", 'encoding = "linear"', "depth_scale = 1000.0"]
)
def test_wild_numbers_in_capture_toml(sound, changed, line, number):
    text = (sound / "capture" / "capture.toml").read_text()
    key = line.split(" = ")[0]
    wild = text.replace(line, f"{key} = {number}")
    assert wild != text
    changed("capture/capture.toml", wild.encode())
    said = refusal(load_capture, sound / "capture")
    assert "capture.toml: " in said
    if number != NINES and not number.startswith("-"):  # those are no TOML at all
        assert key in said


@pytest.mark.parametrize(
    "text",
    [
        "a = " + "[" * 1000,
        "a = " + "{a = " * 1000,
        ".".join("a" * 4_000) + " = 1",
        ".".join("a" * 40_000) + " = 1",
        "k" * 15_000 + " = 1",
        f"[depth_to_color]\nrotation = [{POWER}]\ntranslation = [0, 0, 0]\n",
        f"[intrinsics]\nfx = {{a = {NINES}}}\n",
    ],
)
def test_wild_structure_in_capture_toml(sound, changed, text):
    changed("capture/capture.toml", text.encode())
    assert "capture.toml: " in refusal(load_capture, sound / "capture")


@pytest.mark.parametrize(
    "name", ["result/result.json", "result/lights.json", "capture/truth/lights.json"]
)
@pytest.mark.parametrize("opening", ["[", '{"a":', '{"vector":[', '{"options":{"a":'])
@pytest.mark.parametrize("depth", [900, 1000, 100_000])
def test_json_nested_deep(sound, changed, name, opening, depth):
    text = (sound / name).read_text()
    for content in (opening * depth, text.replace("{", '{"deep": ' + opening * depth, 1)):
        path = sound / name
        if not path.read_bytes().startswith(opening.encode() * 2):
            changed(name, content.encode())
        folder, read = READERS[name]
        assert name in refusal(read, sound / folder)
        path.write_text(text)


@pytest.mark.parametrize("number", [NINES, POWER, "1e999", "NaN", "-0", '"x"'])
@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("result/result.json", "width"),
        ("result/lights.json", "middle_m"),
        ("capture/truth/lights.json", "middle_m"),
    ],
)
def test_wild_numbers_in_json(sound, changed, name, key, number):
    text = (sound / name).read_text()
    before, after = text.split(f'"{key}":', 1)
    end = min(after.index(sign) for sign in ",\n" if sign in after)
    changed(name, f'{before}"{key}": {number}{after[end:]}'.encode())
    folder, read = READERS[name]
    assert str(sound) in refusal(read, sound / folder)


@pytest.mark.parametrize("one", ["0", "256", "1" + "0" * 400])
def test_a_confidence_of_nothing_or_beyond_eight_bits(sound, changed, one):
    text = (sound / "result" / "result.json").read_text()
    wrong = text.replace('"confidence_one": 255', f'"confidence_one": {one}')
    changed("result/result.json", wrong.encode())
    assert "confidence_one" in refusal(load_result, sound / "result")


# --- arrays ---


def archive(path, header, values=DEPTH_M, compression=zipfile.ZIP_STORED):
    text = header.encode("latin-1").ljust(117) + b"\n"
    member = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + values.tobytes()
    with zipfile.ZipFile(path, "w", compression) as file:
        file.writestr("depth_mm.npy", member)
    return path


def described(descr="'<f4'", order="False", shape="(24, 32)"):
    return f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}"


@pytest.mark.parametrize(
    "header",
    [
        described(shape=f"({NINES}, 32)"),
        described(shape=f"({POWER}, 32)"),
        described(shape="(-24, 32)"),
        described(shape="(99999999, 99999999)"),
        described(shape="(16000, 16000)"),
        described(shape="(24.0, 32)"),
        described(shape="(24, 32, 1)"),
        described(shape="(" * 400),
        described(shape="(0777or 1, 32)"),
        described(descr="'|O'"),
        described(descr="'<f3'"),
        described(descr="'<M8[ns]'"),
        described(descr="[('a', '<f4')]"),
        described(descr="'(2,2)<f4'"),
        described(order="7"),
        "{" * 900,
        "[" + "-" * 900,
        "'''",
        "\0" * 90,
        "\\N{",
    ],
)
def test_lying_headers_of_arrays(tmp_path, header):
    assert "depth_mm" in refusal(shape_from_file, archive(tmp_path / "a.npz", header))


def test_headers_of_other_programs(tmp_path):
    """Other quotes and order of keys, long integers of Python 2, and columns first."""
    texts = (
        described(),
        '{"shape":(24,32),"descr":"<f4","fortran_order":False}',
        described(shape="(24L, 32L)"),
    )
    for text in texts:
        assert shape_from_file(archive(tmp_path / "a.npz", text)).name == "a"


@pytest.mark.parametrize("compression", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_DEFLATED])
def test_damaged_members_of_archives(tmp_path, compression):
    path = archive(tmp_path / "a.npz", described(), compression=compression)
    data = path.read_bytes()
    assert shape_from_file(path).name == "a"
    start = data.index(b"depth_mm.npy") + 12
    refused = 0
    for at in range(start, start + 60):
        path.write_bytes(data[:at] + bytes([data[at] ^ 0x5A]) + data[at + 1 :])
        try:
            shape_from_file(path)
        except InputError:
            refused += 1
    assert refused > 50  # the size of LZMA's dictionary may be any


def test_nan_with_unusual_bits_is_outside(tmp_path):
    values = DEPTH_M.copy() * 1000
    values.view(np.uint32)[0, 0] = 0x7FA00001
    assert shape_from_file(archive(tmp_path / "a.npz", described(), values)).name == "a"


def test_what_follows_the_pixels_of_a_png_is_not_told(capfd):
    header = struct.pack(">IIBBBBB", 2, 1, 8, 0, 0, 0, 0)
    pixels = zlib.compress(bytes([0, 7, 9])) + b"more"
    data = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels)
    assert decode_image(data + chunk(b"IEND", b"")).tolist() == [[7, 9]]
    assert capfd.readouterr() == ("", "")
