"""Whoever made a mistake is told what to do: every CaptureError of the readers has a remedy."""

import ast

import pytest

from rakelight.capture import load_capture
from rakelight.errors import CaptureError
from tests.capture.capture_builder import build, codes, edit_config
from tests.test_layers import PACKAGE, name_of

READING = sorted((PACKAGE / "capture").rglob("*.py"))


def without_remedy(source):
    """The lines on which a CaptureError is made without one."""
    calls = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call))
    errors = (call for call in calls if getattr(call.func, "id", "") == "CaptureError")
    return [e.lineno for e in errors if "remedy" not in {keyword.arg for keyword in e.keywords}]


def test_a_missing_one_is_seen():
    assert without_remedy("raise CaptureError('no', source='a', remedy='b')") == []
    assert without_remedy("\nraise CaptureError('no', source='a')") == [2]


@pytest.mark.parametrize("path", READING, ids=name_of)
def test_every_error_says_what_to_do(path):
    assert without_remedy(path.read_text()) == []


@pytest.mark.parametrize(
    ("old", "new", "remedy"),
    [
        ('"linear"', "“linear”", 'write straight quotes: "srgb"'),
        ("1000.0", '"1000"', "write it without quotes"),
    ],
)
def test_quotes_in_capture_toml(tmp_path, old, new, remedy):
    folder = build(tmp_path / "c")
    edit_config(folder, old, new)
    with pytest.raises(CaptureError) as caught:
        load_capture(folder)
    assert caught.value.remedy == remedy


def test_a_folder_in_capitals_is_told_its_name(tmp_path):
    folder = build(tmp_path / "c")
    (folder / "rgb").rename(folder / "RGB")
    with pytest.raises(CaptureError, match=r"no folder rgb.*seen RGB.*rename RGB to rgb"):
        load_capture(folder)
    (folder / "RGB").rename(folder / "rgb")
    (folder / "depth").rename(folder / "depth_maps")
    with pytest.raises(CaptureError, match=r"no folder depth.*seen depth_maps.*put them there"):
        load_capture(folder)


@pytest.mark.parametrize(
    "name",
    [
        "mask/000.png",
        "masks/0.png",
        "object mask.png",
        "dome.lp",
        "lights.txt",
        "conf/0.png",
        "ambient/0.png",
        "flat field.png",
    ],
)
def test_what_a_capture_folder_does_not_read_is_named(tmp_path, name):
    folder = build(tmp_path / "c")
    assert "ignored-files" not in codes(folder)
    (folder / "mask.png").unlink()
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_bytes(b"")
    (warning,) = [f for f in load_capture(folder).findings if f.code == "ignored-files"]
    assert warning.severity == "warning"
    assert name.partition("/")[0] in warning.message


@pytest.mark.parametrize(
    "name", ["mask.jpg", "mask.psd", "notes.txt", "highlights.png", "conf.toml"]
)
def test_copies_and_notes_in_a_capture_folder_are_nobody_s_concern(tmp_path, name):
    folder = build(tmp_path / "c")
    (folder / name).write_bytes(b"")
    assert "ignored-files" not in codes(folder)
