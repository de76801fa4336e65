"""faults.md 22-27: memory, odd paths, occupied outputs, full disks, interruptions, two runs."""

import errno
import os
import shutil
import signal
from functools import partial
from pathlib import Path

import pytest

from rakelight.errors import MachineError
from rakelight.export import RESULT
from rakelight.folders import only_writer, staged_folder
from tests.cli.cli_helpers import QUICK, contents
from tests.cli.cli_process import PROGRAM, run_process
from tests.full_disk import full_at

ODD_NAMES = [
    b"with space",
    "Größe Ω 日本".encode(),
    b"new\nline",
    b"-o",
    b"--",
    b"caf\xe9",
    b"\x1b[31mred",
    b"quote'\"$HOME;#*?",
]


def copied(capture, name):
    """The capture under another name; skips where the file system refuses that."""
    try:
        return shutil.copytree(capture, capture.with_name(os.fsdecode(name)))
    except OSError as error:
        pytest.skip(f"this file system has no such names: {error}")


def failing(error):
    def fail(*_, **__):
        raise error

    return fail


@pytest.fixture
def old_result(run, capture, tmp_path):
    """An earlier result at `out`, with a file that only it has."""
    command = ("refine", capture, "-o", tmp_path / "out", "--mesh", "glb", *QUICK)
    assert run(*command, "--quiet").code == 0
    return tmp_path / "out"


# --- 23: paths ---


@pytest.mark.parametrize("name", ODD_NAMES)
def test_23_odd_paths(run, capture, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    before = contents(copied(capture, name))
    out = name + b"out"
    ran = run("refine", b"--output=" + out, *QUICK, "--", name)
    assert ran.code == 0, ran.err
    assert ran.out.count("\n") == 2
    assert all(line.isprintable() for line in (ran.out + ran.err).splitlines())
    assert (tmp_path / os.fsdecode(out) / "result.json").is_file()
    assert contents(tmp_path / os.fsdecode(name)) == before
    (tmp_path / os.fsdecode(name) / "mask.png").write_bytes(b"")
    ran = run("refine", "-o", "other", "--", name)
    assert ran.code == 2
    assert ran.err.removesuffix("\n").isprintable()
    assert "mask.png: the file is empty" in ran.err


def test_23_odd_paths_from_a_shell(capture, tmp_path):
    """One that looks like an option, holds letters, a new line, and bytes that are no text."""
    name = b"-o Gr\xc3\xb6\xc3\x9fe \xce\xa9 caf\xe9\n \xff"
    copied(capture, name)
    code, out, err = run_process("refine", "-o", b"out" + name, *QUICK, "--", name, cwd=tmp_path)
    assert code == 0, err
    assert out.count(b"\n") == 2
    assert (tmp_path / os.fsdecode(b"out" + name) / "depth.tiff").is_file()
    (tmp_path / os.fsdecode(name) / "mask.png").write_bytes(b"")
    code, out, err = run_process("refine", "-o", "other", "--", name, cwd=tmp_path)
    assert (code, out) == (2, b"")
    assert err.startswith(b"error: ")
    assert b"/mask.png: the file is empty. Fix: " in err
    assert err.count(b"\n") == 1


def test_23_a_terminal_that_lacks_the_letters(capture, tmp_path):
    latin = {"PYTHONIOENCODING": "latin-1"}
    command = ("refine", capture, "-o", "größe Ω", "--overwrite", *QUICK)
    code, out, err = run_process(*command, cwd=tmp_path, env=latin)
    assert code == 0, err
    assert "größe \\u03a9".encode("latin-1") in out


@pytest.mark.parametrize("name", ["x" * 300, "file/out", "loop", "loop/out"])
def test_23_impossible_outputs(run, capture, tmp_path, name):
    (tmp_path / "file").write_text("x")
    (tmp_path / "loop").symlink_to("loop")
    before = contents(capture)
    ran = run("refine", capture, "-o", tmp_path / name)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"error: {tmp_path / name}: ")
    assert "). Fix: choose a" in ran.err
    assert ran.err.count("\n") == 1
    assert contents(capture) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture", "file", "loop"]


