"""Large arrays on disk: nameless, refused where there is no room, gone with the process."""

import shutil
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest

from rakelight import memory, scratch
from rakelight.errors import MachineError
from rakelight.memory import available_memory, limited_memory, own_memory
from rakelight.scratch import large_empty, mapped, release, scratch_folder

ROOM = ("photographs", "use fewer images")


def resident(array):
    """Bytes of the file that this process holds in memory."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return sum(1024 * int(x.split()[1]) for x in lines if x.startswith(("RssFile", "RssShmem")))


def test_what_is_large_for_the_memory_lies_on_disk(monkeypatch, tmp_path):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(scratch.tempfile, "tempdir", None)
    monkeypatch.setattr(memory, "free_memory", lambda: 1e6)
    small, large = (large_empty((n,), "uint8", *ROOM) for n in (200_000, 300_000))
    assert small.base is None
    assert large.base is not None
    large[:] = 7
    release(large)
    assert (large == 7).all()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="Linux only")
def test_what_is_let_go_takes_no_memory():
    array = mapped((8, 2_000_000), "uint16", *ROOM)
    before = resident(array)
    array[:] = 3
    full = resident(array)
    assert full - before > 25e6
    release(array[1:, ::2])
    assert resident(array) < full - 25e6
    assert int(array.sum(dtype=np.int64)) == 3 * array.size


def test_no_room_on_disk_is_told(monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10, 9, 5_000_000))
    with pytest.raises(MachineError) as caught:
        mapped((4, 2_000_000), "uint8", *ROOM)
    assert str(caught.value) == (
        f"{scratch_folder()}: no room on disk for photographs (seen 5 MB free, needed 8 MB). "
        "Fix: set TMPDIR to a folder with more, or use fewer images"
    )
    assert caught.value.exit_code == 3


def test_a_limit_counts_what_the_process_holds(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 1e12)
    assert available_memory() == 1e12
    held = own_memory()
    with limited_memory(held + 1e8):
        assert available_memory() == pytest.approx(1e8, abs=2e7)
        with limited_memory(None):
            assert available_memory() < 2e8
    assert available_memory() == 1e12
