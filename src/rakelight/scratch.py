"""Large arrays: in memory or, where they would take much of it, in a file on disk without a name.

Such a file is gone when its last array is, or the process, however that ends.
"""

from __future__ import annotations

import mmap
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from rakelight.errors import MachineError
from rakelight.files import clear_errors
from rakelight.memory import available_memory, free_addresses, require_memory
from rakelight.model import Array

# Share of the memory that may be had, beyond which an array goes to disk: the rest is for the work.
LARGEST_SHARE = 0.25


def large_empty(shape: tuple[int, ...], dtype: Any, source: str, remedy: str) -> Array:
    """An array to fill, in memory, or on disk where it takes more than a quarter of what is free.

    source, remedy : for the message of the MachineError where neither has room

    >>> large_empty((2, 3), "uint8", "photographs", "use fewer images").shape
    (2, 3)
    """
    needed = float(np.prod(shape, dtype=float)) * np.dtype(dtype).itemsize
    if needed > LARGEST_SHARE * available_memory():
        return mapped(shape, dtype, source, remedy)
    require_memory(needed, source=source, remedy=remedy)
    try:
        return np.empty(shape, dtype)
    except MemoryError as error:
        raise MachineError(
            "too little memory for the images",
            source=source,
            needed=f"{needed / 1e9:.1f} GB",
            remedy=remedy,
        ) from error


def mapped(shape: tuple[int, ...], dtype: Any, source: str, remedy: str) -> Array:
    """An array of zeros in a nameless file of `scratch_folder`, which the system pages in and out.

    Raises MachineError where the disk has no room for it.
    """
    needed, folder = int(np.prod(shape, dtype=float)) * np.dtype(dtype).itemsize, scratch_folder()
    if free_addresses() < needed:  # they are needed for what lies on disk, too
        require_memory(needed, source=source, remedy=remedy)
    with clear_errors(str(folder), "cannot be written", needed=f"{needed} bytes"):
        free = shutil.disk_usage(folder).free
        if free < needed:
            raise MachineError(
                f"no room on disk for {source}",
                source=str(folder),
                seen=f"{free / 1e6:,.0f} MB free",
                needed=f"{needed / 1e6:,.0f} MB",
                remedy=f"set TMPDIR to a folder with more, or {remedy}",
            )
        with tempfile.TemporaryFile(dir=folder) as file:
            if hasattr(os, "posix_fallocate"):  # a disk that fills up later would end the process
                os.posix_fallocate(file.fileno(), 0, needed)
            else:
                file.truncate(needed)
            memory = mmap.mmap(file.fileno(), needed)
    return np.frombuffer(memory, dtype).reshape(shape)


def scratch_folder() -> Path:
    """Where large arrays lie on disk: TMPDIR, else /var/tmp, since /tmp is memory on many systems.

    >>> scratch_folder().is_dir()
    True
    """
    usual, disk = Path(tempfile.gettempdir()), Path("/var/tmp")
    named = any(os.environ.get(name) for name in ("TMPDIR", "TEMP", "TMP"))
    return disk if not named and os.access(disk, os.W_OK) and disk.is_dir() else usual


def release(array: Array) -> None:
    """Let go of the memory that holds pages of an array on disk; its values stay.

    Nothing is done to an array in memory.

    >>> release(np.zeros(3))
    """
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    base = base.obj if isinstance(base, memoryview) else base
    if isinstance(base, mmap.mmap) and hasattr(base, "madvise"):
        base.madvise(mmap.MADV_DONTNEED)