@pytest.mark.parametrize("name", ["no such folder", "capture/capture.toml", "loop"])
@pytest.mark.usefixtures("capture")
def test_23_impossible_captures(refused, tmp_path, name):
    (tmp_path / "loop").symlink_to(tmp_path / "loop2")
    (tmp_path / "loop2").symlink_to(tmp_path / "loop")
    source = tmp_path / name
    refused("refine", source, "-o", tmp_path / "out", about=source)


@pytest.mark.usefixtures("deleted_working_directory", "capture")
@pytest.mark.parametrize(
    ("about", "command"),
    [
        ("x", "refine {here}/capture -o x"),
        (".", "refine . -o {here}/out"),
        (".", "import . -o {here}/out"),
        ("x.html", "check {here}/capture --html x.html"),
        ("out/demo", "demo"),
        ("x*", "batch x* -o {here}/out"),
    ],
)
def test_23_paths_that_begin_at_a_deleted_folder(refused, tmp_path, about, command):
    words = ("the working directory is not there any more", "Fix: change to another one with `cd`")
    arguments = (word.format(here=tmp_path) for word in command.split())
    refused(*arguments, about=about, words=words, code=3)


@pytest.mark.usefixtures("deleted_working_directory")
def test_23_absolute_paths_from_a_deleted_folder(run, capture, old_result):
    assert run("refine", capture, "-o", old_result, "--overwrite", "--quiet", *QUICK).code == 0
    assert not (old_result / "mesh.glb").exists()


# --- 24: outputs ---


def test_24_an_existing_result_needs_overwrite(run, refused, capture, old_result, tmp_path):
    words = ("the folder exists", "--overwrite")
    refused("refine", capture, "-o", old_result, about=old_result, words=words)
    assert run("refine", capture, "-o", old_result, "--overwrite", "--quiet", *QUICK).code == 0
    assert not (old_result / "mesh.glb").exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture", "out"]


def test_24_what_is_not_a_result_is_never_replaced(refused, capture, tmp_path):
    mine, file = tmp_path / "mine", tmp_path / "file"
    mine.mkdir()
    (mine / "thesis.tex").write_text("x")
    file.write_text("x")
    command = ("refine", capture, "--overwrite", "-o")
    refused(*command, mine, about=mine, words=("not written by rakelight", "Fix: "))
    refused(*command, file, about=file, words=("a file stands", "Fix: choose another name"))


@pytest.mark.parametrize("overwrite", [(), ("--overwrite",)])
@pytest.mark.parametrize("inside", ["", "rgb", "new/one", "../capture", "../link", "../link/new"])
def test_24_the_capture_is_never_written_to(refused, capture, tmp_path, inside, overwrite):
    (tmp_path / "link").symlink_to(capture)
    (capture / "result.json").write_text("{}")  # looks like a result, too
    out = f"{capture}/{inside}"
    command = ("refine", capture, "-o", out, *overwrite)
    about = Path(out)  # as given, without a trailing slash
    refused(*command, about=about, words=("into the capture, which is never changed", "Fix: "))


def test_24_a_capture_in_an_older_result_is_not_replaced_with_it(refused, capture, old_result):
    inner = old_result / "my" / "capture"
    shutil.copytree(capture, inner)
    words = ("the capture lies in this folder", "Fix: ")
    command = ("refine", inner, "-o", old_result, "--overwrite")
    refused(*command, about=old_result, words=words)


# --- 25: the machine ---


def is_mesh(path):
    return path.suffix == ".ply"


def test_25_full_disk(run, capture, tmp_path, monkeypatch):
    full_at(monkeypatch, is_mesh)
    before = contents(tmp_path)
    ran = run("refine", capture, "-o", tmp_path / "out", *QUICK)
    assert (ran.code, ran.out, ran.err.count("\n")) == (3, "", 1)
    assert ran.err.startswith(f"error: {tmp_path}/.out.rakelight-")
    assert "mesh.ply: cannot be written (seen No space left on device, needed more than" in ran.err
    assert " bytes). Fix: free some space" in ran.err
    assert contents(tmp_path) == before


def test_25_full_disk_leaves_the_old_result_whole(run, capture, old_result, tmp_path, monkeypatch):
    full_at(monkeypatch, is_mesh)
    before = contents(tmp_path)
    assert run("refine", capture, "-o", old_result, "--overwrite", *QUICK).code == 3
    assert contents(tmp_path) == before


