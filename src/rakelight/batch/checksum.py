"""Of which input, options and version a result is: one checksum that tells."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from rakelight.errors import CaptureError
from rakelight.files import clear_errors, open_regular

# Bytes of a checksum: no two of 1e12 inputs share one by chance.
DIGEST_BYTES = 20
# Files of one capture; a dataset's folder of 100 lights and its truth has some hundred.
MOST_FILES = 100_000


def content_checksum(source: Path) -> str:
    """Hexadecimal; changes with any byte or name of a file, or of the files below a folder.

    Hidden files do not count: no reader reads them.  Links are followed, as readers do.  Raises
    CaptureError where there is nothing, or more than `MOST_FILES`, MachineError for what cannot be
    read.

    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as scratch:
    ...     file = Path(scratch) / "depth.png"
    ...     _ = file.write_bytes(b"1")
    ...     before = content_checksum(Path(scratch))
    ...     _ = file.write_bytes(b"2")
    ...     content_checksum(Path(scratch)) == before
    False
    """
    shown = str(source)
    with clear_errors(shown, "cannot be read"):
        if not os.path.lexists(source):
            raise CaptureError(
                "no such folder or file",
                source=shown,
                needed="a capture folder, a recording, or whatever `rakelight import --list` names",
            )
        if not source.is_dir():
            return _file_digest(source).hex()
        whole = hashlib.blake2b(digest_size=DIGEST_BYTES)
        for count, (name, path) in enumerate(_files_below(source)):
            if count == MOST_FILES:
                raise CaptureError(
                    "too many files for a capture",
                    source=shown,
                    needed=f"at most {MOST_FILES}",
                )
            whole.update(_framed(os.fsencode(name)) + _file_digest(path))
        return whole.hexdigest()


def combined(content: str, facts: Mapping[str, Any]) -> str:
    """The checksum of a job: of its input's checksum, and of all else that the result depends on.

    >>> combined("00", {"scale": 2}) == combined("00", {"scale": 1})
    False
    """
    text = json.dumps([content, facts], sort_keys=True).encode()
    return hashlib.blake2b(text, digest_size=DIGEST_BYTES).hexdigest()


def _files_below(folder: Path) -> Iterator[tuple[str, Path]]:
    """(relative name with "/", path) of what is not a folder, in an order that stays."""
    waiting, seen = [("", folder)], set[tuple[int, int]]()
    while waiting:
        inside, place = waiting.pop()
        status = place.stat()
        if (status.st_dev, status.st_ino) in seen:  # links in a circle
            continue
        seen.add((status.st_dev, status.st_ino))
        for path in sorted(place.iterdir(), reverse=True):
            if path.name.startswith("."):
                continue
            if path.is_dir():
                waiting.append((f"{inside}{path.name}/", path))
            else:
                yield inside + path.name, path


def _file_digest(path: Path) -> bytes:
    """Of its content; of its kind alone, where it has none that ends, as a pipe."""
    if not path.exists() or not stat.S_ISREG(path.stat().st_mode):
        return b"no regular file"
    with open_regular(path, str(path)) as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=DIGEST_BYTES)).digest()


def _framed(name: bytes) -> bytes:
    """A name with its length before it: no two lists of files are the same bytes."""
    return len(name).to_bytes(4, "big") + name
