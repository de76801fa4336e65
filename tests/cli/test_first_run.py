"""The first run has the largest kernels compiled by processes of its own."""

import os
import subprocess
import sys
from errno import EAGAIN

import pytest

from rakelight.cli import first_run
from rakelight.cli.first_run import compiling_beside, kernels_to_compile
from rakelight.errors import MachineError
from rakelight.photometry import compiling

from .cli_process import SOURCES


@pytest.fixture
def started(monkeypatch):
    """The processes that are started, here with something else to do."""
    processes = []

    def popen(command, **options):
        idle = [sys.executable, "-c", "import time; time.sleep(600)"]
        processes.append(subprocess.Popen(idle, **options))
        return processes[-1]

    monkeypatch.setattr(first_run, "Popen", popen)
    return processes


def never_compiled(monkeypatch):
    monkeypatch.setattr(first_run.jit, "to_be_cached", lambda kernel: True)
    monkeypatch.setattr(first_run.jit, "cores", lambda: 2)


def test_each_has_a_process_that_ends_with_the_block(monkeypatch, started):
    never_compiled(monkeypatch)

    def interrupted():
        with compiling_beside():
            assert [each.poll() for each in started] == [None, None]
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [each.poll() is None for each in started] == [False, False]


def test_what_is_compiled_already_is_not_compiled_again(started):
    for call in compiling.CALLS.values():
        call()
    with compiling_beside():
        pass
    assert not started


@pytest.mark.parametrize(("name", "value"), [("cores", 1), ("available_memory", 1e9)])
def test_a_small_machine_does_it_alone(monkeypatch, name, value):
    never_compiled(monkeypatch)
    monkeypatch.setattr(first_run, "available_memory", lambda: 8e9)
    assert kernels_to_compile() == ("linearize", "light_terms")
    monkeypatch.setattr(first_run.jit if name == "cores" else first_run, name, lambda: value)
    assert not kernels_to_compile()


@pytest.mark.parametrize(
    "error", [BlockingIOError(EAGAIN, "Resource temporarily unavailable"), MachineError("too few")]
)
def test_a_system_that_starts_no_process_loses_time_alone(monkeypatch, error):
    def refused(*_, **__):
        raise error

    never_compiled(monkeypatch)
    monkeypatch.setattr(first_run, "Popen", refused)
    work = []
    with compiling_beside():
        work.append("done")
    assert work == ["done"]


def test_an_empty_cache_is_seen(tmp_path):
    program = "from rakelight.cli.first_run import kernels_to_compile as k; print(*k())"
    folder = {"PYTHONPATH": os.fspath(SOURCES), "NUMBA_CACHE_DIR": os.fspath(tmp_path)}
    several = {"NUMBA_NUM_THREADS": "2"}
    found = subprocess.check_output(
        [sys.executable, "-c", program], env={**os.environ, **folder, **several}, text=True
    )
    assert found.split() == list(compiling.CALLS)
