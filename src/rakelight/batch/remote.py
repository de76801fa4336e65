"""Captures behind URLs, by fsspec: listed, and copied to this machine to be read."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath, PureWindowsPath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

from rakelight.errors import CaptureError, InputError, MachineError, MissingExtraError, printable
from rakelight.extras import needs
from rakelight.files import clear_errors

if TYPE_CHECKING:
    from rakelight.batch.plan import Job

_URL = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]+://")
# Archives are never extracted.
_ARCHIVES = frozenset({"zip", "tar", "libarchive", "7z"})
# Share of the free disk that a copy may take: the result has to be written, too.
_SHARE_OF_DISK = 0.8
_CHUNK_BYTES = 1 << 20


def is_url(text: str) -> bool:
    """Whether it begins as a URL does.

    >>> is_url("s3://bucket/mitten"), is_url("C:/captures/mitten"), is_url("captures/mitten")
    (True, False, False)
    """
    return _URL.match(text) is not None


def last_part(url: str) -> str:
    """The last part of a URL's path, or its host.

    >>> last_part("https://museum.example/captures/oven%20mitten/"), last_part("s3://coin")
    ('oven mitten', 'coin')
    """
    parts = urlsplit(url)
    return unquote(PurePosixPath(parts.path).name) or parts.netloc


def matching_urls(url: str) -> list[str]:
    """The URLs that a URL with wildcards matches, sorted.

    Raises InputError where there are none or such URLs are not read, MachineError for a place that
    does not answer.
    """
    with _fetching(url):
        system, path = _opened(url)
        found = sorted(system.unstrip_protocol(each) for each in system.glob(path))
    if not found:
        raise InputError("nothing matches", source=url, needed="a pattern of URLs of captures")
    return found


@contextmanager
def local_copy(job: Job) -> Iterator[Path]:
    """Where a job's capture can be read: at its place, or in a copy that is deleted after use.

    Raises CaptureError where a URL leads to nothing or to names that leave the folder,
    MachineError where it does not answer or there is too little room for it.
    """
    if not job.remote:
        yield Path(job.source)
        return
    from rakelight.batch.plan import clean_name

    with TemporaryDirectory(prefix="rakelight-", ignore_cleanup_errors=True) as scratch:
        copy = Path(scratch) / clean_name(job.source)
        with _fetching(job.source):
            _fetch(job.source, copy)
        yield copy


def _fetch(url: str, copy: Path) -> None:
    """Copy a file, or the files below a folder."""
    system, root = _opened(url)
    if system.isfile(root):
        sizes = {root: system.info(root).get("size")}
        names = {root: copy}
    else:
        found = system.find(root, detail=True)
        sizes = {path: info.get("size") for path, info in found.items()}
        names = {path: copy / _inside(path, root, url) for path in found}
    if not names:
        raise CaptureError(
            "nothing here", source=url, needed="a capture's folder, or a file that is one"
        )
    room = int(_SHARE_OF_DISK * shutil.disk_usage(copy.parent).free)
    _require_room(sum(size or 0 for size in sizes.values()), room, url)
    taken = 0
    for path, target in names.items():
        with clear_errors(str(target), "cannot be written"):
            target.parent.mkdir(parents=True, exist_ok=True)
        with system.open(path, "rb") as source, target.open("xb") as file:
            while chunk := source.read(_CHUNK_BYTES):
                taken += len(chunk)
                _require_room(taken, room, url)  # no server has to tell the truth
                file.write(chunk)


def _require_room(size: int, room: int, url: str) -> None:
    if size > room:
        raise MachineError(
            "too little room on the disk for a copy of it",
            source=url,
            seen=f"{room / 1e6:,.0f} MB",
            needed=f"{size / 1e6:,.0f} MB or more",
            remedy="free some space, or set TMPDIR to a folder of a larger disk",
        )


def _inside(path: str, root: str, url: str) -> str:
    """A file's name relative to its folder; raises CaptureError for one that leads out of it."""
    name = path.removeprefix(root.rstrip("/")).lstrip("/")
    parts = PurePosixPath(name).parts
    if not parts or ".." in parts or "\0" in name or "\\" in name or PureWindowsPath(name).anchor:
        raise CaptureError("a file that leads out of its folder", source=url, seen=printable(path))
    return name


def _opened(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    if "::" in url or url.split(":")[0].lower() in _ARCHIVES:
        raise InputError(
            "archives are not read", source=url, remedy="unpack it, and name the folder"
        )
    system, path = needs("fsspec.core", "batch", url).url_to_fs(url)
    return system, path


@contextmanager
def _fetching(url: str) -> Iterator[None]:
    """What libraries raise of a URL, as ours: they raise anything."""
    try:
        yield
    except (InputError, MachineError):
        raise
    except ImportError as error:
        seen = str(error)
        raise MissingExtraError(
            "a library for this URL is missing",
            source=url,
            seen=seen,
            remedy="install it with pip",
        ) from error
    except FileNotFoundError as error:
        raise CaptureError("nothing at this URL", source=url, seen=str(error)) from error
    except ValueError as error:  # an unknown protocol among others
        raise InputError("not a URL that can be read", source=url, seen=str(error)) from error
    except Exception as error:
        seen = f"{type(error).__name__}: {error}"
        raise MachineError("cannot be fetched", source=url, seen=seen) from error
