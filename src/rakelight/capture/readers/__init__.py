"""Every kind of source that is read: one file each, with a value READER, found by content."""

from __future__ import annotations

from contextlib import suppress
from functools import cache
from importlib import import_module
from pathlib import Path

from rakelight.capture.readers.base import Reader, Reading, Wanted

__all__ = ["Reader", "Reading", "Wanted", "find_reader", "readers"]

# The module of each reader.  The first that recognises a source reads it.
_MODULES = (
    "rakelight_folder",
    "realsense",
    "kinect_mkv",
    "record3d",
    "stray_scanner",
    "scanner_app",
    "polycam",
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

    A folder that looks like a capture folder is left to that reader, which says what is missing.
    Raises CaptureError, with what to name or to do instead, for all else that none recognises.

    >>> find_reader(Path("no/such/folder"))
    Traceback (most recent call last):
    rakelight.errors.CaptureError: no/such/folder: no such folder or file (needed ...
    """
    for reader in readers():
        with suppress(OSError, ValueError):  # an impossible path, or one we may not look at
            if reader.sniff(source):
                return reader
    from rakelight.capture.readers.unknown import refuse_unknown

    refuse_unknown(source)
    return readers()[0]
