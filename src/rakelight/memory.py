"""What the machine gives: what needs more is refused before it starts, not killed on the way."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from math import inf
from pathlib import Path
from threading import Event, Thread

from rakelight.errors import MachineError

_limit: ContextVar[float] = ContextVar("limit of memory", default=inf)


@contextmanager
def limited_memory(limit: float | None) -> Iterator[None]:
    """What runs inside keeps to `limit` bytes for the whole process, beside what the system says.

    None for no limit beside those that hold already.

    >>> with limited_memory(1e6):
    ...     available_memory()
    0.0
    """
    token = _limit.set(_limit.get() if limit is None else limit)
    try:
        yield
    finally:
        _limit.reset(token)


def available_memory() -> float:
    """Bytes that may still be taken: free ones, and within the limit of `limited_memory`."""
    free, limit = free_memory(), _limit.get()
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

    >>> require_memory(1e6, source="captures/mitten", remedy="close other programs")
    """
    free = available_memory()
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
        from resource import RLIM_INFINITY, RLIMIT_AS, getpagesize, getrlimit

        limit, _ = getrlimit(RLIMIT_AS)
        if limit != RLIM_INFINITY:
            pages = int((root / "proc" / "self" / "statm").read_text().split()[0])
            return limit - pages * getpagesize()
    return inf


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
