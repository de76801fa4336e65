"""Folders that appear whole or not at all, and that replace nothing but what rakelight wrote.

A folder is ours when a file in it, its manifest, lists what rakelight wrote there.  With
`overwrite` such a folder is replaced if it holds nothing else, and its files are deleted by the
names in the list.  Everything else is refused.

Beside the folder NAME a run uses hidden names, `.NAME.rakelight-`, eight hexadecimal digits, then

- `.partial`: being written; a dead run's is deleted
- `.old`: whole, but not at its name; put back where NAME is missing
- `.replaced`: an older folder that is being deleted

and the lock `.NAME.rakelight.lock`, which names the `.partial` that is being written.  A dead run
leaves it behind: no other `.partial` is deleted, and no file in the lock's place that is none.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterator, Mapping, Set
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from tempfile import TemporaryFile

import msgspec

from rakelight.errors import InputError, MachineError, OutputExistsError, printable
from rakelight.files import clear_errors, write_bytes
from rakelight.memory import require_working_directory
from rakelight.model import Finding

FILE_LIST = "rakelight-files.json"
"""The manifest of folders that have no other: what rakelight wrote there."""

_FILE_LIST_SCHEMA = "rakelight-files/1"

# Bytes; a manifest with a hundred thousand names has a tenth of it.
_LARGEST_MANIFEST = 100_000_000

# First line of a lock; the names of folders that are being written follow, a line each.
_LOCK_HEADER = b"rakelight-lock/1\n"
_LARGEST_LOCK = 100_000  # bytes

# For renameat2: paths are relative to the working directory; exchange the two names.
_AT_FDCWD = -100
_RENAME_EXCHANGE = 2

# The folders whose locks `only_writer` holds here: in this thread, for whatever it calls.
_HELD: ContextVar[frozenset[Path]] = ContextVar("held", default=frozenset())


@dataclass(frozen=True)
class Manifest:
    """How folders of one kind are recognised: by a file in them that lists what rakelight wrote.

    kind : of folder, in words for messages
    name : of the file
    read : its bytes -> for each file in the folder, by its relative name with "/", the SHA-256 of
        the content in hexadecimal, or None where any content counts as ours; raises InputError
        when the bytes are not such a list
    write : such names and checksums -> the bytes; None where the folder's writer makes the file
    """

    kind: str
    name: str
    read: Callable[[bytes], Mapping[str, str | None]]
    write: Callable[[Mapping[str, str]], bytes] | None = None


class _FileList(msgspec.Struct, forbid_unknown_fields=True):
    """The content of rakelight-files.json."""

    schema: str
    kind: str
    files: dict[str, str]


def file_list(kind: str) -> Manifest:
    """The manifest rakelight-files.json, with checksums, for folders of this kind.

    >>> manifest = file_list("error maps")
    >>> manifest.read(manifest.write({"depth_error.png": "e3b0c442"}))
    {'depth_error.png': 'e3b0c442'}
    >>> file_list("capture").read(manifest.write({}))
    Traceback (most recent call last):
    rakelight.errors.InputError: rakelight-files.json: not the list of this kind of folder ...
    """

    def read(data: bytes) -> Mapping[str, str]:
        try:
            listed = msgspec.json.decode(data, type=_FileList)
        except (msgspec.MsgspecError, ValueError, RecursionError) as error:
            raise InputError("not a list of files", source=FILE_LIST, seen=str(error)) from error
        if (listed.schema, listed.kind) != (_FILE_LIST_SCHEMA, kind):
            raise InputError(
                "not the list of this kind of folder",
                source=FILE_LIST,
                seen=f"{listed.kind} ({listed.schema})",
                needed=f"{kind} ({_FILE_LIST_SCHEMA})",
            )
        return listed.files

    def write(checksums: Mapping[str, str]) -> bytes:
        listed = _FileList(_FILE_LIST_SCHEMA, kind, dict(sorted(checksums.items())))
        return msgspec.json.format(msgspec.json.encode(listed), indent=1) + b"\n"

    return Manifest(kind, FILE_LIST, read, write)


@dataclass
class Staging:
    """A folder while it is written: the `path` to write into.

    findings : once it stands at its name, what a person should know: warnings of older folders
        that could not be deleted
    """

    path: Path
    findings: tuple[Finding, ...] = ()


@contextmanager
def staged_folder(
    target: Path, *, manifest: Manifest, overwrite: bool = False
) -> Iterator[Staging]:
    """Build the folder `target` in a hidden sibling; it appears complete or not at all.

    Yields a `Staging` with the path of an empty folder to write into.  When the block ends, every
    file in it is flushed to the disk and the folder takes its name; when the block raises, it is
    removed and `target` is as it was.  What a killed run left behind is cleaned up by the next.

    manifest : by which the folder is known as ours later
    overwrite : replace an older folder, but only an empty one or one that holds nothing but what
        its manifest lists, so that somebody's own files are never deleted

    Raises OutputExistsError when something else stands there, MachineError when another run is
    writing the same folder, the disk is full or may not be written to.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as scratch:
    ...     with staged_folder(Path(scratch) / "out", manifest=file_list("notes")) as staging:
    ...         write_bytes(staging.path / "note.txt", b"well done")
    ...     print(sorted(path.name for path in (Path(scratch) / "out").iterdir()))
    ['note.txt', 'rakelight-files.json']
    """
    shown, target = str(target), _resolved(target)
    with clear_errors(shown, "cannot be written"):
        _refuse_occupied(target, shown, overwrite, manifest)
        target.parent.mkdir(parents=True, exist_ok=True)
        with _locked(target, shown) as locked:
            findings = _clean_up_after_dead_runs(target, manifest) if locked else ()
            # Once more: what a dead run had moved aside is back, another run may have finished.
            _refuse_occupied(target, shown, overwrite, manifest)
            staging = Staging(_sibling(target, "partial"))
            if locked:
                _note_in_lock(target, staging.path)
            staging.path.mkdir()
            try:
                yield staging
                _write_manifest(staging.path, manifest)
                _flush(staging.path)
                older = _move_into_place(staging.path, target)
            finally:
                shutil.rmtree(staging.path, ignore_errors=True)
            staging.findings = (*findings, *(_delete_older(older, manifest) if older else ()))


def require_free(target: Path, *, manifest: Manifest, overwrite: bool = False) -> None:
    """Raise what `staged_folder` would raise of `target`, before the work is done.

    That is OutputExistsError where something else stands, InputError for a path that cannot be
    one, MachineError where no folder can be made.  Nothing is left behind.
    """
    shown, target = str(target), _resolved(target)
    with clear_errors(shown, "cannot be written"):
        _refuse_occupied(target, shown, overwrite, manifest)
        with suppress(FileNotFoundError):
            _sibling(target, "partial").lstat()  # too long a name, a file among the parents
        with suppress(FileNotFoundError):
            os.close(_opened_lock(_lock_of(target)))
        with TemporaryFile(dir=next(parent for parent in target.parents if parent.exists())):
            pass


def put_back(folder: Path) -> Path:
    """The place to read `folder` from: itself, wherever it exists or nothing is known of it.

    A run that was killed while it replaced the folder may have left it under a hidden name.  Then
    it is given its own name again, or, where that cannot be done, read where it is.

    >>> put_back(Path("no/such/folder")).name
    'folder'
    """
    try:
        target = _resolved(folder)
        moved_aside = _moved_aside(target)
        if moved_aside is None:
            return folder
        with suppress(OSError, MachineError), _locked(target, str(folder)) as locked:
            if locked:
                _put_back(target)
        return folder if target.exists() else moved_aside
    except (OSError, InputError, MachineError):
        return folder


def remove_unfinished(target: Path, *, manifest: Manifest) -> None:
    """Put the folder `target` back, and delete what killed runs left unfinished beside it.

    What another run is writing, and what cannot be deleted, stays.

    >>> remove_unfinished(Path("no/such/folder"), manifest=file_list("notes"))
    """
    with suppress(OSError, InputError, MachineError):
        target = _resolved(target)
        if target.parent.is_dir():
            with _locked(target, str(target)) as locked:
                if locked:
                    _clean_up_after_dead_runs(target, manifest)


@contextmanager
def only_writer(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder that is written piece by piece, or after long work.

    `staged_folder` of the same folder needs no other one meanwhile.  Parents that were made for the
    lock and stay empty are removed.  Raises MachineError when another run holds it.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as scratch, only_writer(Path(scratch) / "out"):
    ...     with only_writer(Path(scratch) / "out"):
    ...         pass
    Traceback (most recent call last):
    rakelight.errors.MachineError: ...: another run is writing this folder. Fix: ...
    """
    target = _resolved(folder)
    with ExitStack() as stack:
        with clear_errors(str(folder), "cannot be written"):
            stack.enter_context(_parents(target))
            locked = stack.enter_context(_lock_taken(target, str(folder)))
        held = _HELD.set(_HELD.get() | {target}) if locked else None
        try:
            yield
        finally:
            if held is not None:
                _HELD.reset(held)


