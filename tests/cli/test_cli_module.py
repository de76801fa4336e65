"""`python -m rakelight` is the program."""

import os
import subprocess
import sys

from rakelight import __version__
from tests.cli.cli_process import SOURCES, run_process


def run_module(*arguments):
    environment = {**os.environ, "PYTHONPATH": os.fspath(SOURCES)}
    command = [sys.executable, "-m", "rakelight", *map(os.fspath, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, timeout=60, check=False)


def test_the_module_says_what_the_program_says():
    for arguments in (["--version"], ["--help"], ["refine", "--help"]):
        ran = run_module(*arguments)
        assert (ran.returncode, ran.stdout, ran.stderr) == run_process(*arguments)
    assert run_module("--version").stdout == f"rakelight {__version__}\n".encode()


def test_the_module_fails_as_the_program_does(tmp_path):
    ran = run_module("refine", tmp_path / "none", "-o", tmp_path / "out")
    assert ran.returncode == 2
    assert ran.stdout == b""
    assert ran.stderr.startswith(f"error: {tmp_path / 'none'}: no such folder".encode())


def test_the_module_refines(capture, tmp_path):
    options = ("--method", "multi-light-alternating", "--set", "max_iterations=1", "--quiet")
    ran = run_module("refine", capture, "-o", tmp_path / "out", *options)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, b"", b"")
    assert (tmp_path / "out" / "result.json").is_file()
