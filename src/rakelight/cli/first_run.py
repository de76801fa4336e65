"""The first run on a machine: other processes compile beside this one, which takes half as long."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from subprocess import DEVNULL, Popen

from rakelight import jit
from rakelight.errors import MachineError
from rakelight.memory import available_memory

# Free memory, bytes, with which other processes are started: two of them take 0.4e9 together.
ENOUGH_MEMORY = 2e9


@contextmanager
def compiling_beside() -> Iterator[None]:
    """While the block runs, a process for each large kernel that was not compiled before.

    A kernel that is not done when the block needs it is compiled by this process as well.  The
    processes end with the block.
    """
    processes: list[Popen[bytes]] = []
    try:
        for name in kernels_to_compile():
            # "-P": what lies in the current folder is no library.
            command = [sys.executable, "-P", "-m", "rakelight.photometry.compiling", name]
            processes.append(Popen(command, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL))
    except (OSError, MachineError):  # too few processes or too little memory: only time is lost
        pass
    try:
        yield
    finally:
        for each in processes:
            each.kill()
        for each in processes:
            each.wait()


def kernels_to_compile() -> tuple[str, ...]:
    """Names of the large kernels to compile beside this process; none where that is no gain."""
    from rakelight.photometry import _kernels
    from rakelight.photometry.compiling import CALLS

    if not sys.executable or jit.cores() < 2 or available_memory() < ENOUGH_MEMORY:
        return ()
    return tuple(name for name in CALLS if jit.to_be_cached(getattr(_kernels, name)))
