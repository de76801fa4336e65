"""`rakelight batch` as a shell starts it: real workers, and everything that ends them."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rakelight.batch.record import Entry, write_record
from rakelight.capture import write_capture
from rakelight.cli import main
from rakelight.methods import METHODS
from tests.cli.cli_helpers import contents, small_scene
from tests.cli.cli_process import PROGRAM, run_process, start

psutil = pytest.importorskip("psutil", reason="comes with Dask")

ONE_STEP = ("--method", "multi-light-alternating", "--set", "max_iterations=2")
QUICK = (*ONE_STEP, "--workers", "2")
PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}


@pytest.fixture(scope="module")
def capture_of_four(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pristine") / "capture"
    write_capture(small_scene(photographs=4)[0], folder, depth_scale=10_000)
    return folder


@pytest.fixture
def captures(capture_of_four, tmp_path):
    """Five good captures, each with content of its own, one damaged and one empty."""
    for i in range(5):
        folder = shutil.copytree(capture_of_four, tmp_path / "captures" / f"good{i}")
        (folder / "note.txt").write_text(str(i))
    damaged = shutil.copytree(capture_of_four, tmp_path / "captures" / "damaged")
    (damaged / "rgb" / "001.png").write_bytes(b"no picture")
    (tmp_path / "captures" / "empty").mkdir()
    return tmp_path / "captures"


def until(condition, process, seconds=120):
    """Wait until the condition holds; the process has to be at work meanwhile."""
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.02)


def results(out):
    """inode and time of every whole result: another one of the same name has others."""
    return {
        path.parent.name: (path.stat().st_ino, path.stat().st_mtime_ns)
        for path in out.glob("[!.]*/result.json")
    }


def names_in(folder):
    return {path.name for path in folder.iterdir()}


def family(process):
    return psutil.Process(process.pid).children(recursive=True)


def workers(process):
    return [each for each in family(process) if "spawn_main" in " ".join(each.cmdline())]


def all_gone(processes):
    """Whether they end within moments."""
    _, alive = psutil.wait_procs(processes, timeout=5)
    return not [each for each in alive if each.status() != psutil.STATUS_ZOMBIE]


def test_killed_workers_and_killed_runs(captures, tmp_path):
    out = tmp_path / "out"
    command = ("batch", f"{captures}/*", "-o", out, *QUICK)
    with start(*command, **PIPES) as process:
        until(lambda: len(results(out)) >= 1, process)
        workers(process)[0].kill()
        until(lambda: len(results(out)) >= 3, process)
        started, before = family(process), results(out)
        process.kill()
    assert all_gone(started)

    code, printed, said = run_process(*command, "--json")
    assert code == 4, said
    told = json.loads(printed)
    assert told["computed"] + told["skipped"] == 5
    assert told["skipped"] >= len(before) >= 3
    assert told["failed"] == 2
    after = results(out)
    assert sorted(after) == [f"good{i}" for i in range(5)]
    assert {name: after[name] for name in before} == before
    messages = {each["name"]: each["message"] for each in told["captures"] if each["message"]}
    assert "001.png" in messages["damaged"]
    assert "an empty folder" in messages["empty"]
    assert names_in(tmp_path) == {"captures", "out"}
    assert names_in(out) == {*after, "batch.json", "index.html"}

    code, printed, _ = run_process(*command[:-1], "1")
    assert (code, results(out)) == (4, after)
    assert b"7 captures: 0 refined, 5 were done before, 2 failed" in printed


@pytest.mark.parametrize(("name", "count"), [("SIGINT", 2), ("SIGTERM", 1)])
def test_an_interrupt_ends_the_workers_and_keeps_what_is_whole(captures, tmp_path, name, count):
    out = tmp_path / "out"
    command = ("batch", f"{captures}/*", "-o", out, *ONE_STEP, "--workers", str(count))
    with start(*command, start_new_session=True, **PIPES) as process:
        until(lambda: len(results(out)) >= 1, process)
        started = family(process)
        began = time.monotonic()
        if name == "SIGINT":  # a terminal sends it to all of them
            os.killpg(process.pid, signal.SIGINT)
        else:
            process.terminate()
        _, said = process.communicate(timeout=20)
    assert process.returncode == 130
    assert time.monotonic() - began < 6  # five, and what a busy machine adds
    assert said.strip() == b"error: interrupted; nothing unfinished was left behind"
    assert all_gone(started)
    assert len(results(out)) >= 1
    assert not list(tmp_path.rglob(".*"))
    states = {each["state"] for each in json.loads((out / "batch.json").read_text())["captures"]}
    assert "waiting" in states


# Ends every process that loads this method, by the signal that the system uses without memory.
KILLER = """
import os, signal, sys
class At:
    def find_spec(self, name, *_):
        if name == "rakelight.methods.ldr_ps" and "--multiprocessing-fork" in sys.orig_argv:
            with open(os.environ["TRIES"], "a") as file: file.write("x")
            os.kill(os.getpid(), signal.SIGKILL)
