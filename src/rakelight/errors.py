"""What can go wrong, as one tree.

    RakelightError            one clear line: what, seen, needed, remedy
    ├── InputError            the input or the call is wrong           exit code 2
    │   ├── CaptureError      a capture folder or one of its files
    │   ├── MethodError       a method that does not exist or does not fit the capture
    │   └── OutputExistsError a result stands where one is to be written
    └── MachineError          disk, memory, permission, a library      exit code 3
        └── MissingExtraError an optional package is not installed

The library raises these and nothing else for bad input; it never prints and never exits.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import repeat
from typing import Any

# How zlib, OpenCV and the loader of libraries say that memory is short.
_NO_MEMORY = re.compile("(?i)(insufficient|out of|cannot allocate) memory")
_LONGEST = 400  # characters of each part of a message; what a file holds may be any length


class RakelightError(Exception):
    """A failure that a person can act on.

    Parameters
    ----------
    what : what is wrong, without a full stop
    source : the file or argument it is about
    seen, needed : what was found and what would have been right
    remedy : what to do about it

    Examples
    --------
    >>> print(CaptureError("8-bit depth", source="depth/000.png", seen="uint8", needed="uint16",
    ...                    remedy="export the depth as 16-bit PNG"))
    depth/000.png: 8-bit depth (seen uint8, needed uint16). Fix: export the depth as 16-bit PNG
    """

    exit_code = 1

    def __init__(
        self,
        what: str,
        *,
        source: str = "",
        seen: str = "",
        needed: str = "",
        remedy: str = "",
    ) -> None:
        self.what, self.source, self.remedy = what, source, remedy
        # Callers show values of any type.
        self.seen, self.needed = str(seen), str(needed)
        super().__init__(what)

    def __str__(self) -> str:
        found = ", ".join(
            f"{word} {value}"
            for word, value in (("seen", cut(self.seen)), ("needed", cut(self.needed)))
            if value
        )
        line = f"{self.source}: " if self.source else ""
        line += cut(self.what)
        line += f" ({found})" if found else ""
        line += f". Fix: {cut(self.remedy)}" if self.remedy else ""
        return printable(line)


class InputError(RakelightError):
    """The input or the call is wrong."""

    exit_code = 2


class CaptureError(InputError):
    """A capture folder, or one of its files, is not what it has to be."""


class MethodError(InputError):
    """The method does not exist, or does not fit this capture."""


class OutputExistsError(InputError):
    """Something stands where the result is to be written."""


class MachineError(RakelightError):
    """The machine is at fault: disk, memory, permission, a library that is not installed."""

    exit_code = 3


class MissingExtraError(MachineError):
    """An optional package is needed and not installed."""


@contextmanager
def parsing(source: str, what: str, error: type[InputError] = InputError) -> Iterator[None]:
    """Turn whatever a parser raises about its input into one `error`, which says `what` is wrong.

    For calls of other people's parsers alone.  About damaged input they raise anything: ValueError
    for a number of 5,000 digits, RecursionError for nesting, KeyError, OverflowError.

    >>> with parsing("lights.json", "not the lights of a capture"):
    ...     float("1.2.3")
    Traceback (most recent call last):
    rakelight.errors.InputError: lights.json: not the lights of a capture (seen could not ...
    """
    try:
        yield
    except RakelightError:
        raise
    except MemoryError as cause:
        raise MachineError("too little memory to read it", source=source) from cause
    except Exception as cause:
        seen = "nested too deep" if isinstance(cause, RecursionError) else str(cause)
        remedy = "copy it, or write or export it again"
        seen = seen or type(cause).__name__
        raise error(what, source=source, seen=seen, remedy=remedy) from cause


@contextmanager
def named_in(source: str) -> Iterator[None]:
    """InputErrors about arrays name the file or folder, too, in which these were read.

    >>> with named_in("capture.mat"):
    ...     raise InputError("not 8 or 16 bit", source="photographs")
    Traceback (most recent call last):
    rakelight.errors.InputError: capture.mat: photographs: not 8 or 16 bit
    """
    try:
        yield
    except InputError as error:
        error.source = ": ".join(filter(None, (source, error.source)))
        raise


@contextmanager
def stated_in(source: str, key: str = "") -> Iterator[None]:
    """InputErrors about what a file states are CaptureErrors about that file, and its `key`.

    >>> with stated_in("calibration.txt", "K"):
    ...     raise InputError("not a calibration matrix", source="K", seen="9 9")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: calibration.txt: K: not a calibration matrix (seen 9 9)
    """
    try:
        yield
    except InputError as error:
        raise CaptureError(
            f"{key}: {error.what}" if key else error.what,
            source=source,
            seen=error.seen,
            needed=error.needed,
            remedy=error.remedy,
        ) from error


def check_is(value: object, kind: type[Any], name: str, remedy: str = "") -> None:
    """Raise InputError, with `remedy`, where the argument `name` is no `kind`.

    >>> check_is(3, str, "source", "name where the capture came from")
    Traceback (most recent call last):
    rakelight.errors.InputError: source: this is no str (seen int, needed str). Fix: name where the
    capture came from
    """
    if not isinstance(value, kind):
        public = kind.__module__ == "rakelight.model"
        raise InputError(
            f"this is no {kind.__name__}",
            source=name,
            seen=type(value).__name__,
            needed=f"rakelight.{kind.__name__}" if public else kind.__name__,
            remedy=remedy,
        )


def machine_fault(error: BaseException, more_memory: str) -> str | None:
    """One line for an error by which a library says that the machine is at fault; None for others.

    more_memory : what to do where there is too little

    >>> machine_fault(MemoryError(), "close other programs")
    'not enough memory. Fix: close other programs'
    >>> machine_fault(KeyError("x"), "") is None
    True
    """
    for cause in causes(error):
        if isinstance(cause, MemoryError) or _NO_MEMORY.search(str(cause)):
            return f"not enough memory. Fix: {more_memory}"
        if "can't start new thread" in str(cause):
            remedy = "raise the limit on processes (`ulimit -u`) or on memory (`ulimit -v`)"
            return f"the system starts no more threads. Fix: {remedy}"
    for each in (error, error.__cause__):  # not what was raised while an import was tried
        if isinstance(each, ImportError) and not (each.name or "").startswith("rakelight"):
            remedy = "free memory or raise its limit (`ulimit -v`), else install rakelight again"
            return f"a library cannot be loaded (seen {str(each).strip()[:200]}). Fix: {remedy}"
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return printable(f"{where}the system refused it (seen {error.strerror or error})")
    return None


def causes(error: BaseException | None) -> Iterator[BaseException]:
    """The errors that led to this one, the first of them first, and itself."""
    if error is not None:
        hidden = error.__suppress_context__
        yield from causes(error.__cause__ or (None if hidden else error.__context__))
        yield error


def rounded(value: float) -> str:
    """A number with two digits, or as a whole one, never as a power.

    >>> rounded(0.123), rounded(9.96), rounded(99.6), rounded(123.4), rounded(1e-5)
    ('0.12', '10', '100', '123', '0')
    """
    if abs(value) < 1e-4:
        return "0"
    return f"{value:.2g}" if abs(value) < 9.95 else f"{value:.0f}"


def counted(count: int, what: str) -> str:
    """So many of them, in words.

    >>> counted(1, "photograph"), counted(12, "photograph")
    ('1 photograph', '12 photographs')
    """
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def cut(text: str, longest: int = _LONGEST) -> str:
    """`text`, its middle left out when it is long.

    >>> cut("0123456789", 5)
    '01…89'
    """
    half = longest // 2
    return text if len(text) <= longest else f"{text[:half]}…{text[-half:]}"


def printable(text: str) -> str:
    r"""`text` on one line, safe for a terminal: control and undecodable characters escaped.

    >>> printable("a\nb")
    'a\\nb'
    """
    text = fsencode_safe(text)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def fsencode_safe(path: str) -> str:
    r"""`path` with the bytes that are not UTF-8 written as \\xNN.

    >>> fsencode_safe("caf\udce9")
    'caf\\xe9'
    """
    return path.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def listed(names: Sequence[str], chosen: Iterable[bool] | None = None) -> str:
    """The chosen names, or all, safe for a terminal; the first few of many.

    >>> listed(["0.png", "1.png", "2.png"], [True, False, True])
    '0.png, 2.png'
    """
    wanted = repeat(True, len(names)) if chosen is None else chosen
    these = [printable(name) for name, taken in zip(names, wanted, strict=True) if taken]
    return ", ".join(these[:4]) + (f" and {len(these) - 4} more" if len(these) > 4 else "")
