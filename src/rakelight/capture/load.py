"""A capture from whatever holds one: rakelight's folder, a recording, a dataset's folder."""

from __future__ import annotations

import os
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from rakelight.capture.readers import Wanted, find_reader
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
        there are not so many photographs
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
    path = Path(os.fsdecode(source))
    wanted = Wanted(None if photographs is None else tuple(photographs))
    with limited_memory(memory):
        return find_reader(path).read(path, wanted).capture
