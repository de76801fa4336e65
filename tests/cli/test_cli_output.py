"""What the commands say: --json, --quiet, --debug, and progress on a terminal only."""

import json
import os
import re

import click
import pytest

from rakelight import __version__
from rakelight.cli.commands import COMMANDS, rakelight
from rakelight.export import load_result
from tests.cli.cli_helpers import QUICK
from tests.cli.cli_process import run_process, start


@pytest.fixture(params=["refine", "synth", "eval", "demo"])
def command(request, capture, result, tmp_path, monkeypatch):
    """A call of each command that works, with little to do."""
    from tests.cli.cli_helpers import small_scene

    monkeypatch.setattr("rakelight.synthetic.demo_scene", small_scene)
    out = tmp_path / "out"
    return {
        "refine": ("refine", capture, "-o", out, *QUICK),
        "synth": ("synth", out, "--size", "0.1", "--lights", "3"),
        "eval": ("eval", result, "--truth", capture, "--maps", out),
        "demo": ("demo", "-o", out),
    }[request.param]


def test_json_is_one_document_and_nothing_else(run, command):
    ran = run(*command, "--json")
    assert (ran.code, ran.err) == (0, "")
    assert isinstance(json.loads(ran.out), dict)
    assert ran.out.count("\n") == 1


def test_quiet_prints_nothing(run, command, tmp_path):
    ran = run(*command, "--quiet")
    assert (ran.code, ran.out, ran.err) == (0, "", "")
    assert any((tmp_path / "out").iterdir())


def test_json_is_printed_even_if_quiet(run, command):
    assert json.loads(run(*command, "--json", "--quiet").out)


@pytest.mark.parametrize("option", ["--json", "--quiet"])
def test_errors_are_told_all_the_same(run, tmp_path, option):
    ran = run("refine", tmp_path / "none", "-o", tmp_path / "out", option)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"error: {tmp_path}/none: no such folder")


def test_what_refine_says(run, capture, tmp_path):
    out = tmp_path / "out"
    ran = run("refine", capture, "-o", out)
    first, expected, last = ran.out.splitlines()
    assert re.fullmatch(
        r"[a-z-]+: 5 photographs, 48 x 36, 384 pixels, (converged|stopped) after \d+ iterations",
        first,
    )
    depth_m, normals_deg = load_result(out).expected_errors
    errors = f"{1000 * depth_m:.2g} mm in depth, {normals_deg:.2g} degrees in normals"
    assert expected == f"expected errors: {errors} (medians)"
    assert last == f"result: {out}  (look at it with `rakelight view {out}`)"
    # Without a terminal on stderr no progress is shown.
    assert all(re.match("(note|warning): ", line) for line in ran.err.splitlines())
    assert "note: median depth 0.7" in ran.err


def test_one_iteration_is_no_iterations(run, capture, tmp_path):
    command = ("refine", capture, "-o", tmp_path / "out", "--method", "fusion-like")
    ran = run(*command, "--set", "max_iterations=1")
    assert ran.out.splitlines()[0].endswith("pixels, stopped after 1 iteration")
    assert "warning: not converged after 1 iteration. Fix: " in ran.err


def test_what_refine_says_in_json(run, capture, tmp_path):
    out = tmp_path / "out"
    said = json.loads(run("refine", capture, "-o", out, "--json").out)
    stored = json.loads((out / "result.json").read_text())
    assert said["output"] == str(out)
    assert (said["photographs"], said["pixels"]) == (5, 384)
    for key in ("method", "iterations", "converged", "pixels", "findings"):
        assert said[key] == stored[key]
    depth_m, normals_deg = load_result(out).expected_errors
    assert said["expected_errors"]["depth_mm"] == pytest.approx(1000 * depth_m, abs=1e-3)
    assert said["expected_errors"]["normals_deg"] == pytest.approx(normals_deg, abs=1e-2)
    assert set(said["timings_s"]) == set(stored["timings_s"]) >= {"read", "prepare", "refine"}


