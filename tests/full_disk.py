"""A disk that is full as soon as files of some names are half written."""

import errno
import os
from pathlib import Path


class HalfWritten:
    """A file that takes half of what is written to it first, and no more."""

    def __init__(self, file, path):
        self.file, self.path = file, path

    def write(self, data):
        self.file.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self.path))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.file.close()


def full_at(monkeypatch, is_full):
    """Make the disk full for what is written at paths of which `is_full` is true."""
    opened = Path.open

    def half_opened(path, mode="r", *rest, **named):
        file = opened(path, mode, *rest, **named)
        return HalfWritten(file, path) if "w" in mode and is_full(path) else file

    monkeypatch.setattr(Path, "open", half_opened)
