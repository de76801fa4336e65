"""Kernels are compiled whatever became of their cache; what numba cannot work with is told."""

import importlib.util
import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from rakelight import jit
from rakelight.errors import InputError, MachineError

MODULE = "def twice(number):\n    return 2 * number\n"


@pytest.fixture
def function(tmp_path):
    """A function in a file of its own, whose cache nobody else has."""
    path = tmp_path / "doubling.py"
    path.write_text(MODULE)
    spec = importlib.util.spec_from_file_location("doubling", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.twice


def as_by_another_process(function):
    """The function as a process compiles it that knows of the cache alone."""
    compiled = jit.helper(function)
    assert compiled(3.0) == 6.0
    return compiled


def cached(compiled, end):
    (path,) = Path(compiled.stats.cache_path).glob(f"doubling.*{end}")
    return path


def folder_instead(path):
    path.unlink()
    path.mkdir()


DAMAGES = {
    "empty": lambda path: path.write_bytes(b""),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-20]),
    "noise": lambda path: path.write_bytes(b"\x80\x05B\xff\xff\xff\x7f noise"),
    "another's": lambda path: path.write_bytes(pickle.dumps(5)),
}


@pytest.mark.parametrize("end", [".nbi", ".nbc"])
@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_cache_is_made_anew(function, damage, end):
    damage(cached(as_by_another_process(function), end))
    assert not as_by_another_process(function).stats.cache_hits
    assert as_by_another_process(function).stats.cache_hits


@pytest.mark.parametrize("end", [".nbi", ".nbc"])
def test_a_folder_in_place_of_a_cached_file_is_no_matter(function, end):
    folder_instead(cached(as_by_another_process(function), end))
    assert not as_by_another_process(function).stats.cache_hits
    as_by_another_process(function)


def test_what_is_cached_needs_no_working_directory(function, request):
    compiled = as_by_another_process(function)
    request.getfixturevalue("deleted_working_directory")
    as_by_another_process(function)
    cached(compiled, ".nbc").unlink()
    with pytest.raises(MachineError, match=r"working directory is not there .* numba can comp"):
        as_by_another_process(function)


def test_a_disk_that_takes_nothing_more_is_no_matter(function):
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    path = Path(as_by_another_process(function).stats.cache_path)
    for each in path.glob("doubling.*"):
        each.unlink()
    resource.setrlimit(resource.RLIMIT_FSIZE, (300, before[1]))
    try:
        compiled = as_by_another_process(function)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not list(path.glob("doubling.*.nbc*"))
    assert not jit._on_disk(compiled)
    as_by_another_process(function)
    assert as_by_another_process(function).stats.cache_hits


@pytest.mark.parametrize("text", ["0", "x", "", "-1", "1.5", "00"])
def test_a_number_of_threads_that_is_none_is_told(monkeypatch, text):
    monkeypatch.setenv("NUMBA_NUM_THREADS", text)
    jit._numba.cache_clear()
    with pytest.raises(InputError, match="NUMBA_NUM_THREADS: no number of threads") as caught:
        jit.cores()
    assert f"(seen '{text}', needed 1 or more). Fix: " in str(caught.value)


@pytest.mark.parametrize("text", ["1", " 2", "010"])
def test_a_number_of_threads_is_taken(monkeypatch, text):
    monkeypatch.setenv("NUMBA_NUM_THREADS", text)
    jit._require_number_of_threads()


def test_kernels_that_are_not_to_be_compiled_are_told_of(monkeypatch):
    monkeypatch.setattr("numba.config.DISABLE_JIT", 1)
    jit._numba.cache_clear()
    with pytest.raises(InputError, match=r"NUMBA_DISABLE_JIT: set, .*Fix: `unset NUMBA_DISABLE_J"):
        jit.helper(len)


SUMS = """
import hashlib
import numpy as np
from rakelight.photometry.images import LightParameters, Photographs, Surface
from rakelight.model import Camera

rng = np.random.default_rng(0)
shape, count = (40, 50), 7
values = rng.integers(500, 60000, (count, *shape, 3)).astype(np.uint16)
table, camera = np.linspace(0, 1, 65536, dtype=np.float32), Camera(50, 40, 400.0, 400.0, 25.0, 20.0)
photographs = Photographs(values, table, 1, 65534, np.ones(shape, bool), camera)
surface = Surface(rng.normal(0, 0.004, (*shape, 2)), rng.normal(0, 0.02, (*shape, 3)))
vector = rng.normal(0, 0.4, (count, 1, 3)) - [0, 0, 1]
lights = LightParameters.distant(vector, rng.uniform(0.05, 0.3, (count, 1)))
found = photographs.linearize(surface, lights, scale=0.1, with_light_slope=True)
print(hashlib.sha256(found.light_slope.tobytes() + found.jtwj.tobytes()).hexdigest())
"""


def test_a_process_that_compiles_finds_what_the_next_one_finds(tmp_path):
    """To the last bit: the same command twice gives the same result."""
    given = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    printed = [
        subprocess.run(
            [sys.executable, "-c", SUMS], env=given, check=True, capture_output=True, text=True
        ).stdout
        for _ in range(2)
    ]
    assert printed[0] == printed[1]
    assert len(printed[0].strip()) == 64
