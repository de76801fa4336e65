"""rakelight's own capture folder: capture.toml, rgb/, depth/, mask.png."""

from __future__ import annotations

import os
from pathlib import Path

from rakelight.capture.config import CONFIG, misnamed_config
from rakelight.capture.folder import read_folder
from rakelight.capture.readers.base import Reader, Reading, Wanted


def sniff(path: Path) -> bool:
    """Whether the folder holds a capture.toml, or one under another name, which is refused."""
    if os.path.lexists(path / CONFIG):
        return True
    return path.is_dir() and misnamed_config(path) is not None


def read(path: Path, wanted: Wanted) -> Reading:
    """The capture of the folder."""
    return Reading(read_folder(path, wanted.photographs))


READER = Reader("rakelight", "a capture folder: capture.toml, rgb/, depth/, mask.png", sniff, read)
