"""A capture from whatever holds one: rakelight's folder, a recording, a dataset's folder."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral
from os import PathLike
from typing import Any

from rakelight.capture.readers import Wanted, find_reader
from rakelight.errors import InputError
from rakelight.files import as_path
from rakelight.memory import limited_memory
from rakelight.model import Capture


def load_capture(
    source: str | PathLike[str],
    photographs: Sequence[int] | None = None,
    *,
    memory: float | None = None,
) -> Capture:
    """Read a capture, strictly; nothing of the source is changed.

    Parameters
    ----------
    source : a folder with capture.toml, or whatever else `rakelight import --list` names
    photographs : read only these, by their numbers from 0 in the order of their names or of the
        recording; all when None
    memory : bytes that this process may take in all; what is free when None.  Photographs that
        would take more than a quarter of what is left lie in a file on disk without a name

    Returns
    -------
    the Capture: photographs as stored, depth in metres with NaN = no measurement, and in
    `findings` what a person should know about it

    Raises
    ------
    CaptureError
        something is missing, damaged or contradicts itself; says which file and what to do
    InputError
        there are not so many photographs, one is named twice, or `source`, `photographs` or
        `memory` is no such thing
    MissingExtraError
        a library that this kind of source needs is not installed; says what installs it
    MachineError
        a file cannot be read, or memory does not suffice

    Examples
    --------
    >>> load_capture("no/such/folder")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: no/such/folder: no such folder or file (needed ...
    """
    path = as_path(source, "source")
    wanted = Wanted(None if photographs is None else _numbers(photographs))
    with limited_memory(memory):
        return find_reader(path).read(path, wanted).capture


def _numbers(photographs: Any) -> tuple[int, ...]:
    """The numbers of photographs, in their order; raises InputError for anything else.

    >>> _numbers(range(2))
    (0, 1)
    >>> _numbers([True, False])
    Traceback (most recent call last):
    rakelight.errors.InputError: photographs: these are no numbers of photographs (seen [True, ...
    """
    try:
        numbers = tuple(photographs)
    except TypeError:  # an array of no axis has __iter__, too
        numbers = (None,)
    if not all(isinstance(each, Integral) and not isinstance(each, bool) for each in numbers):
        raise InputError(
            "these are no numbers of photographs",
            source="photographs",
            seen=str(photographs)[:80],
            needed="whole numbers from 0",
            remedy="[0, 2, 5] for the first, the third and the sixth",
        )
    if len(set(numbers)) < len(numbers):
        raise InputError(
            "a photograph twice",
            source="photographs",
            seen=str(photographs)[:80],
            needed="different numbers",
            remedy="name each photograph once",
        )
    return tuple(map(int, numbers))
