"""What no reader recognises: the message says what it is and what to name instead."""

import os
import sqlite3
import zipfile
from pathlib import Path

import pytest

from rakelight import load_capture
from rakelight.capture.images import encode_jpeg, encode_png, encode_tiff
from rakelight.cli.commands import run
from rakelight.errors import CaptureError, MachineError
from tests.capture.capture_builder import build, small_capture
from tests.capture.readers.test_photographs import fill

SMALL = small_capture()
PIXELS = SMALL.photographs[0]


def written(path, data=b""):
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    return path


def zipped(path):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("IMG_1.jpg", b"")
    return path


def database(path):
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE notes (text)")
    connection.commit()
    connection.close()
    return path


def jpegs(folder):
    for i, pixels in enumerate(SMALL.photographs):
        written(folder / f"IMG_{i}.JPG", encode_jpeg(pixels))
    return folder


def with_depth(folder, name, data=b"RIFF0000WEBP"):
    written(folder / "depth.tiff", encode_tiff(SMALL.depth_m[0]))
    return written(folder / name, data).parent


def result(folder):
    written(folder / "result.json", b"{}")
    return with_depth(folder, "albedo.png", encode_png(PIXELS))


def results(folder):
    folder.mkdir()
    for name in ("r1", "r2"):
        result(folder / name)
    return folder


def two_captures(folder):
    build(folder / "c")
    return build(folder / "d").parent


def mixed(folder):
    """A capture beside what was made of it."""
    build(results(folder) / "mitten")
    return folder


def link(path, target):
    path.symlink_to(target)
    return path


def unpacked(folder):
    written(folder / "metadata", b"{}")
    written(folder / "rgbd" / "0.jpg", encode_jpeg(PIXELS))
    return folder


def around(folder):
    """What an unpacked archive often is."""
    fill(folder / "EXR_RGBD" / "rgb", texts=False)
    written(folder / "EXR_RGBD" / "metadata.json", b"{}")
    return folder


def several(folder):
    for name in ("morning", "noon"):
        fill(folder / name / "rgb", texts=False)
    return folder


def folder_of(path):
    path.mkdir()
    return path


MP4 = b"\0\0\0\x18ftypmp42"
UNKNOWN = {
    "no such folder or file .needed": lambda p: p / "none",
    "no such folder or file: a link to nothing": lambda p: link(p / "link", p / "none"),
    "a link to nothing.*lead to": lambda p: link(p / "loop", p / "loop"),
    "an empty folder": lambda p: folder_of(p / "empty"),
    "neither a folder nor a file .seen a device": lambda p: Path("/dev/null"),
    "seen an empty file": lambda p: written(p / "a.db3"),
    "seen a file that starts with b'hello'": lambda p: written(p / "a.bag", b"hello"),
    "seen an SQLite file": lambda p: database(p / "a.db3"),
    "seen a ZIP archive.*unpack it": lambda p: zipped(p / "a.zip"),
    "seen a ZIP archive.*Record3D": lambda p: zipped(p / "a.r3d"),
    "seen a packed file.*unpack it": lambda p: written(p / "a.tgz", b"\x1f\x8b"),
    "seen a packed file.*unpack": lambda p: written(p / "a.db3.zstd", b"\x28\xb5\x2f\xfd"),
    "HEIC or a video.*holds depth, too": lambda p: written(p / "a.mp4", MP4),
    "this recording is damaged.*mcap recover a.mcap": lambda p: written(
        p / "a.mcap", b"\x89MCAP0\r\n" + bytes(60)
    ),
    "damaged .seen its end is missing.*mcap recover cut.mcap": lambda p: written(
        p / "cut.mcap", b"\x89MCAP0\r\n"
    ),
    "seen one image.*name the folder": lambda p: written(p / "a.jpg", encode_jpeg(PIXELS)),
    "name the folder that it lies in": lambda p: build(p / "c") / "capture.toml",
    "Fix: in MATLAB": lambda p: written(p / "a.mat", bytes(8)),
    "Capture.from_arrays": lambda p: zipped(p / "a.npz"),
    "a folder that holds a recording.*/bag/a.db3": lambda p: written(p / "bag" / "a.db3").parent,
    "a folder that holds a recording.*/bag/a.mcap": lambda p: written(p / "bag" / "a.mcap").parent,
    "holds a .mat file.*/set/a.mat": lambda p: written(p / "set" / "a.mat").parent,
    "a folder around the one.*name that itself: .*/all/c": lambda p: build(p / "all" / "c").parent,
    "a folder of captures .seen c, d": lambda p: two_captures(p / "all"),
    "a folder around the one.*name that itself: .*/mix/mitten": lambda p: mixed(p / "mix"),
    "a folder of results.*seen r1, r2": lambda p: results(p / "made"),
    "an .r3d that was unpacked": lambda p: unpacked(p / "scan"),
    "a result, not a capture": lambda p: result(p / "made"),
    "no depth map in it .seen IMG_0.JPG": lambda p: jpegs(p / "photos"),
    "no photographs in it .needed": lambda p: with_depth(p / "depth only", "notes.txt"),
    "no photographs in it .seen a.webp.*PNG": lambda p: with_depth(p / "webp", "a.webp"),
    "a video without depth .seen a.mp4": lambda p: written(p / "video" / "a.mp4", MP4).parent,
    "a folder of arrays.*from_arrays": lambda p: written(p / "arrays" / "a.npz", b"PK").parent,
    "images of a format that is not read": lambda p: written(p / "gif" / "a.gif", b"GIF89a").parent,
    "a folder around the one.*name that itself: .*/rec/EXR_RGBD": lambda p: around(p / "rec"),
    "a folder of captures .seen morning, noon.*batch": lambda p: several(p / "day"),
    "nothing in it that is read .seen a.md": lambda p: written(p / "notes" / "a.md").parent,
}


@pytest.mark.parametrize("what", UNKNOWN)
def test_it_is_said_in_one_line_and_nothing_is_written(tmp_path, capfd, what):
    source = UNKNOWN[what](tmp_path)
    with pytest.raises(CaptureError, match=what) as caught:
        load_capture(source)
    assert str(caught.value).startswith(str(source))
    assert run(["import", str(source), "-o", str(tmp_path / "out"), "--quiet"]) == 2
    assert capfd.readouterr().err == f"error: {caught.value}\n"
    assert not (tmp_path / "out").exists()


def test_too_many_files_are_said_to_be(tmp_path):
    for i in range(2001):
        (tmp_path / f"{i}.md").touch()
    with pytest.raises(CaptureError, match="too many files"):
        load_capture(tmp_path)


@pytest.fixture
def somebody_else():
    """Without root's rights, by which all may be read."""
    if not hasattr(os, "seteuid"):
        pytest.skip("a system without such rights")
    before = os.geteuid()
    if before == 0:
        os.seteuid(65534)
    yield
    os.seteuid(before)


@pytest.mark.parametrize("place", ["", "img9.png", "below", "../photos"])
def test_what_may_not_be_looked_at_is_the_machines_fault(tmp_path, request, place):
    folder = tmp_path / "photos"
    fill(folder)
    (folder / "below").mkdir()
    load_capture(folder)
    for path in (folder, *folder.parents):
        if path.is_relative_to(tmp_path):
            path.chmod(0o755)
    secret = folder.parent if place == "../photos" else folder / place
    secret.chmod(0)
    request.addfinalizer(lambda: secret.chmod(0o755))
    request.getfixturevalue("somebody_else")
    with pytest.raises(MachineError, match=r"cannot be read .seen Permission denied.*Fix: allow"):
        load_capture(folder)
