"""What a reader is: a value that recognises a source by its content and makes a capture of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rakelight.model import Array, Capture, ProgressCallback, silent


@dataclass(frozen=True)
class Wanted:
    """What the user asks of a reader.

    photographs : read only these, by their numbers from 0, in this order; all when None.  Of a
        recording they are numbers among the photographs that are chosen from its frames.
    progress : called with the stage and, where they can be counted, the frames done
    """

    photographs: tuple[int, ...] | None = None
    progress: ProgressCallback = silent


@dataclass(frozen=True)
class Reading:
    """What a reader makes of a source.

    capture : as `load_capture` returns it, checked, with findings
    contact_sheet : (H, W, 3) uint8 sRGB, the frames of a recording that were taken and dropped, and
        why; None where no frames were chosen
    """

    capture: Capture
    contact_sheet: Array | None = None


@dataclass(frozen=True)
class Reader:
    """One kind of source.

    name : short, for messages and `rakelight import --list`
    reads : what it reads, in one line
    sniff : whether a path holds such a source, by its content: cheap, without heavy libraries, and
        False for whatever cannot be looked at
    read : the capture of a path that `sniff` accepts; raises CaptureError, InputError for a wrong
        wish, MachineError
    extra : the optional dependencies of rakelight that it needs, "" for none
    """

    name: str
    reads: str
    sniff: Callable[[Path], bool]
    read: Callable[[Path, Wanted], Reading]
    extra: str = ""
