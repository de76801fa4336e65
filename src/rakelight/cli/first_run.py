"""The first run on a machine: other processes compile beside this one, which takes half as long."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from subprocess import DEVNULL, PIPE, Popen
from threading import Event, Lock

from rakelight import jit
from rakelight.errors import MachineError
from rakelight.memory import available_memory

# Free memory, bytes, with which other processes are started: three of them take 0.8e9 together.
ENOUGH_MEMORY = 2e9
# Seconds between two looks at whether a process is done.
POLL_S = 0.05


@contextmanager
def compiling_beside() -> Iterator[None]:
    """While the block runs, a process for each part of the kernels that was not compiled before.

    A call in the block of such a kernel waits for its process, and compiles the kernel itself if
    that has failed.  Parts that are seldom needed are begun by such a call.  The processes end with
    the block, or with this process, whose pipe to them is closed then.
    """
    from rakelight.cli.compiling import SELDOM, part_of

    missing: tuple[str, ...] = ()
    processes: dict[str, Popen[bytes]] = {}
    lock, stopped = Lock(), Event()
    with suppress(MachineError):  # the work itself may do without kernels
        missing = parts_to_compile()

    def begin(parts: Iterable[str]) -> None:
        for part in parts:
            # "-P": what lies in the current folder is no library.
            command = [sys.executable, "-P", "-m", "rakelight.cli.compiling", part, "--beside"]
            # Too few processes or too little memory: only time is lost.
            with suppress(OSError, MachineError):
                processes[part] = Popen(command, stdin=PIPE, stdout=DEVNULL, stderr=DEVNULL)

    def wait(kernel: jit.Kernel) -> None:
        part = part_of(kernel)
        if part in SELDOM:
            with lock:
                begin(each for each in SELDOM if each in missing and each not in processes)
        try:
            while part in processes and processes[part].poll() is None:
                if stopped.wait(POLL_S):
                    raise jit.StoppedError
        except KeyboardInterrupt:
            stopped.set()  # what else waits is to end, and not to compile
            raise

    try:
        begin(each for each in missing if each not in SELDOM)
        with jit.waiting_for_others(wait):
            yield
    finally:
        for each in processes.values():
            each.kill()
        for each in processes.values():
            each.communicate()


def parts_to_compile() -> tuple[str, ...]:
    """Names of the parts to compile beside this process; none where that is no gain."""
    from rakelight.cli.compiling import not_compiled

    if not sys.executable or jit.cores() < 2 or available_memory() < ENOUGH_MEMORY:
        return ()
    return not_compiled()
