"""Captures behind URLs, with fsspec's own file systems."""

import fsspec
import pytest

from rakelight.batch import remote
from rakelight.batch.checksum import content_checksum
from rakelight.batch.plan import Job
from rakelight.batch.remote import local_copy, matching_urls
from rakelight.errors import CaptureError, InputError, MachineError


def test_a_folder_is_copied_and_the_copy_deleted(capture):
    with local_copy(Job(capture.as_uri(), "coin")) as copy:
        assert copy != capture
        assert copy.name == "coin"
        assert content_checksum(copy) == content_checksum(capture)
    assert not copy.parent.exists()


def test_a_file_is_copied():
    fsspec.filesystem("memory").pipe("/captures/rec.bag", b"bag")
    with local_copy(Job("memory://captures/rec.bag", "rec.bag")) as copy:
        assert (copy.name, copy.read_bytes()) == ("rec.bag", b"bag")


def test_a_path_is_read_where_it_is(capture):
    with local_copy(Job(str(capture), "coin")) as place:
        assert place == capture


def test_a_pattern_of_urls(capture, tmp_path):
    (tmp_path / "captures" / "head").mkdir()
    found = matching_urls(f"{tmp_path.as_uri()}/captures/*")
    assert found == [f"{tmp_path.as_uri()}/captures/{name}" for name in ("coin", "head")]
    with pytest.raises(InputError, match="nothing matches"):
        matching_urls(f"{tmp_path.as_uri()}/none*")


@pytest.mark.parametrize(
    ("url", "error", "words"),
    [
        ("zip://coin::file:///tmp/a.zip", InputError, "archives are not read"),
        ("tar://a.tar", InputError, "archives are not read"),
        ("nosuch://a/b", InputError, "not a URL that can be read"),
        ("file:///no/such/folder", CaptureError, "nothing here"),
        ("memory://no/such/file", CaptureError, "nothing"),
    ],
)
def test_what_is_refused(url, error, words):
    with pytest.raises(error, match=words) as refused, local_copy(Job(url, "x")):
        pass
    assert str(refused.value).startswith(f"{url}: ")


@pytest.mark.parametrize("name", ["cap/../../x", "cap/a\\..\\x", "cap/C:/x", "cap/a\0", "cap"])
def test_names_that_leave_the_folder(name):
    assert remote._inside("cap/rgb/0.png", "cap", "s3://cap") == "rgb/0.png"
    with pytest.raises(CaptureError, match="leads out of its folder"):
        remote._inside(name, "cap", "s3://cap")


def test_too_little_room(capture, monkeypatch):
    monkeypatch.setattr(remote, "_SHARE_OF_DISK", 0.0)
    with (
        pytest.raises(MachineError, match=r"too little room .*needed .* MB or more"),
        local_copy(Job(capture.as_uri(), "coin")),
    ):
        pass


def test_a_server_that_understates_its_sizes(monkeypatch):
    system = fsspec.filesystem("memory")
    system.pipe("/lies/rec.bag", bytes(3_000_000))
    monkeypatch.setattr(type(system), "info", lambda *_, **__: {"size": 1, "type": "file"})
    monkeypatch.setattr(remote.shutil, "disk_usage", lambda _: type("", (), {"free": 2_500_000}))
    with (
        pytest.raises(MachineError, match="too little room"),
        local_copy(Job("memory://lies/rec.bag", "x")),
    ):
        pass
