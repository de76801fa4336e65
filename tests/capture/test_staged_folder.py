import errno
import json
import os
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import pytest

from rakelight import files, folders
from rakelight.errors import InputError, MachineError, OutputExistsError
from rakelight.files import read_bytes, replace_bytes, write_bytes, write_parts
from rakelight.folders import (
    FILE_LIST,
    Manifest,
    file_list,
    only_writer,
    put_back,
    require_free,
    staged_folder,
)

NOTES = file_list("notes")
# As result.json: the writer lists the names, whatever the files hold.
LISTED = Manifest("list", "list", lambda data: dict.fromkeys(data.decode().split()))


def write(target, content=b"new", manifest=NOTES, **options):
    with staged_folder(target, manifest=manifest, **options) as staging:
        (staging.path / "sub").mkdir()
        write_bytes(staging.path / "sub" / "data", content)
        write_bytes(staging.path / "top", content)
        if manifest is LISTED:
            write_bytes(staging.path / "list", b"sub/data top list")
    return staging.findings


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_appears_at_the_end(tmp_path):
    target = tmp_path / "made" / "on the way" / "out"
    with staged_folder(target, manifest=NOTES) as staging:
        assert staging.path.parent == target.parent
        assert not target.exists()
        write_bytes(staging.path / "a", b"1")
    assert names(target) == ["a", FILE_LIST]
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
        with staged_folder(tmp_path / "out", manifest=NOTES, overwrite=True) as staging:
            write_bytes(staging.path / "a", b"1")
            raise error

    with pytest.raises(error):
        fail()
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out" / "top").read_bytes() == b"old"


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
    with pytest.raises(
        OutputExistsError, match=r"rakelight-files.json, needed a poem with nothing"
    ):
        write(tmp_path / "out", overwrite=True, manifest=file_list("poem"))
    assert names(tmp_path) == ["file", "mine", "out"]
    assert (tmp_path / "out" / "top").read_bytes() == b"old"


@pytest.fixture(params=["exchange", "two renames"])
def renaming(request, monkeypatch):
    """Both ways to put a folder in the place of another."""
    if request.param == "two renames":
        monkeypatch.setattr(folders, "_exchange", lambda *_: False)
    elif sys.platform != "linux":
        pytest.skip("names are exchanged on Linux")


@pytest.mark.parametrize("manifest", [NOTES, LISTED], ids=["checksums", "names"])
@pytest.mark.usefixtures("renaming")
def test_overwrite(tmp_path, manifest):
    write(tmp_path / "out", b"old", manifest)
    (tmp_path / "out" / "top").unlink()  # what is missing is no obstacle
    assert write(tmp_path / "out", manifest=manifest, overwrite=True) == ()
    assert names(tmp_path / "out") == sorted([manifest.name, "sub", "top"])
    assert (tmp_path / "out" / "sub" / "data").read_bytes() == b"new"
    (tmp_path / "empty").mkdir()
    write(tmp_path / "empty", overwrite=True)
    assert names(tmp_path) == ["empty", "out"]


# --- what is ours ---


def everything(folder):
    """Relative name -> bytes, target of a link, or None for a folder."""
    found = {}
    for path in folder.rglob("*"):
        what = None if path.is_dir() else "a file"
        if path.is_symlink():
            what = path.readlink()
        elif path.is_file():
            what = path.read_bytes()
        found[path.relative_to(folder).as_posix()] = what
    return found


def add_file(folder):
    (folder / "thesis.docx").write_text("x")


def add_file_to_subfolder(folder):
    (folder / "sub" / "thesis.docx").write_text("x")


def add_empty_folder(folder):
    (folder / "thesis").mkdir()


def add_link(folder):
    (folder / "thesis").symlink_to("/")


def add_dangling_link(folder):
    (folder / "thesis").symlink_to("nowhere")


def add_fifo(folder):
    os.mkfifo(folder / "thesis")


def add_droppings(folder):
    (folder / ".DS_Store").write_bytes(b"x")


def link_for_file(folder):
    (folder / "top").rename(folder.parent / "thesis")
    (folder / "top").symlink_to("../thesis")


