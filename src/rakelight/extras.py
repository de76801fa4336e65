"""Libraries that only some of the work needs: imported when used, named when missing."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rakelight.errors import MissingExtraError


def needs(library: str, extra: str, source: str) -> Any:
    """The module `library`; raises MissingExtraError where it is not installed.

    extra : of rakelight, which installs it
    source : what needs it, for the message: a file, an URL, a command

    >>> needs("json", "recordings", "rec.db3").__name__
    'json'
    >>> needs("no_such_library", "recordings", "rec.db3")
    Traceback (most recent call last):
    rakelight.errors.MissingExtraError: rec.db3: a library that it needs is not installed (needed
    no_such_library). Fix: pip install "rakelight[recordings]"
    """
    package = library.split(".")[0]
    try:
        import_module(package)
    except ModuleNotFoundError as error:
        if error.name != package:
            raise  # it is there, and lacks a library of its own
        raise MissingExtraError(
            "a library that it needs is not installed",
            source=source,
            needed=package,
            remedy=f'pip install "rakelight[{extra}]"',
        ) from error
    return import_module(library)
