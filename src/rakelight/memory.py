"""How much memory there is: what needs more is refused before it starts, not killed on the way."""

from __future__ import annotations

from contextlib import suppress
from math import inf
from pathlib import Path

from rakelight.errors import MachineError


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

    Linux says: of the machine, and of the container (cgroup v2) that this runs in.

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
    return max(free, 0)


def _table(path: Path) -> dict[str, int]:
    lines = (line.split() for line in path.read_text().splitlines())
    return {name: int(value) for name, value, *_ in lines}