@pytest.mark.parametrize("code", [errno.EROFS, errno.EACCES])
def test_25_read_only_place(refused, capture, tmp_path, monkeypatch, code):
    made = Path.mkdir

    def mkdir(self, *arguments, **options):
        if self.suffix == ".partial":
            raise OSError(code, os.strerror(code), str(self))
        made(self, *arguments, **options)

    monkeypatch.setattr(Path, "mkdir", mkdir)
    words = ("cannot be written", os.strerror(code), "Fix: choose a folder that you may write to")
    out = tmp_path / "out"
    refused("refine", capture, "-o", out, *QUICK, about=out, words=words, code=3)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write")
def test_25_a_folder_without_permission(run, capture, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(0o500)
    ran = run("refine", capture, "-o", locked / "out")
    assert ran.code == 3
    assert ran.err.startswith(f"error: {locked}/out: cannot be written (seen Permission denied")
    assert list(locked.iterdir()) == []


def test_25_where_nothing_can_be_written_no_work_is_done(refused, capture, tmp_path, monkeypatch):
    for work in ("capture.load_capture", "synthetic.write_scene", "paper.make.folder_of"):
        monkeypatch.setattr(f"rakelight.{work}", failing(AssertionError("work was done")))
    (tmp_path / "file").write_text("x")
    out = tmp_path / "file" / "out"
    for command in (("refine", capture, "-o", out), ("synth", out), ("paper", "table2", "-o", out)):
        refused(*command, about=out, words=("cannot be written (seen Not a directory",))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_25_a_full_disk_behind_stdout(capture, tmp_path):
    with open("/dev/full", "wb") as full:  # noqa: PTH123
        code, _, err = run_process("refine", capture, "-o", tmp_path / "out", *QUICK, stdout=full)
    assert code == 3
    assert err.splitlines()[-1].startswith(b"error: ")
    assert b"No space left on device" in err


def test_25_too_little_memory(run, capture, tmp_path, monkeypatch):
    monkeypatch.setattr("rakelight.pipeline.surface", failing(MemoryError()))
    ran = run("refine", capture, "-o", tmp_path / "out", *QUICK)
    assert (ran.code, ran.out) == (3, "")
    assert ran.err.startswith("error: not enough memory. Fix: close other programs, use --scale 1")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("free", [4e4, 5e5])
def test_22_too_little_memory_is_told_before_the_start(refine_refused, monkeypatch, free):
    # The photographs take 0.05 MB, the work on the object's window 0.9, what is loaded on the way
    # 200.
    monkeypatch.setattr("rakelight.memory.free_memory", lambda: free)
    monkeypatch.setattr("rakelight.pipeline.surface", failing(AssertionError("started")))
    refine_refused("", "too little memory", "needed 20", "Fix: ", code=3)


@pytest.mark.parametrize("size", ["lots", "0GB", "4", "-1GB", "4 TB"])
def test_a_limit_that_is_no_size_is_refused(refused, capture, tmp_path, size):
    words = ("not a size of memory", f"seen '{size}'", "needed a size as 4GB")
    command = ("refine", capture, "-o", tmp_path / "out", f"--memory={size}")
    refused(*command, about="--memory", words=words)


@pytest.mark.parametrize(
    ("options", "needed_mb"),
    [((), "1"), (("--depth-frames", "10000"), "36")],
)
def test_22_synth_tells_too_little_memory(refused, tmp_path, monkeypatch, options, needed_mb):
    monkeypatch.setattr("rakelight.memory.free_memory", lambda: 1e6)
    words = ("too little memory", f"needed {needed_mb}", "fewer --depth-frames")
    command = ("synth", tmp_path / "made", "--size", "0.1", *options)
    refused(*command, about="the scene", words=words, code=3)


# --- 26, 27: interrupted, killed, twice at once ---

WHILE_REFINING = "rakelight.pipeline.surface"
WHILE_WRITING = "rakelight.export.lights_json"


@pytest.mark.parametrize("where", [WHILE_REFINING, WHILE_WRITING])
def test_26_interrupted(run, capture, tmp_path, monkeypatch, where):
    monkeypatch.setattr(where, failing(KeyboardInterrupt()))
    before = contents(tmp_path)
    ran = run("refine", capture, "-o", tmp_path / "out", *QUICK)
    assert (ran.code, ran.out) == (130, "")
    assert ran.err.strip() == "error: interrupted; nothing unfinished was left behind"
    assert contents(tmp_path) == before


@pytest.mark.parametrize("where", [WHILE_REFINING, WHILE_WRITING])
def test_26_interrupted_beside_an_old_result(
    run, capture, old_result, tmp_path, monkeypatch, where
):
    monkeypatch.setattr(where, failing(KeyboardInterrupt()))
    before = contents(tmp_path)
    assert run("refine", capture, "-o", old_result, "--overwrite", *QUICK).code == 130
    assert contents(tmp_path) == before


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL")
def test_26_killed_while_writing(run, capture, old_result, tmp_path):
    dies = "import os, rakelight.export as e; e.lights_json = lambda *_: os.kill(os.getpid(), 9)\n"
    command = ("refine", capture, "-o", old_result, "--overwrite", *QUICK)
    before = contents(old_result)
    code, out, _ = run_process(*command, program=dies + PROGRAM)
    assert (code, out) == (-signal.SIGKILL, b"")
    assert contents(old_result) == before
    assert any(path.suffix == ".partial" for path in tmp_path.iterdir())
    assert run(*command).code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["capture", "out"]


def test_27_two_runs_into_one_folder(run, capture, tmp_path):
    pytest.importorskip("fcntl")
    out = tmp_path / "out"
    with staged_folder(out, manifest=RESULT) as staging:
        ran = run("refine", capture, "-o", out, *QUICK)
        (staging.path / "result.json").write_text("of the first")
    assert (ran.code, ran.out) == (3, "")
    assert ran.err.startswith(f"error: {out}: another run is writing this folder. Fix: wait for it")
    assert (out / "result.json").read_text() == "of the first"


AT_WORK = {
    "refine": WHILE_REFINING,
    "import": "rakelight.capture.readers.find_reader",
    "demo": "rakelight.synthetic.demo_scene",
    "paper": "rakelight.paper.make.folder_of",
}


@pytest.mark.parametrize("command", AT_WORK)
def test_27_the_place_is_taken_before_the_work(run, capture, tmp_path, monkeypatch, command):
    pytest.importorskip("fcntl")
    out, refused = tmp_path / "new" / "out", []
    place = out / "result" if command == "demo" else out
    another_run = partial(pytest.raises, MachineError, match="another run is writing this folder")

    def second(*_, **__):
        with another_run() as caught, only_writer(place):
            pass
        refused.append(caught.value.exit_code)
        raise KeyboardInterrupt

    monkeypatch.setattr(AT_WORK[command], second)
    source = {"demo": (), "paper": ("table1",)}.get(command, (capture,))
    assert run(command, *source, "-o", out).code == 130
    assert refused == [3]
    assert not (tmp_path / "new").exists()


# --- and a bug of ours, and a reader that goes ---


def test_a_bug_is_code_1_and_leaves_nothing(run, capture, tmp_path, monkeypatch):
    monkeypatch.setattr(WHILE_WRITING, failing(ZeroDivisionError("one\ntwo")))
    before = contents(tmp_path)
    ran = run("refine", capture, "-o", tmp_path / "out", *QUICK)
    assert (ran.code, ran.out) == (1, "")
    assert ran.err.startswith("error: a bug in rakelight: ZeroDivisionError: one\\ntwo. Fix: ")
    assert ran.err.count("\n") == 1
    assert contents(tmp_path) == before


def test_a_file_that_ends_early_is_no_interrupt(run, capture, tmp_path, monkeypatch):
    monkeypatch.setattr(WHILE_WRITING, failing(EOFError("Ran out of input")))
    before = contents(tmp_path)
    ran = run("refine", capture, "-o", tmp_path / "out", *QUICK)
    assert (ran.code, ran.out) == (1, "")
    assert ran.err.strip().startswith("error: a bug in rakelight: EOFError: Ran out of input. Fix")
    assert contents(tmp_path) == before


def test_a_reader_that_has_gone_is_no_failure(capture, tmp_path):
    reading, writing = os.pipe()
    os.close(reading)
    command = ("refine", capture, "-o", tmp_path / "out", "--json", *QUICK)
    code, _, err = run_process(*command, stdout=writing)
    os.close(writing)
    assert (code, err) == (0, b"")
    assert (tmp_path / "out" / "result.json").is_file()
