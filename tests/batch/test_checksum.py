"""Any byte of the input changes the checksum; what no reader reads does not."""

import os

import pytest

from rakelight.batch import checksum
from rakelight.batch.checksum import combined, content_checksum
from rakelight.errors import CaptureError


@pytest.fixture
def folder(tmp_path):
    for name, content in {"a.toml": b"1", "rgb/0.png": b"22", "rgb/1.png": b"3"}.items():
        path = tmp_path / "capture" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return tmp_path / "capture"


def rename(folder):
    (folder / "rgb/1.png").rename(folder / "rgb/2.png")


def move_bytes(folder):
    (folder / "rgb/0.png").write_bytes(b"2")
    (folder / "rgb/1.png").write_bytes(b"23")


CHANGES = {
    "a byte": lambda folder: (folder / "rgb/0.png").write_bytes(b"23"),
    "one file more": lambda folder: (folder / "mask.png").write_bytes(b""),
    "one less": lambda folder: (folder / "rgb/1.png").unlink(),
    "another name": rename,
    "bytes from one file to the next": move_bytes,
    "a file to another folder": lambda f: (f / "rgb/1.png").rename(f / "1.png"),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_what_changes_it(folder, change):
    before = content_checksum(folder)
    change(folder)
    assert content_checksum(folder) != before


def test_what_does_not(folder, tmp_path):
    before = content_checksum(folder)
    (folder / ".DS_Store").write_bytes(b"x")
    (folder / "rgb" / ".hidden").mkdir()
    os.utime(folder / "a.toml", (1, 1))
    assert content_checksum(folder) == before
    assert content_checksum(folder.rename(tmp_path / "elsewhere")) == before
    assert len(before) == 2 * checksum.DIGEST_BYTES


def test_what_a_link_leads_to_counts(folder, tmp_path):
    (tmp_path / "photographs").mkdir()
    (tmp_path / "photographs/0.png").write_bytes(b"1")
    (folder / "more").symlink_to(tmp_path / "photographs")
    before = content_checksum(folder)
    (tmp_path / "photographs/0.png").write_bytes(b"2")
    assert content_checksum(folder) != before


def test_what_never_ends(folder):
    (folder / "round").symlink_to(folder)
    (folder / "dead").symlink_to(folder / "nowhere")
    os.mkfifo(folder / "pipe")
    assert len(content_checksum(folder)) == 40


def test_of_a_file(tmp_path):
    file = tmp_path / "rec.bag"
    file.write_bytes(b"1" * 100_000)
    before = content_checksum(file)
    file.write_bytes(b"1" * 99_999 + b"2")
    assert content_checksum(file) != before


def test_nothing_and_too_much(folder, monkeypatch):
    with pytest.raises(CaptureError, match=r"no such folder or file \(needed "):
        content_checksum(folder / "none")
    monkeypatch.setattr(checksum, "MOST_FILES", 2)
    with pytest.raises(CaptureError, match=r"too many files .*needed at most 2"):
        content_checksum(folder)


def test_options_and_version_count():
    facts = {"rakelight": "0.1.0", "settings": {"depth_weight": "3"}, "scale": "auto"}
    others = [
        facts | {"rakelight": "0.1.1"},
        facts | {"settings": {"depth_weight": "4"}},
        facts | {"settings": {}},
        facts | {"scale": 2},
    ]
    assert len({combined("00", each) for each in (facts, *others)}) == 5
    assert combined("00", facts) != combined("01", facts)
    assert combined("00", dict(reversed(facts.items()))) == combined("00", facts)
