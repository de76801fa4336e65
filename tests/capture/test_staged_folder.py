import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rakelight import files
from rakelight.errors import InputError, MachineError, OutputExistsError
from rakelight.files import read_bytes, require_free, staged_folder, write_bytes


def write(target, content=b"new", **options):
    with staged_folder(target, **options) as staging:
        (staging / "sub").mkdir()
        write_bytes(staging / "sub" / "data", content)
        write_bytes(staging / "result.json", content)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_appears_at_the_end(tmp_path):
    target = tmp_path / "made" / "on the way" / "out"
    with staged_folder(target) as staging:
        assert staging.parent == target.parent
        assert not target.exists()
        write_bytes(staging / "a", b"1")
    assert names(target) == ["a"]
    assert names(target.parent) == ["out"]
    assert target.stat().st_mode & 0o055 == (0o055 & ~_umask())


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_nothing_is_left_of_a_failure(tmp_path, error):
    write(tmp_path / "out", b"old")

    def fail():
        with staged_folder(tmp_path / "out", overwrite=True) as staging:
            write_bytes(staging / "a", b"1")
            raise error

    with pytest.raises(error):
        fail()
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out" / "result.json").read_bytes() == b"old"


def test_what_stands_there_is_kept(tmp_path):
    write(tmp_path / "out", b"old")
    with pytest.raises(OutputExistsError, match="--overwrite"):
        write(tmp_path / "out")
    (tmp_path / "file").write_text("x")
    for overwrite in (False, True):
        with pytest.raises(OutputExistsError, match="a file stands"):
            write(tmp_path / "file", overwrite=overwrite)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    with pytest.raises(OutputExistsError, match="not written by rakelight"):
        write(tmp_path / "mine", overwrite=True)
    with pytest.raises(OutputExistsError, match=r"capture\.toml"):
        write(tmp_path / "out", overwrite=True, marker="capture.toml")
    assert names(tmp_path) == ["file", "mine", "out"]
    assert (tmp_path / "out" / "result.json").read_bytes() == b"old"


def test_overwrite(tmp_path):
    write(tmp_path / "out", b"old")
    (tmp_path / "out" / "stale").write_text("x")
    write(tmp_path / "out", overwrite=True)
    assert names(tmp_path / "out") == ["result.json", "sub"]
    assert (tmp_path / "out" / "sub" / "data").read_bytes() == b"new"
    (tmp_path / "empty").mkdir()
    write(tmp_path / "empty", overwrite=True)
    assert names(tmp_path) == ["empty", "out"]


def test_home_and_working_directory_are_never_replaced(tmp_path, monkeypatch):
    write(tmp_path / "out", b"old")
    (tmp_path / "out" / "here").mkdir()
    monkeypatch.chdir(tmp_path / "out" / "here")
    with pytest.raises(OutputExistsError):
        write(tmp_path / "out", overwrite=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "out"))
    with pytest.raises(OutputExistsError):
        write(tmp_path / "out", overwrite=True)
    assert (tmp_path / "out" / "here").is_dir()


def test_a_link_stays_a_link(tmp_path):
    write(tmp_path / "real", b"old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write(tmp_path / "link", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "result.json").read_bytes() == b"new"


def test_second_run_into_one_folder(tmp_path):
    with staged_folder(tmp_path / "out") as staging:
        with pytest.raises(MachineError, match="another run is writing") as caught:
            write(tmp_path / "out")
        assert caught.value.exit_code == 3
        write(tmp_path / "other")
        write_bytes(staging / "a", b"1")
    assert names(tmp_path) == ["other", "out"]
    assert names(tmp_path / "out") == ["a"]


@pytest.mark.skipif(os.name != "posix", reason="SIGKILL")
def test_killed_run_is_cleaned_up(tmp_path):
    program = (
        "import sys, time; from pathlib import Path; from rakelight.files import *\n"
        "with staged_folder(Path(sys.argv[1])) as staging:\n"
        "    write_bytes(staging / 'a', b'1'); print('ready', flush=True); time.sleep(60)"
    )
    source = str(Path(files.__file__).parents[1])
    run = subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": source},
    )
    assert run.stdout.readline() == b"ready\n"
    with pytest.raises(MachineError, match="another run is writing"):
        write(tmp_path / "out")
    run.send_signal(signal.SIGKILL)
    run.wait()
    run.stdout.close()
    left = names(tmp_path)
    assert "out" not in left
    assert any(name.endswith(".partial") for name in left)
    (tmp_path / ".other.rakelight-00.partial").mkdir()  # somebody else's
    write(tmp_path / "out")
    assert names(tmp_path) == [".other.rakelight-00.partial", "out"]


