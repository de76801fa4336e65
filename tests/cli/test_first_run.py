"""The first run has parts of the kernels compiled by processes of its own."""

import os
import subprocess
import sys
from _thread import interrupt_main
from errno import EAGAIN
from threading import Thread, Timer

import pytest

from rakelight import jit
from rakelight.cli import compiling, first_run
from rakelight.cli.first_run import compiling_beside, parts_to_compile
from rakelight.cli.progress import shown_progress
from rakelight.errors import MachineError
from rakelight.model import Progress
from rakelight.photometry import _kernels

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
    monkeypatch.setattr(jit, "to_be_cached", lambda: list(jit._kernels))
    monkeypatch.setattr(jit, "cores", lambda: 2)


def test_each_part_has_a_process_that_ends_with_the_block(monkeypatch, started):
    never_compiled(monkeypatch)

    def interrupted():
        with compiling_beside():
            assert [each.poll() for each in started] == [None, None, None]
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [each.poll() is None for each in started] == [False, False, False]


def test_a_kernel_waits_for_its_process_and_only_for_that(monkeypatch, started):
    never_compiled(monkeypatch)
    with compiling_beside():
        waiting = Thread(target=jit._wait, args=[_kernels.light_terms])
        jit._wait(_kernels.halve)  # no part's: returns
        waiting.start()
        waiting.join(0.3)
        assert waiting.is_alive()
        started[1].kill()  # as if it had failed
        waiting.join()
        assert [each.poll() is None for each in started] == [True, False, True]
    assert jit._wait is None


def test_an_interrupt_ends_every_wait(monkeypatch, started):
    never_compiled(monkeypatch)
    ended = []

    def waiting():
        with pytest.raises(jit.StoppedError):
            jit._wait(_kernels.light_terms)
        ended.append("without compiling")

    with compiling_beside():
        other = Thread(target=waiting)
        other.start()
        Timer(0.2, interrupt_main).start()
        with pytest.raises(KeyboardInterrupt):
            jit._wait(_kernels.linearize)
        other.join(5)
        assert ended == ["without compiling"]
        assert [each.poll() for each in started] == [None, None, None]


def test_a_process_ends_with_the_one_that_began_it(tmp_path):
    command = [sys.executable, "-m", "rakelight.cli.compiling", "linearize", "--beside"]
    folder = {"PYTHONPATH": os.fspath(SOURCES), "NUMBA_CACHE_DIR": os.fspath(tmp_path)}
    process = subprocess.Popen(command, stdin=subprocess.PIPE, env={**os.environ, **folder})
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(1)
    process.communicate(timeout=10)
    assert process.returncode == 0
    assert not list(tmp_path.rglob("*.linearize-*.nbi"))


def test_parts_for_highlights_are_begun_when_one_is_needed(monkeypatch, started):
    never_compiled(monkeypatch)
    with compiling_beside():
        waiting = Thread(target=jit._wait, args=[_kernels.linearize_glossy])
        waiting.start()
        waiting.join(0.3)
        assert waiting.is_alive()
        assert len(started) == 5
        started[3].kill()
        waiting.join()
        jit._wait(_kernels.linearize_glossy)  # once only
        assert len(started) == 5


def test_a_kernel_that_is_compiled_already_does_not_wait(monkeypatch):
    compiling.CALLS["light_terms"]()
    with jit.waiting_for_others(lambda kernel: pytest.fail(kernel.__name__)):
        compiling.CALLS["light_terms"]()


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
    assert parts_to_compile() == tuple(compiling.CALLS)
    monkeypatch.setattr(first_run.jit if name == "cores" else first_run, name, lambda: value)
    assert not parts_to_compile()


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


@pytest.mark.parametrize("compiles", [False, True])
def test_a_command_that_compiles_nothing_does_not_speak_of_it(monkeypatch, capfd, compiles):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setattr("rakelight.cli.progress._compiled", lambda: False)
    with shown_progress(compiles=compiles) as progress:
        progress(Progress("read"))
    assert ("compiling" in capfd.readouterr().err) == compiles


def test_an_empty_cache_is_seen(tmp_path):
    program = "from rakelight.cli.first_run import parts_to_compile as p; print(*p())"
    folder = {"PYTHONPATH": os.fspath(SOURCES), "NUMBA_CACHE_DIR": os.fspath(tmp_path)}
    several = {"NUMBA_NUM_THREADS": "2"}
    found = subprocess.check_output(
        [sys.executable, "-c", program], env={**os.environ, **folder, **several}, text=True
    )
    assert found.split() == list(compiling.CALLS)


def test_parts_are_compiled_for_the_types_of_every_other_call():
    # In a process of its own: here other tests have called the kernels.
    program = """if True:
        from rakelight import jit
        from rakelight.cli import compiling
        from rakelight.pipeline import refine
        from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

        def versions():
            kernels = [each for each in jit._kernels if compiling.part_of(each)]
            return {each.__name__: len(each.dispatcher.signatures) for each in kernels}

        for call in compiling.CALLS.values():
            call()
        before = versions()
        vase = make_shape("vase")
        options = SceneOptions(camera=vase.camera.scaled(0.4), photographs=12, specular=0.5)
        result = refine(render_scene(vase, make_albedo("pattern"), options)[0])
        assert "highlights" in {each.code for each in result.findings}
        assert before == versions(), (before, versions())
        assert all(before.values()), before
    """
    subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": os.fspath(SOURCES)},
        check=True,
    )