def link_for_folder(folder):
    (folder / "sub").rename(folder.parent / "thesis")
    (folder / "sub").symlink_to("../thesis")


def link_for_manifest(folder):
    for name in (FILE_LIST, "list"):
        if (folder / name).exists():
            (folder / name).rename(folder.parent / "thesis")
            (folder / name).symlink_to("../thesis")


def folder_for_file(folder):
    (folder / "top").unlink()
    (folder / "top").mkdir()


CHANGES = {
    add_file: "thesis.docx",
    add_file_to_subfolder: "sub/thesis.docx",
    add_empty_folder: "thesis/",
    add_link: "thesis",
    add_dangling_link: "thesis",
    add_fifo: "thesis",
    add_droppings: ".DS_Store",
    link_for_file: "top",
    link_for_folder: "sub",
    link_for_manifest: "",
    folder_for_file: "top/",
}


@pytest.mark.parametrize("manifest", [NOTES, LISTED], ids=["checksums", "names"])
@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_a_folder_with_anything_foreign_is_never_replaced(tmp_path, change, manifest):
    out = tmp_path / "out"
    write(out, b"old", manifest)
    change(out)
    before = everything(tmp_path)
    with pytest.raises(OutputExistsError, match="not overwritten") as caught:
        require_free(out, manifest=manifest, overwrite=True)
    assert caught.value.exit_code == 2
    assert caught.value.seen == (CHANGES[change] or manifest.name)
    with pytest.raises(OutputExistsError, match="not overwritten"):
        write(out, manifest=manifest, overwrite=True)
    assert everything(tmp_path) == before


def test_a_file_that_was_changed_since_is_not_ours(tmp_path):
    write(tmp_path / "out", b"old")
    (tmp_path / "out" / "top").write_bytes(b"my")
    with pytest.raises(OutputExistsError, match=r"changed since.*seen top, needed a notes"):
        write(tmp_path / "out", overwrite=True)
    write(tmp_path / "names", b"old", LISTED)
    (tmp_path / "names" / "top").write_bytes(b"my")
    write(tmp_path / "names", manifest=LISTED, overwrite=True)


@pytest.mark.parametrize("listed", ["", "{}", "[]", "\0", '{"schema":1}', "[" * 10_000, None])
def test_a_list_that_is_none_makes_nothing_ours(tmp_path, listed):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis").write_text("x")
    if listed is not None:
        (tmp_path / "out" / FILE_LIST).write_text(listed)
    before = everything(tmp_path)
    with pytest.raises(OutputExistsError):
        write(tmp_path / "out", overwrite=True)
    assert everything(tmp_path) == before


@pytest.mark.parametrize("name", ["../thesis", "sub/../../thesis", "{outside}", "", ".", "C:/x"])
@pytest.mark.parametrize("manifest", [NOTES, LISTED], ids=["checksums", "names"])
def test_names_that_lead_out_of_the_folder_are_not_followed(tmp_path, name, manifest):
    outside, out = tmp_path / "thesis", tmp_path / "out"
    outside.write_bytes(b"old")
    name = name.format(outside=outside)
    write(out, b"old", manifest)
    if manifest is NOTES:
        listed = json.loads((out / FILE_LIST).read_text())
        listed["files"][name] = listed["files"]["top"]  # the thesis has this content, too
        (out / FILE_LIST).write_text(json.dumps(listed))
    else:
        (out / "list").write_text(f"sub/data top list {name}")
    write(out, manifest=manifest, overwrite=True)
    assert outside.read_bytes() == b"old"
    assert names(tmp_path) == ["out", "thesis"]