def test_debug_shows_the_traceback_before_the_line(run, tmp_path):
    command = ("refine", tmp_path / "none", "-o", tmp_path / "out")
    plain, debug = run(*command), run(*command, "--debug")
    assert "Traceback" not in plain.err
    assert debug.err.startswith("Traceback (most recent call last):\n")
    assert debug.err.endswith(plain.err)
    assert (plain.code, debug.code) == (2, 2)


# --- the program itself ---


def test_help_names_every_command(run):
    ran = run("--help")
    assert (ran.code, ran.err) == (0, "")
    for name, text in COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(text[:20])}", ran.out, re.MULTILINE)


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_each_command(run, name):
    ran = run(name, "--help")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith(f"Usage: rakelight {name}")
    command = rakelight.get_command(click.Context(rakelight), name)
    assert command.help
    for option in command.params:
        assert isinstance(option, click.Argument) or option.help, f"no help for {option.name}"


def test_version(run):
    assert run("--version").out == f"rakelight {__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["refin"], "No such command 'refin'"),
        (["refine"], "Missing argument 'CAPTURE' (see rakelight refine --help)"),
        (["refine", "x"], "Missing option '-o'"),
        (["refine", "x", "-o"], "requires an argument"),
        (
            ["refine", "x", "-o", "y", "--mesh", "obj"],
            "'obj' is not one of 'ply', 'glb', 'stl'",
        ),
        (["refine", "x", "-o", "y", "--normalmap", "z"], "Did you mean"),
        (["refine", "x", "y", "-o", "z"], "unexpected extra argument (y)"),
        (["synth", "x", "--lights", "many"], "Invalid value for '--lights'"),
        (["eval", "x"], "Missing option '--truth'"),
        (["paper"], "figure7, figure8 (see rakelight paper --help)"),
    ],
)
def test_calls_that_are_wrong(run, arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ran = run(*arguments)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("error: ")
    assert ran.err.count("\n") == 1
    assert words in ran.err
    assert list(tmp_path.iterdir()) == []


def test_no_command_shows_the_help(run):
    ran = run()
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith("Usage: rakelight")


def test_arguments_default_to_those_of_the_process():
    assert run_process("--version") == (0, f"rakelight {__version__}\n".encode(), b"")


# --- progress ---


def on_terminal(*arguments):
    """(exit code, stdout, what a terminal of 100 columns on stderr shows, without its colours)."""
    pty = pytest.importorskip("pty")
    ours, its = pty.openpty()
    terminal = {"TERM": "xterm", "COLUMNS": "100"}
    with start(*arguments, env=terminal, stdout=-1, stderr=its) as process:
        os.close(its)
        shown = b""
        while True:
            try:
                data = os.read(ours, 4096)
            except OSError:  # how Linux ends it
                data = b""
            if not data:
                break
            shown += data
        out = process.stdout.read()
    os.close(ours)
    return process.returncode, out.decode(), re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode())


def test_progress_on_a_terminal(capture, tmp_path):
    code, out, shown = on_terminal("refine", capture, "-o", tmp_path / "out")
    assert code == 0
    shown = shown.replace("\r", "\n")
    stages = [line.split("━")[0].strip() for line in shown.splitlines() if "━" in line]
    assert [*dict.fromkeys(stages)][:2] == ["read", "prepare"]
    assert stages[-1] == "write"
    # The method's own stages come between them, with iteration and energy.
    iteration = re.search(r"━ (\d+)/(\d+)  energy -?\d+\.\d", shown)
    assert iteration, shown
    assert 0 <= int(iteration[1]) <= int(iteration[2]) > 1
    assert out.startswith("multi-light")
    assert "\x1b" not in out


def test_no_progress_beside_json(capture, tmp_path):
    code, out, shown = on_terminal("refine", capture, "-o", tmp_path / "out", "--json", *QUICK)
    assert (code, shown) == (0, "")
    assert json.loads(out)["photographs"] == 5


def test_an_error_on_a_terminal_stands_on_a_line_of_its_own(capture, tmp_path):
    (capture / "mask.png").write_bytes(b"")
    code, out, shown = on_terminal("refine", capture, "-o", tmp_path / "out")
    assert (code, out) == (2, "")
    last = shown.replace("\r", "\n").rstrip("\n").split("\n")[-1]
    assert last.startswith(f"error: {capture}/mask.png: the file is empty")
