"""Files written whole or not at all."""

import errno
import os
import shutil
import subprocess
import sys

import pytest

from rakelight.errors import InputError, MachineError
from rakelight.files import write_bytes, write_parts
from tests.full_disk import full_at

WRITERS = {
    "at once": lambda path: write_bytes(path, b"12"),
    "in parts": lambda path: write_parts(path, [b"1", b"2"]),
}
each_writer = pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)


@pytest.fixture
def running_program(tmp_path):
    """A program that runs: nobody may write to its file, root neither, but its folder is free."""
    program = tmp_path / "program"
    shutil.copy(shutil.which("sleep"), program)
    with subprocess.Popen([program, "60"]) as process:
        yield program
        process.kill()


@pytest.mark.skipif(sys.platform != "linux", reason="others let a running program be written to")
@each_writer
def test_a_file_that_cannot_be_opened_stays(running_program, write):
    before = running_program.read_bytes()
    with pytest.raises(MachineError, match=os.strerror(errno.ETXTBSY)):
        write(running_program)
    assert running_program.read_bytes() == before


@each_writer
def test_a_file_written_in_part_is_removed(tmp_path, monkeypatch, write):
    path = tmp_path / "note.txt"
    full_at(monkeypatch, lambda each: each == path)
    with pytest.raises(MachineError, match=os.strerror(errno.ENOSPC)):
        write(path)
    assert not path.exists()


@each_writer
def test_a_written_file_holds_all(tmp_path, write):
    write(tmp_path / "note.txt")
    assert (tmp_path / "note.txt").read_bytes() == b"12"


@each_writer
def test_a_limit_on_the_size_of_files_is_told_with_its_remedy(tmp_path, write):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1, before[1]))
    try:
        with pytest.raises(MachineError, match=r"File too large.* Fix: raise .*`ulimit -f`"):
            write(tmp_path / "note.txt")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not (tmp_path / "note.txt").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="it says another thing there")
@each_writer
def test_a_folder_in_the_place_of_a_file_is_told_with_its_remedy(tmp_path, write):
    with pytest.raises(InputError, match="Fix: choose another name: a folder stands there"):
        write(tmp_path)