@contextmanager
def _parents(target: Path) -> Iterator[None]:
    """Make the folders that `target` is to lie in; those that stay empty are removed."""
    missing = [parent for parent in target.parents if not parent.exists()]
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield
    finally:
        for parent in missing:
            with suppress(OSError):
                parent.rmdir()


def _resolved(target: Path) -> Path:
    """`target` through symbolic links: the link stays and the folder behind it is replaced."""
    require_working_directory(target, needed="one that this path begins at")
    try:
        return Path(target).resolve()
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(
            "not a usable path",
            source=str(target),
            seen=str(error),
            remedy="choose another name",
        ) from error


def _refuse_occupied(target: Path, shown: str, overwrite: bool, manifest: Manifest) -> None:
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
            "the folder exists",
            source=shown,
            remedy="choose another name, or overwrite it: overwrite=True, or --overwrite",
        )
    if _somebody_lives_in(target):
        raise OutputExistsError(
            "your home or working directory is not overwritten",
            source=shown,
            remedy="work from outside of it, or choose another name",
        )
    if foreign := _first_foreign(target, _owned(target, manifest)):
        raise OutputExistsError(
            "what was not written by rakelight, or was changed since, is not overwritten",
            source=shown,
            seen=foreign,
            needed=f"a {manifest.kind} with nothing but what its {manifest.name} lists",
            remedy="move your files away, or choose another name",
        )