def test_killed_between_the_renames(tmp_path):
    write(tmp_path / "out", b"old")
    (tmp_path / "out").rename(tmp_path / ".out.rakelight-12345678.old")
    with pytest.raises(OutputExistsError):
        write(tmp_path / "out")
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out" / "result.json").read_bytes() == b"old"


def test_old_comes_back_when_the_new_cannot_take_its_place(tmp_path, monkeypatch):
    write(tmp_path / "out", b"old")
    rename = Path.rename

    def fails_for_new(self, target):
        if self.suffix == ".partial":
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fails_for_new)
    with pytest.raises(MachineError, match="Input/output error"):
        write(tmp_path / "out", overwrite=True)
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out" / "result.json").read_bytes() == b"old"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_full_disk():
    with pytest.raises(MachineError, match=r"No space left.*needed 70000 bytes") as caught:
        write_bytes_keeping(Path("/dev/full"), bytes(70000))
    assert caught.value.exit_code == 3


def write_bytes_keeping(path, data):
    """`write_bytes` without its removal of the stump, which here is a device."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "unlink", lambda *_, **__: None)
        write_bytes(path, data)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_failures_of_the_system_inside(tmp_path, number):
    def fail():
        with staged_folder(tmp_path / "out") as staging:
            raise OSError(number, os.strerror(number), str(staging))

    with pytest.raises(MachineError) as caught:
        fail()
    assert str(caught.value).startswith(f"{tmp_path / 'out'}: cannot be written")
    assert os.strerror(number) in str(caught.value)
    assert names(tmp_path) == []


def test_below_a_file(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match=r"cannot be written \(seen (Not a directory|File exists)"):
        write(tmp_path / "file" / "out")


def free(target):
    require_free(target, overwrite=False, marker="result.json")


def test_require_free_sees_what_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("x")
    for impossible in ("file/out", "file/new/out", "x" * 300):
        with pytest.raises(InputError, match=impossible):
            free(tmp_path / impossible)
    free(tmp_path / "out")
    free(tmp_path / "new" / "out")
    assert names(tmp_path) == ["file"]
    tried = []

    def read_only(dir):
        tried.append(dir)
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(files, "TemporaryFile", read_only)
    with pytest.raises(MachineError, match=r"new/out: cannot be written \(seen Read-only file sys"):
        free(tmp_path / "new" / "out")
    assert tried == [tmp_path]


@pytest.mark.skipif(not Path("/sys").is_dir(), reason="needs a place where nobody may write")
def test_require_free_where_nobody_may_write():
    with pytest.raises(MachineError, match=r"/sys/out: cannot be written .* Fix: choose a folder"):
        free(Path("/sys/out"))


def test_every_file_is_flushed(tmp_path, monkeypatch):
    flushed = []
    fsync = os.fsync

    def record(descriptor):
        flushed.append(os.fstat(descriptor).st_ino)
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", record)
    write(tmp_path / "out")
    inodes = {path.stat().st_ino for path in (tmp_path / "out").rglob("*")}
    assert inodes | {tmp_path.stat().st_ino} <= set(flushed)


def test_read_bytes(tmp_path):
    (tmp_path / "a").write_bytes(b"12345")
    assert read_bytes(tmp_path / "a", max_bytes=5) == b"12345"
    with pytest.raises(InputError, match="short name: file too large"):
        read_bytes(tmp_path / "a", source="short name", max_bytes=4)
    with pytest.raises(InputError, match="No such file"):
        read_bytes(tmp_path / "b")
    with pytest.raises(InputError, match="seen a folder, needed a file"):
        read_bytes(tmp_path)
