"""Free memory as Linux tells it, and what is refused for want of it."""

from math import inf
from pathlib import Path

import pytest

from rakelight import memory
from rakelight.errors import MachineError
from rakelight.memory import free_memory, require_memory


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