@pytest.mark.usefixtures("renaming")
def test_what_appears_while_a_folder_is_replaced_survives(tmp_path):
    out = tmp_path / "out"
    write(out, b"old")
    with staged_folder(out, manifest=NOTES, overwrite=True) as staging:
        (out / "sub" / "thesis").write_text("x")
    (finding,) = staging.findings
    (hidden,) = set(tmp_path.iterdir()) - {out}
    assert finding.severity == "warning"
    assert finding.message.startswith(f"{hidden}: ")
    assert "seen sub/thesis" in finding.message
    assert names(out) == [FILE_LIST]
    assert (hidden / "sub" / "thesis").read_text() == "x"
    # The next run says it again, and deletes it once nothing foreign is left.
    assert write(out, overwrite=True) == (finding,)
    (hidden / "sub" / "thesis").unlink()
    assert write(out, overwrite=True) == ()
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("call", ["unlink", "rmdir", "rename"])
def test_an_older_folder_that_cannot_be_deleted_is_said(tmp_path, monkeypatch, call):
    out = tmp_path / "out"
    write(out, b"old")
    with monkeypatch.context() as patch:
        original = getattr(Path, call)

        def refused(self, *arguments, **options):
            if ".replaced" in f"{self}{arguments}":
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
            return original(self, *arguments, **options)

        patch.setattr(Path, call, refused)
        (finding,) = write(out, overwrite=True)
        (hidden,) = set(tmp_path.iterdir()) - {out}
        assert f"{hidden}: " in finding.message
        assert "seen Permission denied" in finding.message
        assert "delete it" in finding.remedy
        again = write(out, overwrite=True)
        assert finding in again
        assert (out / "top").read_bytes() == b"new"
    assert write(out, overwrite=True) == ()
    assert names(tmp_path) == ["out"]


def left_by_a_dead_run(folder):
    """What stays beside `out` of a run that was killed while it wrote."""
    partial = folder / ".out.rakelight-12345678.partial"
    partial.mkdir()
    (partial / "half").write_bytes(b"1")
    lock = f"rakelight-lock/1\n{partial.name}\n"
    (folder / ".out.rakelight.lock").write_text(lock, encoding="utf-8")
    return partial


def test_a_dead_runs_folder_that_cannot_be_deleted_is_said(tmp_path, monkeypatch):
    partial = left_by_a_dead_run(tmp_path)

    def refused(path, **_):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", refused)
        with pytest.raises(PermissionError):
            shutil.rmtree(tmp_path)
        patch.setattr(
            shutil, "rmtree", lambda path, ignore_errors=False: ignore_errors or refused(path)
        )
        (finding,) = write(tmp_path / "out")
        assert "12345678.partial: " in finding.message
        assert put_back(tmp_path / "out") == tmp_path / "out"
    assert partial.exists()
    assert write(tmp_path / "out", overwrite=True) == ()
    assert names(tmp_path) == ["out"]


def test_a_folder_that_no_dead_run_wrote_is_never_deleted(tmp_path):
    """Whatever it is called; the next run says that it is there."""
    mine = tmp_path / ".out.rakelight-0123abcd.partial"
    mine.mkdir()
    (mine / "thesis.tex").write_text("thesis")
    left_by_a_dead_run(tmp_path)
    (finding,) = write(tmp_path / "out")
    assert "0123abcd.partial: " in finding.message
    assert "nothing says that rakelight wrote it" in finding.message
    assert names(tmp_path) == [mine.name, "out"]
    assert (mine / "thesis.tex").read_text() == "thesis"


def link(lock, elsewhere):
    lock.symlink_to(elsewhere)


FOREIGN_LOCKS = {
    "other content": lambda lock, elsewhere: lock.write_text("thesis"),
    "a folder": lambda lock, elsewhere: lock.mkdir(),
    "a link": link,
    "no regular file": lambda lock, elsewhere: os.mkfifo(lock),
}


@pytest.mark.skipif(os.name != "posix", reason="no locks")
@pytest.mark.parametrize("seen", FOREIGN_LOCKS)
def test_what_is_no_lock_of_ours_stays_and_is_said(tmp_path, seen):
    lock, elsewhere = tmp_path / ".out.rakelight.lock", tmp_path / "elsewhere"
    FOREIGN_LOCKS[seen](lock, elsewhere)
    before = lock.lstat()
    for use in (write, free, lambda out: only_writer(out).__enter__()):
        with pytest.raises(OutputExistsError, match=f"seen {seen}.* Fix: move it away") as caught:
            use(tmp_path / "out")
        assert caught.value.source == str(lock)
    assert (lock.lstat().st_ino, lock.lstat().st_size) == (before.st_ino, before.st_size)
    assert names(tmp_path) == [lock.name]


