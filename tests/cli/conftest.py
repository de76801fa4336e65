"""A tiny capture, and the command run on it in this process."""

import os
import shutil
from dataclasses import dataclass

import pytest

from rakelight.capture import write_capture
from rakelight.cli import main
from tests.cli.cli_helpers import contents, small_scene


@dataclass(frozen=True)
class Ran:
    """What a command left: its exit code, stdout and stderr."""

    code: int
    out: str
    err: str


@pytest.fixture(scope="session")
def pristine(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pristine") / "capture"
    capture, truth = small_scene()
    write_capture(capture, folder, truth=truth, depth_scale=10_000)
    return folder


@pytest.fixture
def capture(pristine, tmp_path):
    """A capture folder of the test's own."""
    return shutil.copytree(pristine, tmp_path / "capture")


@pytest.fixture(scope="session")
def refined(pristine):
    """A result folder of the tiny capture."""
    folder = pristine.parent / "result"
    with pytest.raises(SystemExit) as left:
        main(["refine", str(pristine), "-o", str(folder), "--quiet"])
    assert left.value.code == 0
    return folder


@pytest.fixture
def result(refined, tmp_path):
    """A result folder of the test's own, which `refine` wrote."""
    return shutil.copytree(refined, tmp_path / "result")


@pytest.fixture
def run(capfd):
    """Run a command; it has to leave by sys.exit."""

    def run(*arguments):
        capfd.readouterr()
        with pytest.raises(SystemExit) as left:
            main([os.fsdecode(argument) for argument in arguments])
        out, err = capfd.readouterr()
        return Ran(left.value.code, out, err)

    return run


@pytest.fixture
def refused(run, tmp_path):
    """Run a command that has to fail: with one clear line, and nothing changed on the disk."""

    def refused(*arguments, about, words=(), code=2):
        before = contents(tmp_path)
        ran = run(*arguments)
        assert ran.out == ""
        line = ran.err.removesuffix("\n")
        assert line.isprintable(), ran.err
        assert line.startswith(f"error: {about}: "), line
        assert "needed " in line or "Fix: " in line or line.endswith("the file is empty"), line
        for word in words:
            assert word in line, line
        assert ran.code == code
        assert contents(tmp_path) == before
        return line

    return refused


@pytest.fixture
def refine_refused(refused, capture, tmp_path):
    """`refused` for `refine CAPTURE -o OUT`; `about` is a file of the capture, or "" for it."""

    def refine_refused(about, *words, code=2, options=()):
        source = f"{capture}/{about}" if about else str(capture)
        command = ("refine", capture, "-o", tmp_path / "out", *options)
        return refused(*command, about=source, words=words, code=code)

    return refine_refused
