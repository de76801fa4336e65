"""What no reader recognises: what it is, and what to name or to do instead."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from itertools import islice
from pathlib import Path

from rakelight.capture.config import CONFIG
from rakelight.capture.headers import what_it_is
from rakelight.capture.listing import TO_PNG, UNREAD
from rakelight.capture.loose_files import (
    RESULT,
    folder_of_captures,
    images_in,
    kind_of,
    list_loose_files,
)
from rakelight.capture.matfile import AS_VERSION_7
from rakelight.capture.readers.r3d_archive import EXPORT_AGAIN
from rakelight.errors import CaptureError, InputError, listed, printable
from rakelight.files import clear_errors

NEEDED = "a folder with photographs and depth, or a recording (.db3, .mcap, .bag, .mkv, .r3d, .mat)"
_LIST = "`rakelight import --list` says what is read"
_FOLDER = "name the folder that it lies in"
_DEPTH_BESIDE = "name a recording that holds depth, too, or a folder of photographs and their depth"
# Files that are a part of what is read.
_PARTS = (".toml", ".lp", ".txt", ".csv", ".json", ".yaml", ".yml", ".xml")
_REMEDIES = {
    "a ZIP archive": "unpack it, and name the folder",
    "a packed file": "unpack it, and name the folder",
    "HEIC or a video": _DEPTH_BESIDE,
    "a WebP or an AVI": _DEPTH_BESIDE,
}
_BY_ENDING = {
    ".mat": AS_VERSION_7,
    ".npz": "in Python: rakelight.Capture.from_arrays",
    ".r3d": EXPORT_AGAIN,
}
_Rule = tuple[tuple[str, ...], str, str]
# Endings of a folder's files, what it is then, and what to do, {} being the first of the files.
_BEFORE_IMAGES: tuple[_Rule, ...] = (
    (
        (".db3", ".mcap", ".bag", ".mkv", ".r3d"),
        "a folder that holds a recording",
        "name that itself: {}",
    ),
)
_AFTER_IMAGES: tuple[_Rule, ...] = (
    ((".mat",), "a folder that holds a .mat file", "name that itself: {}"),
    ((".mp4", ".mov", ".avi", ".webm", ".m4v"), "a video without depth", _DEPTH_BESIDE),
    ((".npy", ".npz"), "a folder of arrays", "in Python: rakelight.Capture.from_arrays"),
    (tuple(UNREAD), "images of a format that is not read", TO_PNG),
)
# Names of a folder's files that are looked at.
_MOST_NAMES = 2000
_MOST_FOLDERS = 20  # of these names, that are looked into


def refuse_unknown(source: Path) -> None:
    """Raise CaptureError for what no reader recognises, by what it is.

    Returns for a folder that looks like a capture folder: its reader says what is missing in it.
    MachineError where it may not be looked at.

    >>> refuse_unknown(Path("no/such/folder"))
    Traceback (most recent call last):
    rakelight.errors.CaptureError: no/such/folder: no such folder or file (needed a folder with ...
    """
    shown = str(source)
    try:
        with clear_errors(shown, "cannot be read"):
            mode = os.stat(source).st_mode  # noqa: PTH116 - for impossible paths, too
    except (InputError, ValueError) as error:
        link = os.path.islink(source)  # noqa: PTH114
        raise CaptureError(
            "no such folder or file" + (": a link to nothing" if link else ""),
            source=shown,
            needed=NEEDED,
            remedy="name what it should lead to" if link else "look for a mistyped name",
        ) from error
    if stat.S_ISDIR(mode):
        _refuse_folder(source)
    elif stat.S_ISREG(mode):
        raise _unread_file(source)
    else:
        raise CaptureError(
            "neither a folder nor a file",
            source=shown,
            seen="a device or a pipe",
            needed=NEEDED,
            remedy="name one of these",
        )


def _unread_file(source: Path) -> CaptureError:
    """The error of a file."""
    with clear_errors(str(source), "cannot be read"), source.open("rb") as file:
        start = file.read(64)
    seen, suffix = what_it_is(start), source.suffix.lower()
    remedy = _REMEDIES.get(seen, _LIST)
    if kind_of(start, suffix) is not None:
        seen, remedy = "one image", "name the folder that holds the photographs and their depth"
    elif suffix in _PARTS:
        remedy = _FOLDER
    remedy = _BY_ENDING.get(suffix, remedy)
    return CaptureError(
        "this kind of file is not read", source=str(source), seen=seen, needed=NEEDED, remedy=remedy
    )


def _refuse_folder(source: Path) -> None:
    """Raise CaptureError for a folder, unless it looks like a capture folder."""
    shown = str(source)
    with clear_errors(shown, "cannot be read"), os.scandir(source) as entries:
        names = sorted(islice((entry.name for entry in entries), _MOST_NAMES))
    names = [name for name in names if not name.startswith(".")]
    if {"rgb", "depth"} & set(names) or CONFIG in names:
        return
    if not names:
        raise CaptureError(
            "an empty folder", source=shown, needed=NEEDED, remedy="name the one that holds them"
        )
    if {"metadata", "rgbd"} <= set(names):
        raise CaptureError(
            "an .r3d that was unpacked",
            source=shown,
            seen="metadata and rgbd/",
            needed="the .r3d itself",
            remedy="name it, or pack them again: zip -r scan.r3d metadata rgbd",
        )
    if RESULT in names:
        raise CaptureError(
            "a result, not a capture", source=shown, seen=RESULT,
            remedy="name what it was refined from",
        )  # fmt: skip
    _refuse_by_content(source, names)
    raise CaptureError(
        "nothing in it that is read", source=shown, seen=listed(names), needed=NEEDED, remedy=_LIST
    )


def _refuse_by_content(source: Path, names: list[str]) -> None:
    """Raise CaptureError for a folder with these names, where one says what was meant."""
    _refuse_endings(source, names, _BEFORE_IMAGES)
    captures = [name for name in names if os.path.isfile(source / name / CONFIG)]  # noqa: PTH113
    if len(captures) > 1:
        raise folder_of_captures(source, captures)
    if captures:
        raise _around(source, names, captures[0])
    with clear_errors(str(source), "cannot be read"):
        if images_in(source):
            list_loose_files(source)  # says what of a folder of photographs is not there
    _refuse_endings(source, names, _AFTER_IMAGES)
    inner = [name for name in names[:_MOST_FOLDERS] if _is_read(source / name)]
    if len(inner) > 1:
        raise folder_of_captures(source, inner)
    if inner:
        raise _around(source, names, inner[0])
    results = [name for name in names if os.path.isfile(source / name / RESULT)]  # noqa: PTH113
    if results:
        raise CaptureError(
            "a folder of results, not a capture", source=str(source), seen=listed(results),
            remedy="name what they were refined from",
        )  # fmt: skip


def _around(source: Path, names: list[str], inner: str) -> CaptureError:
    """The error of a folder with these names, of which one is to be named itself."""
    return CaptureError(
        "a folder around the one that is read", source=str(source), seen=listed(names),
        remedy=f"name that itself: {source}/{printable(inner)}",
    )  # fmt: skip


def _is_read(folder: Path) -> bool:
    """Whether a reader recognises what is in a folder."""
    from rakelight.capture.readers import readers

    with suppress(OSError, ValueError):
        return folder.is_dir() and any(reader.sniff(folder) for reader in readers())
    return False


def _refuse_endings(source: Path, names: list[str], rules: tuple[_Rule, ...]) -> None:
    """Raise CaptureError where a name has one of the endings of a rule."""
    for endings, what, remedy in rules:
        found = [name for name in names if name.lower().endswith(endings)]
        if found:
            raise CaptureError(
                what,
                source=str(source),
                seen=listed(found),
                needed=NEEDED,
                remedy=remedy.format(f"{source}/{printable(found[0])}"),
            )
