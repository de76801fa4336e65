"""faults.md 43: signals at any moment, streams that take nothing, and limits of the process."""

import os
import signal
import time

import pytest

from tests.cli.cli_helpers import QUICK, contents
from tests.cli.cli_process import PROGRAM, run_process, start

resource = pytest.importorskip("resource")

INTERRUPTED = b"error: interrupted; nothing unfinished was left behind"


def refine(capture, out, *settings, program=PROGRAM, **options):
    return run_process("refine", capture, "-o", out, *settings, program=program, **options)


# --- signals ---

# Each raises `SIGNAL` at its moment.
MOMENTS = {
    "loading": "class At:\n"
    "  def find_spec(self, name, *_):\n"
    "    if name == 'numpy': signal.raise_signal(SIGNAL)\n"
    "sys.meta_path.insert(0, At())\n",
    "writing": "import rakelight.export as e\n"
    "e.lights_json = lambda *_: signal.raise_signal(SIGNAL)\n",
    # A library makes another error of it, or none can be raised there.
    "in a library": "import rakelight.export as e\n"
    "def at(*_):\n"
    "  try: signal.raise_signal(SIGNAL)\n"
    "  except KeyboardInterrupt: raise ImportError('no numpy')\n"
    "e.lights_json = at\n",
    "in a finalizer": "import rakelight.pipeline as m, time\n"
    "class At:\n"
    "  def __del__(self): signal.raise_signal(SIGNAL)\n"
    "def at(*_):\n"
    "  At()\n"
    "  for _ in range(2000): time.sleep(0.01)\n"
    "m.surface = at\n",
    # As where numba compiles: LLVM cannot pass it on, and the program fails by what is missing.
    "lost in a library": "import rakelight.pipeline as m\n"
    "class At:\n"
    "  def __del__(self): signal.raise_signal(SIGNAL)\n"
    "def at(*_):\n"
    "  At()\n"
    "  raise RuntimeError('no compiled object yet')\n"
    "m.surface = at\n",
    # What it leaves half built has a finalizer, as llvmlite's strings have.
    "building an object": "import rakelight.pipeline as m\n"
    "class At:\n"
    "  def __init__(self): signal.raise_signal(SIGNAL); self.owned = True\n"
    "  def __del__(self): self.owned\n"
    "def at(*_):\n"
    "  try: At()\n"
    "  except KeyboardInterrupt: pass\n"
    "  raise KeyboardInterrupt\n"
    "m.surface = at\n",
    # To the process: raised in one of the threads that write it would not wake the main one.
    "a lock that is never free": "import rakelight.export as e, os, threading\n"
    "def at(*_):\n"
    "  try: os.kill(os.getpid(), SIGNAL)\n"
    "  finally: (x := threading.Lock()).acquire(); x.acquire()\n"
    "e.lights_json = at\n",
    "twice, cleaning up": "import rakelight.export as e, shutil\n"
    "e.lights_json = lambda *_: signal.raise_signal(SIGNAL)\n"
    "def twice(*a, rmtree=shutil.rmtree, **k):\n"
    "  signal.raise_signal(SIGNAL)\n"
    "  rmtree(*a, **k)\n"
    "shutil.rmtree = twice\n",
}


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_signal_interrupts_and_leaves_nothing(capture, tmp_path, moment):
    """SIGTERM, or one of the others: what comes of them is the same."""
    name = {"loading": "SIGHUP", "writing": "SIGINT"}.get(moment, "SIGTERM")
    at = f"import signal, sys\nSIGNAL = signal.{name}\n" + MOMENTS[moment]
    before = contents(tmp_path)
    code, out, err = refine(capture, tmp_path / "out", *QUICK, program=at + PROGRAM)
    assert (code, out, err.strip()) == (130, b"", INTERRUPTED)
    if moment != "a lock that is never free":  # the next run cleans up
        assert contents(tmp_path) == before


def test_a_signal_while_ending_changes_nothing(capture, tmp_path):
    at = "import atexit, signal\n"
    for name in ("SIGINT", "SIGTERM"):
        at += f"atexit.register(signal.raise_signal, signal.{name})\n"
    out = tmp_path / "out"
    code, _, err = refine(capture, out, "--quiet", *QUICK, program=at + PROGRAM)
    assert (code, err) == (0, b"")
    assert (out / "result.json").is_file()


def test_what_is_ignored_from_the_start_stays_so(capture, tmp_path):
    at = "import signal, sys\n"
    for name in ("SIGINT", "SIGHUP"):
        at += f"signal.signal(signal.{name}, signal.SIG_IGN)\n"
        at += MOMENTS["loading"].replace("SIGNAL", f"signal.{name}")
    assert refine(capture, tmp_path / "out", *QUICK, program=at + PROGRAM)[0] == 0


@pytest.mark.parametrize("after_s", [0.5, 1.5, 2.5])
def test_signals_at_some_moments(capture, tmp_path, after_s):
    # When Python has started: it tells so, then waits for no one.
    told = "import sys\nsys.stdout.write('go\\n'); sys.stdout.flush()\n" + PROGRAM
    pipes = {"stdout": -1, "stderr": -1}
    out = tmp_path / "out"
    with start("refine", capture, "-o", out, "--quiet", program=told, **pipes) as process:
        assert process.stdout.readline() == b"go\n"
        time.sleep(after_s)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=60)
    assert (process.returncode, err.strip()) in [(130, INTERRUPTED), (0, b"")]
    left = {path.name for path in tmp_path.iterdir()}
    assert left in ({"capture"}, {"capture", "out"})
    assert process.returncode or (out / "result.json").is_file()