def _somebody_lives_in(folder: Path) -> bool:
    """Whether the home or the working directory is the folder or lies in it."""
    places = [Path(os.path.expanduser("~"))]  # noqa: PTH111 - Path.home() raises without one
    with suppress(OSError):  # the working directory was deleted
        places.append(Path.cwd())
    return any(place.is_relative_to(folder) for place in places)


def _owned(folder: Path, manifest: Manifest) -> Set[str]:
    """Relative names of the files that the manifest of `folder` lists, itself among them.

    Without what was changed since, and without names that lead out of the folder; none where the
    manifest is missing or not one of ours.  Files that are listed may be missing.
    """
    path = folder / manifest.name
    if not _is_file(path) or path.stat().st_size > _LARGEST_MANIFEST:
        return frozenset()
    try:
        listed = manifest.read(path.read_bytes())
    except (InputError, RecursionError):  # nested a thousand deep
        return frozenset()
    unchanged = {
        name
        for name, checksum in listed.items()
        if _leads_inside(name)
        and (checksum is None or not _is_file(folder / name) or sha256(folder / name) == checksum)
    }
    return unchanged | {manifest.name}


def _is_file(path: Path) -> bool:
    """Whether a regular file stands at `path` itself, not behind a link."""
    return path.is_file() and not path.is_symlink()


def _leads_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return bool(path.parts) and ".." not in path.parts and not PureWindowsPath(name).anchor


