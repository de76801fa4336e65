"""Libraries that only some sources need: imported when used, named when missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rakelight.errors import InputError


def needs(library: str, extra: str, source: str) -> Any:
    """The module `library`; raises InputError that names the extra to install where it is missing.

    source : what is to be read with it, for the message

    >>> needs("json", "recordings", "rec.db3").__name__
    'json'
    >>> needs("no_such_library", "recordings", "rec.db3")
    Traceback (most recent call last):
    rakelight.errors.InputError: rec.db3: a library that reads it is missing (needed
    no_such_library). Fix: pip install "rakelight[recordings]"
    """
    try:
        return import_module(library)
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != library.split(".")[0]:
            raise
        raise InputError(
            "a library that reads it is missing",
            source=source,
            needed=library,
            remedy=f'pip install "rakelight[{extra}]"',
        ) from error
