"""Files that are read whole and written whole, with clear errors."""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from rakelight.errors import InputError, MachineError

# Bytes of the largest file that is read.  A photograph of 100 megapixels and 16 bit takes 600 MB,
# and a text of ours some ten kilobytes.
MAX_BYTES = 1_000_000_000
MAX_TEXT_BYTES = 10_000_000

T = TypeVar("T")
S = TypeVar("S")

# What packs and unpacks images releases the interpreter; more threads only take more memory.
_THREADS = 2

# What the path is to blame for, rather than the machine.
_WRONG_PATH = {
    errno.ENOENT,
    errno.EEXIST,
    errno.ENOTDIR,
    errno.EISDIR,
    errno.ENAMETOOLONG,
    errno.EINVAL,
    errno.ELOOP,
}

_REMEDIES: dict[tuple[str, int | None], str] = {
    ("cannot be read", errno.ENOENT): "put it there, or look for a mistyped name",
    ("cannot be read", errno.EACCES): "allow yourself to read it, or copy it to where you may",
    ("cannot be read", errno.EPERM): "allow yourself to read it, or copy it to where you may",
    ("cannot be written", errno.ENOSPC): "free some space, or choose another disk",
    ("cannot be written", errno.EDQUOT): "free some space, or choose another disk",
    ("cannot be written", errno.EFBIG): "raise the limit on the size of files (`ulimit -f`), or "
    "choose a disk with another file system",
    ("cannot be written", errno.EACCES): "choose a folder that you may write to",
    ("cannot be written", errno.EPERM): "choose a folder that you may write to",
    ("cannot be written", errno.EROFS): "choose a folder that you may write to",
    ("cannot be written", errno.ENOENT): "make its folder, or look for a mistyped name",
    ("cannot be written", errno.ENOTDIR): "choose another place: one of its folders is a file",
    ("cannot be written", errno.EISDIR): "choose another name: a folder stands there",
    ("cannot be written", errno.ENAMETOOLONG): "choose a shorter name",
}


def in_threads(function: Callable[[S], T], items: Iterable[S]) -> list[T]:
    """[function(item) for item in items], a few at a time; the first error is raised."""
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(function, items))


def as_path(value: str | bytes | os.PathLike[Any], name: str) -> Path:
    """The path that the argument `name` holds; raises InputError where it is none.

    >>> as_path(None, "folder")
    Traceback (most recent call last):
    rakelight.errors.InputError: folder: this is no path (seen NoneType, needed str or pathlib.Path)
    """
    try:
        return Path(os.fsdecode(value))
    except TypeError as error:
        seen = type(value).__name__
        needed = "str or pathlib.Path"
        raise InputError("this is no path", source=name, seen=seen, needed=needed) from error


def read_bytes(path: Path, *, source: str = "", max_bytes: int = MAX_BYTES) -> bytes:
    """The content of a file; `source` names it in messages (default: the path).

    Raises InputError when there is no such file, it is larger than `max_bytes`, or is a folder, a
    pipe, a device, a socket; MachineError when it cannot be read.
    """
    source = source or str(path)
    with clear_errors(source, "cannot be read"), open_regular(path, source) as file:
        size = os.fstat(file.fileno()).st_size
        if size > max_bytes:
            raise InputError(
                "file too large",
                source=source,
                seen=_megabytes(size),
                needed=f"at most {_megabytes(max_bytes)}",
            )
        return file.read()


def open_regular(path: Path, source: str) -> FileIO:
    """The file, unbuffered; raises InputError for a folder, a pipe, a device, and OSError."""
    _require_regular(path.stat().st_mode, source)
    # A pipe put there since then does not keep us waiting.
    return FileIO(path, "rb", opener=_open_at_once)


def _require_regular(mode: int, source: str) -> None:
    if not stat.S_ISREG(mode):
        kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
        seen = kinds.get(stat.S_IFMT(mode), "a device")
        raise InputError("cannot be read", source=source, seen=seen, needed="a file")


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def write_bytes(path: Path, data: bytes, source: str = "") -> None:
    """Write `data` to `path`; a file that could not be written whole is removed.

    A file that could not be opened for writing stays as it is.

    source : its name in messages; the path when empty

    Raises MachineError with the system's words and the bytes needed when the disk is full or may
    not be written to, InputError when the path cannot be one.
    """
    needed = bytes_needed(len(data))
    source = source or str(path)
    with clear_errors(source, "cannot be written", needed=needed), _emptied(path) as file:
        file.write(data)


def bytes_needed(size: int, words: str = "") -> str:
    """A size for messages about a disk, after these words; empty where it says nothing.

    >>> bytes_needed(70), bytes_needed(0)
    ('70 bytes', '')
    """
    return f"{words}{size} bytes" if size else ""


def _remove(path: Path) -> None:
    """Delete a stump, if there is one; where the system refuses, what was refused before counts."""
    with suppress(OSError):
        path.unlink()


_PARTIAL_END = ".partial"


def replace_bytes(path: Path, data: bytes) -> None:
    """Write `data` to `path`, in the place of an older file, whole or not at all.

    What a killed run leaves is a file `.NAME.rakelight-XXXXXXXX.partial` beside it.  Raises as
    `write_bytes` does.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as scratch:
    ...     replace_bytes(Path(scratch) / "note.txt", b"1")
    ...     replace_bytes(Path(scratch) / "note.txt", b"2")
    ...     [path.read_bytes() for path in Path(scratch).iterdir()]
    [b'2']
    """
    partial = path.with_name(f"{_partial_start(path.name)}{secrets.token_hex(4)}{_PARTIAL_END}")
    try:
        write_bytes(partial, data, str(path))
        with clear_errors(str(path), "cannot be written"):
            with partial.open("rb+") as written:
                os.fsync(written.fileno())
            partial.replace(path)
    finally:
        _remove(partial)


def is_partial(found: str, name: str) -> bool:
    """Whether a file `found` is what a killed `replace_bytes` left of a file `name` beside it.

    >>> is_partial(".note.txt.rakelight-0a1b2c3d.partial", "note.txt")
    True
    """
    return found.startswith(_partial_start(name)) and found.endswith(_PARTIAL_END)


def _partial_start(name: str) -> str:
    return f".{name}.rakelight-"


def write_parts(path: Path, parts: Iterable[bytes]) -> None:
    """Write a file part by part, as `write_bytes` writes one."""
    size = 0
    try:
        with _emptied(path) as file:
            for part in parts:
                size += len(part)
                file.write(part)
    except OSError:
        needed = bytes_needed(size, "more than ")
        with clear_errors(str(path), "cannot be written", needed=needed):
            raise


@contextmanager
def _emptied(path: Path) -> Iterator[BinaryIO]:
    """The file, empty and open for writing; removed where writing fails, not where opening does."""
    file = path.open("wb")
    try:
        with file:
            yield file
    except OSError:
        _remove(path)
        raise


@contextmanager
def clear_errors(source: str, what: str, *, needed: str = "") -> Iterator[None]:
    """Turn the system's errors into ours: InputError for an impossible path, else MachineError.

    source : what the message is about; what, needed : as in RakelightError
    """
    try:
        yield
    except OSError as error:
        words, remedy = error.strerror or str(error), _REMEDIES.get((what, error.errno), "")
        if error.errno in _WRONG_PATH:
            raise InputError(what, source=source, seen=words, remedy=remedy) from error
        raise MachineError(what, source=source, seen=words, needed=needed, remedy=remedy) from error
    except MemoryError as error:
        raise MachineError(what, source=source, seen="too little memory") from error


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 10_000_000 else f"{size} bytes"