sys.meta_path.insert(0, At())
"""


def test_a_capture_that_kills_its_worker_is_tried_twice_and_fails_alone(captures, tmp_path):
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(KILLER)
    path = os.pathsep.join([str(tmp_path / "site"), os.fspath(SOURCES)])
    environment = {"PYTHONPATH": path, "TRIES": str(tmp_path / "tries")}
    out = tmp_path / "out"
    code, printed, said = run_process(
        "batch", captures / "good0", "-o", out, "--method", "ldr-ps", "--workers", "1",
        env=environment,
    )  # fmt: skip
    assert code == 4, said
    assert (tmp_path / "tries").read_text() == "xx"
    assert b"failed: good0: " in said
    assert b"the process was killed (signal 9), and once more" in said
    assert said.count(b"\n") == 1
    assert b"1 capture: 0 refined" in printed


SOURCES = Path(main.__code__.co_filename).resolve().parents[2]


@pytest.fixture
def refused_batch(refused, tmp_path):
    """`refused` for a batch; no worker is started."""

    def refused_batch(*arguments, about, words=(), code=2):
        return refused("batch", *arguments, about=about, words=words, code=code)

    return refused_batch


UNKNOWN = f"method 'best' is unknown (needed one of auto, {', '.join(METHODS)}). Fix"


def test_calls_that_are_wrong(captures, refused_batch, tmp_path):
    good, out = captures / "good0", tmp_path / "out"
    refused_batch(good, "-o", captures, about=captures, words=["no batch wrote it"])
    refused_batch(good, "-o", good / "out", about=good / "out", words=["never changed"])
    refused_batch(f"{captures}/x*", "-o", out, about=f"{captures}/x*", words=["nothing matches"])
    refused_batch(good, "-o", out, "--set", "a=1", "--method", "ldr-ps", about="--set a")
    refused_batch(good, "-o", out, "--set", "a=1", about="--set a")  # no method has it
    refused_batch(good, "-o", out, "--set", "depth_weight=-3", about="--set", words=["above 0"])
    refused_batch(good, "-o", out, "--method", "best", about=UNKNOWN)
    both = ("--workers", "1", "--scheduler", "tcp://127.0.0.1:1")
    refused_batch(good, "-o", out, *both, about="--workers", words=["not both"])
    refused_batch(good, "-o", out, "--scheduler", "there", about="--scheduler")
    (tmp_path / "file").touch()
    refused_batch(good, "-o", tmp_path / "file", about=tmp_path / "file", words=["a file stands"])


def test_a_scheduler_that_does_not_answer(captures, refused_batch, tmp_path, monkeypatch):
    monkeypatch.setattr("rakelight.batch.cluster.ANSWER_S", 0.2)
    address = "tcp://127.0.0.1:1"
    arguments = (captures / "good0", "-o", tmp_path / "out", "--scheduler", address)
    refused_batch(*arguments, about=address, words=["no Dask scheduler answers"], code=3)


def test_without_dask_the_extra_is_named(captures, refused_batch, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    arguments = (captures / "good0", "-o", tmp_path / "out")
    about = "rakelight batch: a library that it needs is not installed (needed distributed). Fix"
    refused_batch(*arguments, about=about, words=['pip install "rakelight[batch]"'], code=3)


FEW_FILES = "import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (25, 25))\n"
UNCHECKED = "import rakelight.batch.cluster as c; c.require_files = lambda *_, **__: None\n"


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit")
@pytest.mark.parametrize(
    ("begin", "line"),
    [
        (FEW_FILES, "1 worker: the system opens no more files (seen "),
        (FEW_FILES + UNCHECKED, "no worker processes can be started (seen Too many open files)"),
    ],
    ids=["foreseen", "not foreseen"],
)
def test_too_few_open_files(captures, tmp_path, begin, line):
    command = ("batch", captures / "good0", "-o", tmp_path / "out", "--workers", "1")
    code, out, err = run_process(*command, program=begin + PROGRAM)
    assert (code, out, err.count(b"\n")) == (3, b"", 1), err
    assert err.startswith(b"error: " + line.encode()), err
    assert b"(`ulimit -" in err


def test_the_same_folder_twice_at_once(captures, refused_batch, tmp_path):
    from rakelight.folders import only_writer

    out = tmp_path / "out"
    with only_writer(out):
        arguments = (captures / "good0", "-o", out, "--workers", "1")
        refused_batch(*arguments, about=out, words=["another run"], code=3)
        assert not (tmp_path / "out").exists()
    assert set(contents(tmp_path)) - set(contents(captures.parent)) == set()


@pytest.mark.parametrize("begun", [True, False])
def test_the_results_among_the_captures_are_left_out(run, captures, monkeypatch, begun):
    out, asked = captures / "out", []
    out.mkdir()
    if begun:
        entry = Entry(source=str(captures / "good0"), name="good0", state="done")
        write_record(out, {}, [entry])

    def run_batch(jobs, *_, **__):
        asked.extend(job.name for job in jobs)
        return []

    monkeypatch.setattr("rakelight.batch.run.run_batch", run_batch)
    shell = sorted(path for path in captures.iterdir() if path.is_dir())
    ran = run("batch", *shell, "-o", out)
    assert (ran.code, asked) == (0, [path.name for path in shell if path != out])
    assert ran.err == f"note: {out}: this is OUT itself, no capture\n"
    assert run("batch", *shell, "-o", out, "--quiet").err == ""


def test_the_results_alone_are_no_captures(refused_batch, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    refused_batch(out, "-o", out, about=out, words=["no capture but OUT itself"])