# --- streams that take nothing ---


def shell(redirections, *arguments):
    """(exit code, stdout, stderr) of the program with a shell's redirections."""
    line = ["sh", "-c", f'exec "$@" {redirections}', "sh"]
    program = (
        "import os, sys\n"
        f"os.execvp('sh', [*{line}, sys.executable, '-c', {PROGRAM!r}, *sys.argv[1:]])"
    )
    return run_process(*arguments, program=program)


@pytest.mark.parametrize("refused", ["2>/dev/full", "<&- 2>&-"])
def test_stderr_that_takes_nothing_is_no_failure(capture, tmp_path, refused):
    out = tmp_path / "out"
    code, printed, err = shell(refused, "refine", capture, "-o", out, *QUICK)
    assert (code, printed.count(b"\n"), err) == (0, 2, b"")
    assert (out / "result.json").is_file()


@pytest.mark.parametrize("refused", ["2>/dev/full", "2>&-"])
def test_stderr_that_takes_no_error_leaves_its_code(tmp_path, refused):
    code, printed, err = shell(refused, "refine", tmp_path / "none", "-o", tmp_path / "out")
    assert (code, printed, err) == (2, b"", b"")


@pytest.mark.parametrize(
    ("refused", "seen", "options"),
    [(">&-", b"Bad file descriptor", ["--json"]), (">/dev/full", b"No space left", [])],
)
def test_stdout_that_takes_nothing_is_one(capture, tmp_path, refused, seen, options):
    out = tmp_path / "out"
    code, _, err = shell(refused, "refine", capture, "-o", out, *QUICK, *options)
    last = err.splitlines()[-1]
    assert code == 3
    assert last.startswith(b"error: stdout: cannot be written (seen " + seen)
    assert b"Traceback" not in err
    assert b"Exception ignored" not in err
    assert (out / "result.json").is_file()


@pytest.mark.parametrize("refused", [">&-", ">/dev/full"])
def test_stdout_that_takes_nothing_is_none_where_nothing_is_said(tmp_path, refused):
    out = tmp_path / "out"
    little = ("--size", "0.1", "--lights", "3", "--supersampling", "1")
    assert shell(refused, "synth", out, *little, "--quiet")[0] == 0
    assert (out / "capture.toml").is_file()


@pytest.mark.parametrize("options", [["refine", "none", "-o", "x"], ["--help"], []])
def test_readers_that_left(tmp_path, options):
    reading, writing = os.pipe()
    os.close(reading)
    code, _, _ = run_process(*options, stdout=writing, stderr=writing, cwd=tmp_path)
    os.close(writing)
    assert code == (0 if options == ["--help"] else 2)


# --- limits ---


def limited(name, value):
    return f"import resource\nresource.setrlimit(resource.{name}, ({value}, {value}))\n"


@pytest.mark.parametrize("mb", [60, 300, 1200])
def test_too_few_addresses(capture, tmp_path, mb):
    before = contents(tmp_path)
    program = limited("RLIMIT_AS", mb * 1_000_000) + PROGRAM
    code, out, err = refine(capture, tmp_path / "out", program=program)
    assert (code, out, err.count(b"\n")) == (3, b"", 1), err
    assert err.startswith(b"error: rakelight refine: too few addresses for this process (seen ")
    assert b"Fix: raise the limit on virtual memory (`ulimit -v" in err
    assert contents(tmp_path) == before


def test_no_library_is_loaded_with_too_few_addresses(capture, tmp_path):
    program = limited("RLIMIT_AS", 300_000_000) + "import atexit, sys\n"
    program += "atexit.register(lambda: print('numpy' in sys.modules))\n" + PROGRAM
    code, out, err = run_process("import", capture, "-o", tmp_path / "out", program=program)
    assert (code, out) == (3, b"False\n")
    assert err.startswith(b"error: rakelight import: too few addresses for this process (seen ")


@pytest.mark.parametrize("arguments", [("--help",), ("--version",)])
def test_help_needs_few_addresses(arguments):
    program = limited("RLIMIT_AS", 300_000_000) + PROGRAM
    assert run_process(*arguments, program=program)[0] == 0


def test_enough_addresses(capture, tmp_path):
    threads = (os.cpu_count() or 1) * 100_000_000
    program = limited("RLIMIT_AS", 2_000_000_000 + threads) + PROGRAM
    assert refine(capture, tmp_path / "out", program=program)[0] == 0


def test_too_few_threads(capture, tmp_path):
    none = "import _thread, threading\n"
    none += "def no(*_, **__): raise RuntimeError('can' + chr(39) + 't start new thread')\n"
    none += "threading._start_new_thread = threading._start_joinable_thread = no\n"
    code, out, err = refine(capture, tmp_path / "out", program=none + PROGRAM)
    assert (code, out) == (3, b"")
    assert err.startswith(b"error: the system starts no more threads. Fix: ")
