"""Every kind of source that is read: one file each, with a value READER, found by content."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path

from rakelight.capture.readers.base import Reader, Reading, Wanted
from rakelight.errors import CaptureError

__all__ = ["Reader", "Reading", "Wanted", "find_reader", "readers"]

# The module of each reader.  The first that recognises a source reads it.
_MODULES = (
    "rakelight_folder",
    "realsense",
    "kinect_mkv",
    "record3d",
    "stray_scanner",
    "tum_rgbd",
    "open3d_recorder",
    "diligent",
    "rti",
    "srmeetsps",
    "photographs",
)


@cache
def readers() -> tuple[Reader, ...]:
    """Every reader, in the order in which they are tried.

    >>> readers()[0].name
    'rakelight'
    """
    names = (f"rakelight.capture.readers.{module}" for module in _MODULES)
    return tuple(import_module(name).READER for name in names)


def find_reader(source: Path) -> Reader:
    """The reader that recognises `source`: a file or a folder.

    A folder that none recognises is left to that of capture folders, which says what is missing.
    Raises CaptureError for a file that none recognises.

    >>> find_reader(Path("no/such/folder")).name
    'rakelight'
    """
    for reader in readers():
        with suppress(OSError, ValueError):  # an impossible path, or one we may not look at
            if reader.sniff(source):
                return reader
    if os.path.isfile(source):  # noqa: PTH113 - False for impossible paths, where Path raises
        raise CaptureError(
            "this kind of file is not read",
            source=str(source),
            needed="a capture folder or one of: " + ", ".join(r.name for r in readers()[1:]),
            remedy="`rakelight import --list` says what is read",
        )
    return readers()[0]
