"""What the machine gives: what needs more is refused before it starts, not killed on the way."""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from math import inf
from numbers import Real
from pathlib import Path
from threading import Event, Thread

from rakelight.errors import InputError, MachineError

# Bytes that a part of the program keeps to.
_limit: ContextVar[float] = ContextVar("limit of memory", default=inf)
# Bytes that this process may hold: its share, where several work side by side (`limit_memory`).
_share = inf
_LONGEST_BITS = 1024  # of a whole number that a float holds


def limit_memory(most: float) -> None:
    """From now on this process keeps to so many bytes, what it holds already included.

    >>> limit_memory(inf)
    """
    global _share
    _share = most


@contextmanager
def limited_memory(limit: float | None) -> Iterator[None]:
    """What runs inside keeps to `limit` bytes for the whole process, beside what the system says.

    None for no limit beside those that hold already.  Raises InputError for what is no limit.

    >>> with limited_memory(1e6):
    ...     available_memory()
    0.0
    """
    if limit is not None and not _is_limit(limit):
        raise InputError(
            "not a limit of memory",
            source="memory",
            seen=f"a number of {limit.bit_length()} bits"
            if isinstance(limit, int) and limit.bit_length() > _LONGEST_BITS
            else str(limit)[:80],
            needed="bytes, above 0",
            remedy="4e9 for 4 GB, or leave it away",
        )
    token = _limit.set(_limit.get() if limit is None else limit)
    try:
        yield
    finally:
        _limit.reset(token)


def _is_limit(limit: object) -> bool:
    """Whether it is a number above 0 that a float holds, or infinity."""
    if not isinstance(limit, Real) or isinstance(limit, bool):
        return False
    try:
        return float(limit) > 0
    except OverflowError:
        return False


def available_memory() -> float:
    """Bytes that may still be taken: free ones, within `limited_memory` and `limit_memory`."""
    free, limit = free_memory(), min(_limit.get(), _share)
    return free if limit == inf else max(min(free, limit - own_memory()), 0.0)


def own_memory(root: Path = Path("/")) -> float:
    """Bytes that this process holds and that are in no file; 0 where the system does not say.

    >>> own_memory(Path("no/such/folder"))
    0.0
    """
    with suppress(OSError, KeyError, ValueError):
        lines = (root / "proc" / "self" / "status").read_text().splitlines()
        table = dict(line.split()[:2] for line in lines if line.startswith("Rss"))
        return 1024.0 * int(table["RssAnon:"])
    return 0.0


def require_memory(needed: float, *, source: str, remedy: str) -> None:
    """Raise MachineError where fewer than `needed` bytes may be taken.

    InputError where that is due to `limited_memory`, not to the machine.

    >>> require_memory(1e6, source="captures/mitten", remedy="close other programs")
    """
    free, limit, whole = available_memory(), _limit.get(), own_memory() + needed
    if free < needed <= free_memory() and limit <= whole:
        raise InputError(
            "the limit of memory is too small",
            source=source,
            seen=f"{limit / 1e6:,.0f} MB",
            needed=f"at least {whole / 1e6:,.0f} MB",
            remedy="raise it, or leave it away",
        )
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
    (`free_addresses`).

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
            return limit - _addresses_taken(root)
    return inf


def require_addresses(needed: float, *, source: str) -> None:
    """Raise MachineError where fewer than `needed` bytes of addresses may be taken.

    >>> require_addresses(1e6, source="compiling the kernels")
    """
    free = free_addresses()
    if free < needed:
        raise MachineError(
            "too few addresses for this process",
            source=source,
            seen=f"{free / 1e6:,.0f} MB free",
            needed=f"{needed / 1e6:,.0f} MB",
            remedy="raise the limit on virtual memory (`ulimit -v unlimited`)",
        )


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


def _addresses_taken(root: Path) -> int:
    """Bytes of addresses that this process has taken, as Linux counts them."""
    from resource import getpagesize

    return int((root / "proc" / "self" / "statm").read_text().split()[0]) * getpagesize()


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


def require_files(count: int, *, source: str, remedy: str) -> None:
    """Raise MachineError where the system does not let this process open `count` more files.

    >>> require_files(2, source="the workers", remedy="raise `ulimit -n`")
    """
    opened = list[int]()
    try:
        for _ in range(count):
            opened.append(os.open(os.devnull, os.O_RDONLY))
    except OSError as error:
        raise MachineError(
            "the system opens no more files",
            source=source,
            seen=str(len(opened)),
            needed=str(count),
            remedy=remedy,
        ) from error
    finally:
        for descriptor in opened:
            os.close(descriptor)


def require_working_directory(path: Path | str = "", *, needed: str) -> None:
    """Raise MachineError where the working directory was deleted, unless `path` is absolute.

    path : what is looked for from there, for the message; needed : what the directory is for

    >>> require_working_directory("captures/mitten", needed="one that the path begins at")
    """
    if Path(path).is_absolute():
        return
    try:
        Path.cwd()
    except OSError as error:
        raise MachineError(
            "the working directory is not there any more",
            source=str(path),
            seen=error.strerror or str(error),
            needed=needed,
            remedy="change to another one with `cd`",
        ) from error


def _table(path: Path) -> dict[str, int]:
    lines = (line.split() for line in path.read_text().splitlines())
    return {name: int(value) for name, value, *_ in lines}