def sha256(path: Path) -> str:
    """Of a file's content, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _folders_of(names: Set[str]) -> Set[str]:
    """The folders that files of these relative names lie in, without the outermost."""
    return {str(parent) for name in names for parent in PurePosixPath(name).parents} - {"."}


def _first_foreign(folder: Path, owned: Set[str]) -> str:
    """The first thing in `folder` that is neither one of these files nor a folder of theirs.

    Links count as foreign and are not followed.  An empty string where there is none.
    """
    ours = _folders_of(owned)
    waiting = [""]
    while waiting:
        inside = waiting.pop()
        with os.scandir(folder / inside) as entries:
            for entry in sorted(entries, key=lambda entry: entry.name):
                name = inside + entry.name
                if entry.is_dir(follow_symlinks=False):
                    if name not in ours:
                        return f"{name}/"
                    waiting.append(f"{name}/")
                elif name not in owned or not entry.is_file(follow_symlinks=False):
                    return name
    return ""


def _sibling(target: Path, suffix: str) -> Path:
    return target.with_name(f".{target.name}.rakelight-{secrets.token_hex(4)}.{suffix}")


def _siblings(target: Path, suffix: str) -> list[Path]:
    """What runs left beside `target` under the names of `_sibling`, the latest first."""
    name = re.compile(re.escape(f".{target.name}.rakelight-") + "[0-9a-f]{8}" + re.escape(suffix))
    found = [path for path in target.parent.iterdir() if name.fullmatch(path.name)]
    return sorted(found, key=lambda path: path.lstat().st_mtime_ns, reverse=True)


@contextmanager
def _locked(target: Path, shown: str) -> Iterator[bool]:
    """Hold the lock of `target`, or have `only_writer` hold it; False where there are no locks."""
    if target in _HELD.get():
        yield True
        return
    with _lock_taken(target, shown) as locked:
        yield locked


@contextmanager
def _lock_taken(target: Path, shown: str) -> Iterator[bool]:
    """Hold the lock of `target`; yields False where the system offers none."""
    try:
        import fcntl
    except ImportError:  # Windows
        yield False
        return
    lock = _lock_of(target)
    descriptor = -1
    try:
        while True:
            descriptor = _opened_lock(lock, os.O_CREAT)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise MachineError(
                    "another run is writing this folder",
                    source=shown,
                    remedy="wait for it, or choose another name",
                ) from error
            except OSError:  # a file system without locks
                lock.unlink(missing_ok=True)
                yield False
                return
            if _is_still(lock, descriptor):
                break
            os.close(descriptor)  # the run before removed the file between our open and our lock
            descriptor = -1
        yield True
    finally:  # after an interrupt at any moment, too
        if descriptor >= 0:
            with suppress(OSError):  # another run's
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if _is_still(lock, descriptor) and not _unfinished(target, descriptor):
                    lock.unlink(missing_ok=True)
            os.close(descriptor)


def _lock_of(target: Path) -> Path:
    return target.with_name(f".{target.name}.rakelight.lock")


def _opened_lock(lock: Path, flags: int = 0) -> int:
    """A descriptor of the lock; OutputExistsError where something of somebody else's is there."""
    # A link is not followed, and a pipe does not keep us waiting.
    flags |= sum(getattr(os, name, 0) for name in ("O_CLOEXEC", "O_NOFOLLOW", "O_NONBLOCK"))
    seen = ""
    try:
        descriptor = os.open(lock, os.O_RDWR | flags, 0o666)
    except OSError as error:
        if error.errno not in (errno.EISDIR, errno.ELOOP, errno.ENXIO):
            raise
        seen = "a folder" if error.errno == errno.EISDIR else "a link or a socket"
    else:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            seen = "no regular file"
        elif _names_in(descriptor) is None:
            seen = "other content"
        if not seen:
            return descriptor
        os.close(descriptor)
    raise OutputExistsError(
        "something stands where the lock of the folder is to be",
        source=str(lock),
        seen=seen,
        needed="nothing, or the lock of an earlier run",
        remedy="move it away, or choose another name for the folder",
    )


def _names_in(descriptor: int) -> list[str] | None:
    """The names of folders being written that stand in a lock; None where it is no lock of ours.

    An empty one is: its run has not begun to write.
    """
    os.lseek(descriptor, 0, os.SEEK_SET)
    content = os.read(descriptor, _LARGEST_LOCK)
    if not content.startswith(_LOCK_HEADER):
        return None if content else []
    return os.fsdecode(content.removeprefix(_LOCK_HEADER)).splitlines()


def _unfinished(target: Path, descriptor: int) -> list[Path]:
    """The folders beside `target` that by its lock are ours, and not finished."""
    names = _names_in(descriptor) or []
    return [path for path in _siblings(target, ".partial") if path.name in names]


def _noted_in_lock(target: Path) -> list[Path]:
    """`_unfinished` by the lock of `target`, which is held."""
    descriptor = _opened_lock(_lock_of(target))
    try:
        return _unfinished(target, descriptor)
    finally:
        os.close(descriptor)


def _note_in_lock(target: Path, folder: Path) -> None:
    """Write into the lock of `target`, which is held, that `folder`, too, is ours."""
    descriptor = _opened_lock(_lock_of(target))
    try:
        names = [path.name for path in (*_unfinished(target, descriptor), folder)]
        text = _LOCK_HEADER + os.fsencode("".join(f"{name}\n" for name in names))
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, text, 0)
    finally:
        os.close(descriptor)


