"""Files and folders that are read whole and written whole, with clear errors."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import TypeVar

from rakelight.errors import InputError, MachineError, OutputExistsError

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
    ("cannot be written", errno.ENOSPC): "free some space, or choose another disk",
    ("cannot be written", errno.EDQUOT): "free some space, or choose another disk",
    ("cannot be written", errno.EACCES): "choose a folder that you may write to",
    ("cannot be written", errno.EPERM): "choose a folder that you may write to",
    ("cannot be written", errno.EROFS): "choose a folder that you may write to",
    ("cannot be written", errno.ENOTDIR): "choose another place: one of its folders is a file",
    ("cannot be written", errno.ENAMETOOLONG): "choose a shorter name",
}


def in_threads(function: Callable[[S], T], items: Iterable[S]) -> list[T]:
    """[function(item) for item in items], a few at a time; the first error is raised."""
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(function, items))


def read_bytes(path: Path, *, source: str = "", max_bytes: int = MAX_BYTES) -> bytes:
    """The content of a file; `source` names it in messages (default: the path).

    Raises InputError when there is no such file, it is larger than `max_bytes`, or is a folder, a
    pipe, a device, a socket; MachineError when it cannot be read.
    """
    source = source or str(path)
    with clear_errors(source, "cannot be read"):
        _require_regular(path.stat().st_mode, source)
    # A pipe put there since then does not keep us waiting.
    with clear_errors(source, "cannot be read"), open(path, "rb", opener=_open_at_once) as file:
        size = os.fstat(file.fileno()).st_size
        if size > max_bytes:
            raise InputError(
                "file too large",
                source=source,
                seen=_megabytes(size),
                needed=f"at most {_megabytes(max_bytes)}",
            )
        return file.read()


def _require_regular(mode: int, source: str) -> None:
    if not stat.S_ISREG(mode):
        kinds = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket"}
        seen = kinds.get(stat.S_IFMT(mode), "a device")
        raise InputError("cannot be read", source=source, seen=seen, needed="a file")


def _open_at_once(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def write_bytes(path: Path, data: bytes) -> None:
    """Write `data` to `path`; a file that could not be written whole is removed.

    Raises MachineError with the system's words and the bytes needed when the disk is full or may
    not be written to, InputError when the path cannot be one.
    """
    with clear_errors(str(path), "cannot be written", needed=f"{len(data)} bytes"):
        try:
            path.write_bytes(data)
        except OSError:
            path.unlink(missing_ok=True)
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


@contextmanager
def staged_folder(
    target: Path, *, overwrite: bool = False, marker: str = "result.json"
) -> Iterator[Path]:
    """Build the folder `target` in a hidden sibling; it appears complete or not at all.

    Yields the path of an empty staging folder to write into.  When the block ends, every file in
    it is flushed to the disk and the folder takes its name; when the block raises, it is removed
    and `target` is as it was.  What a killed run left behind is cleaned up by the next one.

    overwrite : replace an older folder, but only an empty one or one that holds the file
        `marker`, so that somebody's own files are never deleted

    Raises OutputExistsError when something else stands there, MachineError when another run is
    writing the same folder, the disk is full or may not be written to.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as scratch:
    ...     with staged_folder(Path(scratch) / "out") as staging:
    ...         write_bytes(staging / "result.json", b"{}")
    ...     print([path.name for path in Path(scratch).iterdir()])
    ['out']
    """
    shown, target = str(target), _resolved(target)
    with clear_errors(shown, "cannot be written"):
        _refuse_occupied(target, shown, overwrite, marker)
        target.parent.mkdir(parents=True, exist_ok=True)
        with _locked(target, shown) as locked:
            if locked:
                _clean_up_after_dead_runs(target)
            # Once more: what a dead run had moved aside is back, another run may have finished.
            _refuse_occupied(target, shown, overwrite, marker)
            staging = _sibling(target, "partial")
            staging.mkdir()
            try:
                yield staging
                _flush(staging)
                _move_into_place(staging, target)
            finally:
                shutil.rmtree(staging, ignore_errors=True)


def require_free(target: Path, *, overwrite: bool, marker: str) -> None:
    """Raise what `staged_folder` would raise of `target`, before the work is done.

    That is OutputExistsError where something else stands, InputError for a path that cannot be
    one, MachineError where no folder can be made.  Nothing is left behind.
    """
    shown, target = str(target), _resolved(target)
    with clear_errors(shown, "cannot be written"):
        _refuse_occupied(target, shown, overwrite, marker)
        with suppress(FileNotFoundError):
            _sibling(target, "partial").lstat()  # too long a name, a file among the parents
        with TemporaryFile(dir=next(parent for parent in target.parents if parent.exists())):
            pass


def _resolved(target: Path) -> Path:
    """`target` through symbolic links: the link stays and the folder behind it is replaced."""
    try:
        return Path(target).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(
            "not a usable path",
            source=str(target),
            seen=str(error),
            remedy="choose another name",
        ) from error


def _refuse_occupied(target: Path, shown: str, overwrite: bool, marker: str) -> None:
    """Raise OutputExistsError unless `target` is free or may be replaced."""
    if not os.path.lexists(target):
        return
    if not target.is_dir():
        raise OutputExistsError(
            "a file stands where the folder is to be written",
            source=shown,
            remedy="choose another name",
        )
    if not overwrite:
        raise OutputExistsError(
            "the folder exists", source=shown, remedy="choose another name, or --overwrite"
        )
    replaceable = (target / marker).is_file() or not any(target.iterdir())
    if not replaceable or _somebody_lives_in(target):
        raise OutputExistsError(
            "this folder was not written by rakelight and is not overwritten",
            source=shown,
            needed=f"a folder with {marker}, outside of which you work",
            remedy="choose another name",
        )


def _somebody_lives_in(folder: Path) -> bool:
    """Whether the home or the working directory is the folder or lies in it."""
    return any(place.is_relative_to(folder) for place in (Path.cwd(), Path.home()))


def _sibling(target: Path, suffix: str) -> Path:
    return target.with_name(f".{target.name}.rakelight-{secrets.token_hex(4)}.{suffix}")


@contextmanager
def _locked(target: Path, shown: str) -> Iterator[bool]:
    """Hold the lock of `target`; yields False where the system offers none."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield False
        return
    lock = target.with_name(f".{target.name}.rakelight.lock")
    while True:
        descriptor = os.open(lock, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(descriptor)
            raise MachineError(
                "another run is writing this folder",
                source=shown,
                remedy="wait for it, or choose another name",
            ) from error
        except OSError:  # a file system without locks
            os.close(descriptor)
            lock.unlink(missing_ok=True)
            yield False
            return
        if _is_still(lock, descriptor):
            break
        os.close(descriptor)  # the run before removed the file between our open and our lock
    try:
        yield True
    finally:
        lock.unlink(missing_ok=True)
        os.close(descriptor)


def _is_still(path: Path, descriptor: int) -> bool:
    """Whether `path` names the file that `descriptor` has open."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _clean_up_after_dead_runs(target: Path) -> None:
    """Remove what killed runs left; their locks died with them, ours is held."""
    start = f".{target.name}.rakelight-"
    for path in list(target.parent.iterdir()):
        if not path.name.startswith(start):
            continue
        if path.suffix == ".old" and not target.exists():
            path.rename(target)  # killed between the two renames: the older result is whole
        elif path.suffix in (".partial", ".old"):
            shutil.rmtree(path, ignore_errors=True)


def _flush(folder: Path) -> None:
    """Bring every file below `folder`, and the folders, from the cache to the disk."""
    for parent, _, names in os.walk(folder):
        for name in names:
            with (Path(parent) / name).open("rb+") as file:
                os.fsync(file.fileno())
        _flush_folder(Path(parent))


def _flush_folder(folder: Path) -> None:
    if os.name == "posix":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _move_into_place(staging: Path, target: Path) -> None:
    """Rename `staging` to `target`; an older folder goes only when the new one stands."""
    if not target.exists():
        staging.rename(target)
        _flush_folder(target.parent)
        return
    old = _sibling(target, "old")
    target.rename(old)
    try:
        staging.rename(target)
    except BaseException:
        old.rename(target)
        raise
    _flush_folder(target.parent)
    shutil.rmtree(old, ignore_errors=True)


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.0f} MB"
