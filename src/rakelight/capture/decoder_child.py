"""The child of `decoder_process`: decodes what it is sent until there is no more.

A job is a line of JSON (kind, size, options) and `size` bytes; the answer a line of JSON and the
arrays' bytes, or an error's words.
"""

from __future__ import annotations

import ctypes
import json
import os
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import IO, Any

import numpy as np

from rakelight.capture.headers import damaged
from rakelight.errors import MachineError, RakelightError
from rakelight.model import Array

# Bytes of memory beyond what stands when all is imported: a raw file of 100 megapixels takes 2e9
# (mosaic, four channels and the result, 16 bit each), colours as 32-bit floats 2.4e9.
MEMORY = 4_000_000_000

Answer = tuple[dict[str, Array], dict[str, Any]]


def main() -> None:
    """Answer jobs from standard input on standard output."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is counted with its errors, and mixes with no answer
    _limit_memory()
    with open(0, "rb", closefd=False) as jobs:
        while line := jobs.readline():
            job = json.loads(line)
            _answer(job, jobs.read(job["size"]), answers)


def _answer(job: dict[str, Any], data: bytes, answers: IO[bytes]) -> None:
    try:
        arrays, facts = _decoded(job, data)
    except RakelightError as error:
        words = {name: getattr(error, name) for name in ("what", "seen", "needed", "remedy")}
        _send(answers, {"error": type(error).__name__, **words}, {})
        return
    stated = [
        {"name": name, "dtype": str(array.dtype), "shape": array.shape}
        for name, array in arrays.items()
    ]
    _send(answers, {"arrays": stated, "facts": facts}, arrays)


def _decoded(job: dict[str, Any], data: bytes) -> Answer:
    decode: Callable[..., Answer] = import_module(f"rakelight.capture.{job['kind']}").decode
    before = os.fstat(2).st_size
    try:
        answer = decode(data, **job["options"])
    except RakelightError:
        raise
    except MemoryError as error:
        raise MachineError("too little memory to decode the image") from error
    except Exception as error:  # libraries raise anything about damaged files
        raise damaged("", " ".join(str(error).split())[:200] or type(error).__name__) from error
    with suppress(OSError, TypeError, AttributeError):  # where C's buffers cannot be reached
        ctypes.CDLL(None).fflush(None)
    said = os.fstat(2).st_size
    if said > before:
        words = " ".join(os.pread(2, 200, before).decode(errors="replace").split())
        raise damaged("", words)
    return answer


def _send(answers: IO[bytes], line: dict[str, Any], arrays: dict[str, Array]) -> None:
    answers.write(json.dumps(line).encode() + b"\n")
    for array in arrays.values():
        answers.write(np.ascontiguousarray(array).data)
    answers.flush()


def _limit_memory() -> None:
    try:
        import resource
    except ImportError:  # Windows
        return
    with suppress(OSError, ValueError, IndexError):
        with open("/proc/self/statm", "rb") as file:  # noqa: PTH123
            pages = int(file.read().split()[0])
        limit = pages * os.sysconf("SC_PAGE_SIZE") + MEMORY
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        if most == resource.RLIM_INFINITY or limit < most:
            resource.setrlimit(resource.RLIMIT_AS, (limit, most))


if __name__ == "__main__":
    main()
