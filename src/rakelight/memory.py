"""What the machine gives: what needs more is refused before it starts, not killed on the way."""

from __future__ import annotations

import ctypes
import sys
from contextlib import suppress
from math import inf
from pathlib import Path
from threading import Event, Thread

from rakelight.errors import MachineError

# Bytes that this process may hold: its share, where several work side by side (`limit_memory`).
_limit = inf


def limit_memory(most: float) -> None:
    """From now on at most so many bytes count as free for this process, its own included.

    >>> limit_memory(inf)
    """
    global _limit
    _limit = most


def require_memory(needed: float, *, source: str, remedy: str) -> None:
    """Raise MachineError where fewer than `needed` bytes are free.

    >>> require_memory(1e6, source="captures/mitten", remedy="close other programs")
    """
    free = free_memory()
    if needed > free:
        raise MachineError(
            "too little memory",
            source=source,
            seen=f"{free / 1e6:,.0f} MB free",
            needed=f"{needed / 1e6:,.0f} MB",
            remedy=remedy,
        )


def free_memory(root: Path = Path("/")) -> float:
    """Bytes that can be had without swapping; infinite where the system does not say.

    Linux says: of the machine, of the container (cgroup v2) that this runs in, and of this process
    (`free_addresses`, `limit_memory`).

    >>> free_memory(Path("no/such/folder"))
    inf
    """
    free = inf
    with suppress(OSError, KeyError, ValueError):
        free = 1024.0 * _table(root / "proc" / "meminfo")["MemAvailable:"]
    group = root / "sys" / "fs" / "cgroup"
    with suppress(OSError, KeyError, ValueError):  # "max" is no number: there is no limit
        limit, used = (int((group / f"memory.{name}").read_text()) for name in ("max", "current"))
        free = min(free, limit - used + _table(group / "memory.stat")["inactive_file"])
    with suppress(ImportError, OSError, ValueError):
        free = min(free, _limit - _of_this_process(root, 1))
    return max(min(free, free_addresses(root)), 0)


def free_addresses(root: Path = Path("/")) -> float:
    """Bytes of addresses that this process may still take under its limit (`ulimit -v`).

    Infinite where there is no limit, or no /proc to say what is taken.

    >>> free_addresses(Path("no/such/folder"))
    inf
    """
    with suppress(ImportError, OSError, ValueError):
        from resource import RLIM_INFINITY, RLIMIT_AS, getrlimit

        limit, _ = getrlimit(RLIMIT_AS)
        if limit != RLIM_INFINITY:
            return limit - _of_this_process(root, 0)
    return inf


def keep_freed_memory() -> None:
    """Let the next array have what the last one leaves, where the C library is glibc.

    Else it goes back to the system each time, which clears it anew.

    >>> keep_freed_memory()
    """
    if sys.platform != "linux":
        return
    try:
        set_option = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # another C library
        return
    trim_threshold, mmap_threshold = -1, -3
    set_option(trim_threshold, 1 << 30)
    set_option(mmap_threshold, 1 << 25)


def give_memory_back() -> None:
    """Give the system what is free again, where the C library is glibc.

    >>> give_memory_back()
    """
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).malloc_trim(0)


def _of_this_process(root: Path, column: int) -> int:
    """Bytes of addresses taken (column 0) or of memory held (1), as Linux counts them."""
    from resource import getpagesize

    pages = (root / "proc" / "self" / "statm").read_text().split()[column]
    return int(pages) * getpagesize()


def require_threads(count: int, *, source: str, remedy: str) -> None:
    """Raise MachineError where the system does not let this process start `count` more threads.

    >>> require_threads(2, source="the kernels", remedy="raise `ulimit -u`")
    """
    end, started = Event(), list[Thread]()
    try:
        for _ in range(count):
            thread = Thread(target=end.wait)
            thread.start()
            started.append(thread)
    except RuntimeError as error:  # "can't start new thread"
        raise MachineError(
            "the system starts no more threads",
            source=source,
            seen=str(len(started)),
            needed=str(count),
            remedy=remedy,
        ) from error
    finally:
        end.set()
        for thread in started:
            thread.join()


def _table(path: Path) -> dict[str, int]:
    lines = (line.split() for line in path.read_text().splitlines())
    return {name: int(value) for name, value, *_ in lines}
