"""The command in a process of its own, as a shell starts it."""

import os
import subprocess
import sys
from pathlib import Path

import rakelight

PROGRAM = "from rakelight.cli import main; main()"
SOURCES = Path(rakelight.__file__).resolve().parents[1]


def start(*arguments, program=PROGRAM, env=None, **options):
    """Popen of the command with these arguments (str, bytes or paths); `env` adds variables."""
    command = [sys.executable, "-c", program, *map(os.fsencode, arguments)]
    environment = {**os.environ, "PYTHONPATH": os.fspath(SOURCES), **(env or {})}
    return subprocess.Popen(command, env=environment, **options)


def run_process(*arguments, program=PROGRAM, **options):
    """(exit code, stdout, stderr) as bytes."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with start(*arguments, program=program, **{**pipes, **options}) as process:
        out, err = process.communicate(timeout=60)
    return process.returncode, out, err
