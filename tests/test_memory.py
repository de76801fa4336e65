"""Free memory as Linux tells it, and what is refused for want of it."""

import threading
from math import inf
from pathlib import Path
from threading import Thread

import pytest

from rakelight import jit, memory
from rakelight.errors import InputError, MachineError
from rakelight.memory import (
    free_addresses,
    free_memory,
    limited_memory,
    require_memory,
    require_threads,
)


def system(root, **files):
    for name, text in files.items():
        path = root / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


MEMINFO = "MemTotal:       24683064 kB\nMemFree:          100 kB\nMemAvailable:   2000 kB\n"


def test_of_the_machine(tmp_path):
    assert free_memory(tmp_path) == inf
    system(tmp_path, proc__meminfo=MEMINFO)
    assert free_memory(tmp_path) == 2000 * 1024
    system(tmp_path, proc__meminfo="nonsense\n")
    assert free_memory(tmp_path) == inf


@pytest.mark.parametrize(
    ("limit", "free"), [("max", 2048000), ("9000000", 2048000), ("1500000", 907000), ("90", 0)]
)
def test_of_the_container(tmp_path, limit, free):
    group = {"max": limit, "current": "600000", "stat": "anon 5\ninactive_file 7000\n"}
    system(tmp_path, proc__meminfo=MEMINFO)
    system(tmp_path, **{f"sys__fs__cgroup__memory_{name}": text for name, text in group.items()})
    assert free_memory(tmp_path) == free


@pytest.mark.skipif(not Path("/proc/meminfo").exists(), reason="Linux only")
def test_this_machine_has_some():
    assert 1e6 < free_memory() < 1e15


def test_what_is_too_much_is_told(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 3.05e9)
    require_memory(3.04e9, source="x", remedy="y")
    with pytest.raises(MachineError) as caught:
        require_memory(6.7e9, source="x", remedy="buy some")
    assert str(caught.value) == (
        "x: too little memory (seen 3,050 MB free, needed 6,700 MB). Fix: buy some"
    )


def test_a_limit_that_is_too_small_is_told_as_such(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: 3e9)
    monkeypatch.setattr(memory, "own_memory", lambda: 1e8)
    with limited_memory(5e8):
        require_memory(3.9e8, source="x", remedy="y")
        with pytest.raises(InputError) as caught:
            require_memory(7e8, source="x", remedy="buy some")
        with pytest.raises(MachineError, match=r"(3,000|400) MB free"):
            require_memory(3.1e9, source="x", remedy="buy some")
    assert str(caught.value) == (
        "x: the limit of memory is too small (seen 500 MB, needed at least 800 MB). "
        "Fix: raise it, or leave it away"
    )


def test_of_the_process(monkeypatch):
    resource = pytest.importorskip("resource")
    if not Path("/proc/self/statm").exists():
        pytest.skip("Linux only")
    assert free_addresses() == inf
    taken = 4096 * int(Path("/proc/self/statm").read_text().split()[0])
    monkeypatch.setattr(resource, "getrlimit", lambda _: (taken + 10_000_000, -1))
    assert free_addresses() == pytest.approx(10_000_000, abs=9_000_000)
    assert free_memory() == pytest.approx(free_addresses(), abs=9_000_000)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (10_000_000, -1))
    assert free_memory() == 0


def test_threads_that_do_not_start_are_told(monkeypatch):
    start, running = Thread.start, threading.active_count()

    def second_refused(thread):
        if threading.active_count() > running:
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(Thread, "start", second_refused)
    with pytest.raises(MachineError) as caught:
        require_threads(3, source="x", remedy="raise the limit")
    assert str(caught.value) == (
        "x: the system starts no more threads (seen 1, needed 3). Fix: raise the limit"
    )
    assert threading.active_count() == running


def test_kernels_are_not_compiled_where_llvm_would_end_the_process(monkeypatch):
    monkeypatch.setattr(memory, "free_addresses", lambda: 1e9)
    jit._numba.cache_clear()
    with pytest.raises(MachineError, match=r"too few addresses .*ulimit -v unlimited"):
        jit.kernel(len)