@pytest.mark.skipif(sys.platform != "linux", reason="names are exchanged on Linux")
def test_the_exchange_of_two_names(tmp_path):
    (tmp_path / "a").write_text("a")
    (tmp_path / "b").mkdir()
    if not folders._exchange(tmp_path / "a", tmp_path / "b"):
        pytest.skip("not on this file system")
    assert (tmp_path / "b").read_text() == "a"
    assert (tmp_path / "a").is_dir()
    assert not folders._exchange(tmp_path / "a", tmp_path / "none")
    assert names(tmp_path) == ["a", "b"]


def test_without_the_exchange_two_renames_do(tmp_path, monkeypatch):
    class OldLibrary:
        pass

    monkeypatch.setattr(folders.ctypes, "CDLL", lambda _: OldLibrary())
    write(tmp_path / "out", b"old")
    assert write(tmp_path / "out", overwrite=True) == ()
    assert (tmp_path / "out" / "top").read_bytes() == b"new"
    assert names(tmp_path) == ["out"]


def test_home_and_working_directory_are_never_replaced(tmp_path, monkeypatch):
    write(tmp_path / "out", b"old")
    monkeypatch.chdir(tmp_path / "out" / "sub")
    with pytest.raises(OutputExistsError, match="home or working directory"):
        write(tmp_path / "out", overwrite=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "out"))
    with pytest.raises(OutputExistsError, match="home or working directory"):
        write(tmp_path / "out", overwrite=True)
    assert (tmp_path / "out" / "top").read_bytes() == b"old"


@pytest.mark.usefixtures("deleted_working_directory")
def test_from_a_deleted_working_directory_absolute_paths_work(tmp_path):
    write(tmp_path / "out", b"old")
    write(tmp_path / "out", overwrite=True)
    assert (tmp_path / "out" / "top").read_bytes() == b"new"
    with pytest.raises(MachineError, match=r"^out: the working directory is not there any more"):
        write(Path("out"))
    assert put_back(Path("out")) == Path("out")


