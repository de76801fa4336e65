"""Decoders of other people, each in a process of its own: for HEIC, raw and EXR files.

LibRaw and OpenEXR print about damaged files, OpenEXR returns zeros for pixels that it cannot
unpack, and all three are large and decode what strangers send.  So they run in a child with little
memory and time; what it prints, and its end, make the file a damaged one.  The child's answers are
JSON and plain numbers, checked here.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from rakelight.capture.headers import MAX_PIXELS, damaged
from rakelight.errors import CaptureError, InputError, MachineError, RakelightError
from rakelight.extras import needs
from rakelight.model import Array

# Library that decodes each kind.
LIBRARIES = {"heic": "pillow_heif", "raw": "rawpy", "exr": "OpenEXR"}

# That one file may take; a raw file of 100 megapixels takes about 20 (two cores).
SECONDS = 120.0
_LONGEST_ANSWER = 100_000  # bytes of the JSON line before the arrays
_DTYPES = ("uint8", "uint16", "float32")
_MOST_ARRAYS = 8
_ERRORS = {"CaptureError": CaptureError, "InputError": InputError, "MachineError": MachineError}


@dataclass(frozen=True)
class Decoded:
    """What a decoder makes of a file: arrays by their names, and facts (JSON)."""

    arrays: dict[str, Array]
    facts: dict[str, Any]


class DecoderProcess:
    """One child that decodes file after file; a context manager, which ends it.

    >>> with DecoderProcess() as decoder:
    ...     decoder.decode("exr", b"no such thing", "a.exr")
    Traceback (most recent call last):
    rakelight.errors.CaptureError: a.exr: the image is damaged (seen ...
    """

    def __init__(self, seconds: float = SECONDS) -> None:
        self._seconds = seconds
        self._child: subprocess.Popen[bytes] | None = None
        self._said: IO[bytes] | None = None

    def __enter__(self) -> DecoderProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def decode(self, kind: str, data: bytes, source: str, **options: Any) -> Decoded:
        """What the decoder of `kind` ("heic", "raw", "exr") makes of a file's bytes.

        options : of that decoder, JSON

        Raises CaptureError for a file that is damaged, too large or of a kind that is not read,
        MissingExtraError where the library is not installed.
        """
        needs(LIBRARIES[kind], "photos", source)
        child = self._child = self._child or self._start()
        timer = threading.Timer(self._seconds, child.kill)
        timer.start()
        try:
            job = {"kind": kind, "size": len(data), "options": options}
            answer = self._ask(child, json.dumps(job).encode() + b"\n", data)
            if "error" not in answer:
                arrays = {array["name"]: _array(child, array) for array in _arrays(answer)}
                return Decoded(arrays, dict(answer["facts"]))
        except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
            self._end()
            raise damaged(source, "its decoder ended over it") from error
        except BaseException:
            self._end()
            raise
        finally:
            timer.cancel()
        raise _error(answer, source)

    def _ask(self, child: subprocess.Popen[bytes], job: bytes, data: bytes) -> dict[str, Any]:
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write(job)
        child.stdin.write(data)
        child.stdin.flush()
        answer = json.loads(child.stdout.readline(_LONGEST_ANSWER))
        if not isinstance(answer, dict):
            raise ValueError("no answer")
        return answer

    def _start(self) -> subprocess.Popen[bytes]:
        if not sys.executable:
            raise MachineError("no Python interpreter to decode the photographs with")
        package = Path(__file__).resolve().parents[2]
        path = os.pathsep.join(filter(None, [str(package), os.environ.get("PYTHONPATH")]))
        # -P: nothing is imported from the folder that we happen to stand in.  -u: what the
        # libraries print is seen at once.
        command = [sys.executable, "-P", "-u", "-m", "rakelight.capture.decoder_child"]
        try:
            self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed by _end
            return subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._said,
                env={**os.environ, "PYTHONPATH": path},
            )
        except OSError as error:
            raise MachineError("no process to decode the photographs", seen=str(error)) from error

    def _end(self) -> None:
        child, self._child = self._child, None
        if child is not None:
            child.kill()
            for stream in (child.stdin, child.stdout):
                with suppress(OSError):
                    if stream is not None:
                        stream.close()
            child.wait()
        if self._said is not None:
            self._said.close()
            self._said = None


def _arrays(answer: dict[str, Any]) -> list[dict[str, Any]]:
    arrays = list(answer["arrays"])
    if len(arrays) > _MOST_ARRAYS:
        raise ValueError("too many arrays")
    return arrays


def _array(child: subprocess.Popen[bytes], stated: dict[str, Any]) -> Array:
    """The next array that the child sends."""
    assert child.stdout is not None
    shape = tuple(int(side) for side in stated["shape"])
    small = len(shape) <= 3 and min(shape) >= 0 and math.prod(shape) <= 4 * MAX_PIXELS
    if not small or stated["dtype"] not in _DTYPES:
        raise ValueError("no array of ours")
    array = np.empty(shape, stated["dtype"])
    view = memoryview(array.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
    done = 0
    while done < len(view):
        count = child.stdout.readinto(view[done:])  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        done += count
    return array


def _error(answer: dict[str, Any], source: str) -> RakelightError:
    """The error that the child met, as if it had been met here."""
    kind = _ERRORS.get(str(answer["error"]), CaptureError)
    words = {name: str(answer.get(name, "")) for name in ("seen", "needed", "remedy")}
    return kind(str(answer.get("what", "")), source=source, **words)