def _is_still(path: Path, descriptor: int) -> bool:
    """Whether `path` names the file that `descriptor` has open."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _clean_up_after_dead_runs(target: Path, manifest: Manifest) -> tuple[Finding, ...]:
    """Put back or delete what killed runs left; their locks died with them, ours is held.

    Returns a warning for each that cannot be deleted.
    """
    _put_back(target)
    findings: list[Finding] = []
    ours = _noted_in_lock(target)
    for path in _siblings(target, ".partial"):
        why = "" if path in ours else "nothing says that rakelight wrote it"
        try:
            if not why:
                shutil.rmtree(path)
        except OSError as error:
            why = error.strerror or str(error)
        if why:
            findings.append(_not_deleted(path, why))
    for path in _siblings(target, ".old") + _siblings(target, ".replaced"):
        findings += _delete_older(path, manifest)
    return tuple(findings)


def _moved_aside(target: Path) -> Path | None:
    """The whole folder that a killed run left under a hidden name, where `target` is missing."""
    if target.exists():
        return None
    return next(iter(_siblings(target, ".old")), None)


def _put_back(target: Path) -> None:
    moved_aside = _moved_aside(target)
    if moved_aside is not None:
        moved_aside.rename(target)


def _delete_older(older: Path, manifest: Manifest) -> tuple[Finding, ...]:
    """Delete a folder that was replaced, by the names in its manifest, which goes last.

    Returns a warning where it has to stay: something foreign lies in it, which may have come
    after the folder was looked at, or the system refuses.
    """
    doomed = older.with_suffix(".replaced")
    try:
        older.rename(doomed)
        owned = _owned(doomed, manifest)
        why = _first_foreign(doomed, owned)
        if not why:
            for name in owned - {manifest.name}:
                (doomed / name).unlink(missing_ok=True)
            for name in sorted(_folders_of(owned), reverse=True):  # the innermost first
                with suppress(FileNotFoundError):
                    (doomed / name).rmdir()
            (doomed / manifest.name).unlink(missing_ok=True)
            doomed.rmdir()
            return ()
    except OSError as error:
        why = error.strerror or str(error)
    return (_not_deleted(doomed if doomed.exists() else older, why),)


def _not_deleted(path: Path, why: str) -> Finding:
    return Finding(
        "warning",
        "older-not-deleted",
        f"{printable(str(path))}: this folder of an earlier run could not be deleted (seen {why})",
        "move away what you need of it and delete it; the next run tries it again",
    )


def _write_manifest(staging: Path, manifest: Manifest) -> None:
    if manifest.write is None:
        return
    files = sorted(path for path in staging.rglob("*") if path.is_file())
    checksums = {path.relative_to(staging).as_posix(): sha256(path) for path in files}
    write_bytes(staging / manifest.name, manifest.write(checksums))


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


def _move_into_place(staging: Path, target: Path) -> Path | None:
    """Rename `staging` to `target`; returns the older folder, under a hidden name."""
    if not target.exists():
        staging.rename(target)
        _flush_folder(target.parent)
        return None
    whole = staging.with_suffix(".old")
    staging.rename(whole)
    older = whole if _exchange(whole, target) else _rename_twice(staging, whole, target)
    _flush_folder(target.parent)
    return older


def _exchange(first: Path, second: Path) -> bool:
    """Exchange two names in one step; False where the system cannot, and nothing has changed."""
    if sys.platform != "linux":
        return False
    try:
        renameat2 = ctypes.CDLL(None).renameat2
    except (OSError, AttributeError):  # another C library, or one from before 2018
        return False
    names = os.fsencode(first), os.fsencode(second)
    failed = renameat2(_AT_FDCWD, names[0], _AT_FDCWD, names[1], _RENAME_EXCHANGE)
    return not failed


def _rename_twice(staging: Path, whole: Path, target: Path) -> Path:
    """Move `target` aside and `whole` to its name; killed in between, `put_back` finds both."""
    older = _sibling(target, "old")
    try:
        target.rename(older)
        whole.rename(target)
    except BaseException:
        if not target.exists():
            older.rename(target)
        if whole.exists():
            whole.rename(staging)
        raise
    return older