def test_a_link_stays_a_link(tmp_path):
    write(tmp_path / "real", b"old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    write(tmp_path / "link", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "top").read_bytes() == b"new"


def test_second_run_into_one_folder(tmp_path):
    with staged_folder(tmp_path / "out", manifest=NOTES) as staging:
        with pytest.raises(MachineError, match="another run is writing") as caught:
            write(tmp_path / "out")
        assert caught.value.exit_code == 3
        write(tmp_path / "other")
        write_bytes(staging.path / "a", b"1")
    assert names(tmp_path) == ["other", "out"]
    assert names(tmp_path / "out") == ["a", FILE_LIST]


@pytest.mark.skipif(os.name != "posix", reason="SIGKILL")
def test_killed_run_is_cleaned_up(tmp_path):
    program = (
        "import sys, time; from pathlib import Path; from rakelight.folders import *\n"
        "with staged_folder(Path(sys.argv[1]), manifest=file_list('notes')) as staging:\n"
        "    (staging.path / 'a').write_bytes(b'1'); print('ready', flush=True); time.sleep(60)"
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
    others = [".other.rakelight-01234567.partial", ".out.rakelight-thesis.partial"]
    for name in others:
        (tmp_path / name).mkdir()
    write(tmp_path / "out")
    assert names(tmp_path) == [*others, "out"]


def test_killed_between_the_renames(tmp_path):
    write(tmp_path / "out", b"old")
    (tmp_path / "out").rename(tmp_path / ".out.rakelight-12345678.old")
    with pytest.raises(OutputExistsError):
        write(tmp_path / "out")
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out" / "top").read_bytes() == b"old"


def test_what_was_moved_aside_is_found(tmp_path):
    out = tmp_path / "out"
    assert put_back(out) == out
    write(out, b"old")
    out.rename(tmp_path / ".out.rakelight-12345678.old")
    (tmp_path / ".out.rakelight-12345678.replaced").mkdir()
    (tmp_path / ".out.rakelight-thesis.old").mkdir()
    assert put_back(out) == out
    assert (out / "top").read_bytes() == b"old"
    assert ".out.rakelight-12345678.old" not in names(tmp_path)
    for elsewhere in ("no/such/folder", "x" * 300, "loop"):
        (tmp_path / "loop").unlink(missing_ok=True)
        (tmp_path / "loop").symlink_to("loop")
        assert put_back(tmp_path / elsewhere) == tmp_path / elsewhere


def test_what_was_moved_aside_is_read_there_if_it_cannot_be_put_back(tmp_path, monkeypatch):
    out, aside = tmp_path / "out", tmp_path / ".out.rakelight-12345678.old"
    write(aside, b"old")

    def read_only(*_):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(Path, "rename", read_only)
    assert put_back(out) == aside
    assert names(tmp_path) == [aside.name]


@pytest.mark.parametrize("failing", range(3))
def test_old_comes_back_when_the_new_cannot_take_its_place(tmp_path, monkeypatch, failing):
    write(tmp_path / "out", b"old")
    monkeypatch.setattr(folders, "_exchange", lambda *_: False)
    rename, calls = Path.rename, []

    def fails_once(self, target):
        calls.append(self)
        if len(calls) == failing + 1:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return rename(self, target)

    monkeypatch.setattr(Path, "rename", fails_once)
    with pytest.raises(MachineError, match="Input/output error"):
        write(tmp_path / "out", overwrite=True)
    assert names(tmp_path) == ["out"]
    assert (tmp_path / "out" / "top").read_bytes() == b"old"


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
        with staged_folder(tmp_path / "out", manifest=NOTES) as staging:
            raise OSError(number, os.strerror(number), str(staging.path))

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
    require_free(target, manifest=NOTES)


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

    monkeypatch.setattr(folders, "TemporaryFile", read_only)
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


@pytest.mark.parametrize("moment", ["fcntl.flock", "rakelight.folders._is_still"])
def test_an_interrupt_while_the_lock_is_taken_leaves_none(tmp_path, monkeypatch, moment):
    pytest.importorskip("fcntl")
    calls, plain = [], import_module(moment.rpartition(".")[0]).__dict__[moment.rpartition(".")[2]]

    def once(*given):
        calls.append(given)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return plain(*given)

    monkeypatch.setattr(moment, once)
    with pytest.raises(KeyboardInterrupt), only_writer(tmp_path / "out"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_the_only_writer_stages_the_folder_and_nobody_else(tmp_path):
    with only_writer(tmp_path / "out"):
        with pytest.raises(MachineError, match="another run"), only_writer(tmp_path / "out"):
            pass
        with ThreadPoolExecutor(1) as pool:
            other = pool.submit(write, tmp_path / "out")
        with pytest.raises(MachineError, match="another run"):
            other.result()
        write(tmp_path / "out")
    write(tmp_path / "out", overwrite=True)
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize(
    ("write", "content", "needed"),
    [(write_bytes, b"123", "3 bytes"), (write_bytes, b"", ""), (write_parts, [b"123"], "")],
)
def test_a_disk_that_takes_no_byte(tmp_path, monkeypatch, write, content, needed):
    monkeypatch.setattr(Path, "open", refusing(errno.ENOSPC))
    with pytest.raises(MachineError, match="No space left") as caught:
        write(tmp_path / "page", content)
    assert caught.value.needed == needed


@pytest.mark.parametrize("write", [write_bytes, replace_bytes])
def test_where_nothing_may_be_deleted_the_first_refusal_counts(tmp_path, monkeypatch, write):
    monkeypatch.setattr(Path, "open", refusing(errno.EROFS))
    monkeypatch.setattr(Path, "unlink", refusing(errno.EPERM))
    with pytest.raises(MachineError, match=r"page: .*Read-only.*Fix: choose"):
        write(tmp_path / "page", b"123")


def refusing(number):
    """A call that the system refuses."""

    def call(*_, **__):
        raise OSError(number, os.strerror(number))

    return call
