"""Files written whole or not at all."""

import errno
import os
import shutil
import subprocess
import sys

import pytest

from rakelight.errors import MachineError
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
