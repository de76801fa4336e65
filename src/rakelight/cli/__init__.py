"""The command line.  Here is how the program begins and ends; `commands` runs what was asked.

Nothing slow is imported here: Ctrl-C has its answer from the first moment on.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
from errno import EPIPE
from io import BufferedWriter, FileIO, TextIOWrapper
from time import monotonic, sleep

TYPE_CHECKING = False  # as `typing` has it, which takes longer to import than all else here
if TYPE_CHECKING:
    from typing import Any, NoReturn, TextIO

INTERRUPTED = "interrupted; nothing unfinished was left behind"
NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
SIGNALS = [getattr(signal, name) for name in NAMES if hasattr(signal, name)]
# A second signal comes with the first, or from impatience: so long none disturbs the clean-up.
DEAF_S = 2.0
# Then it ends at the latest: a lock of Python's own, interrupted while it was taken, is never free.
PATIENCE_S = 5.0


def main(arguments: list[str] | None = None) -> None:
    """Run the program and leave with its exit code (docs/reference/commands.md).

    arguments : None for those of the process, whose signals and streams are then ours, too
    """
    if arguments is not None:
        from rakelight.cli.commands import run

        sys.exit(run(arguments))
    interrupt = Interrupt()
    try:
        interrupt.listen()
        printed = _open_streams()
        from rakelight.cli.commands import run

        code = run(sys.argv[1:], lambda: interrupt.came)
        interrupt.ignore()
    except KeyboardInterrupt:  # before anything was begun, or after all was done
        interrupt.ignore()
        _leave(INTERRUPTED, 130)
    except (ImportError, MemoryError) as error:
        _leave(f"the program cannot be loaded (seen {error}). Fix: free some memory", 3)
    sys.stdout.flush()
    refused = printed.refused
    if code == 0 and refused is not None and refused.errno != EPIPE:
        seen = f"seen {refused.strerror}"
        _leave(f"stdout: cannot be written ({seen}). Fix: print to another place", 3)
    sys.exit(code)


def _leave(message: str, code: int) -> NoReturn:
    sys.stderr.write(f"error: {message}\n")
    sys.exit(code)


class Interrupt:
    """Signals that end the program raise KeyboardInterrupt: once, to clean up in peace."""

    def __init__(self) -> None:
        # What was to be ignored, as under nohup or in the background of a script, stays so.
        self._signals = [each for each in SIGNALS if signal.getsignal(each) != signal.SIG_IGN]
        self._last_s = -DEAF_S
        self.came = False

    def listen(self) -> None:
        """From now on signals interrupt."""
        sys.unraisablehook = self._not_lost
        for each in self._signals:
            signal.signal(each, self._raise)

    def ignore(self) -> None:
        """From now on they change nothing: the work is done, what is left takes a moment."""
        for each in self._signals:
            signal.signal(each, signal.SIG_IGN)

    def _raise(self, *_: object) -> None:
        now_s = monotonic()
        if now_s - self._last_s >= DEAF_S:
            self._last_s = now_s
            self.came = True
            _thread.start_new_thread(_end_at_last, ())
            raise KeyboardInterrupt

    def _not_lost(self, caught: sys.UnraisableHookArgs) -> None:
        """Once more what was raised where nothing can be raised, as in a finalizer.

        After a signal, finalizers may fail on objects that it left half built: nothing to tell.
        """
        if issubclass(caught.exc_type, KeyboardInterrupt):
            self._last_s = -DEAF_S
            _thread.start_new_thread(_interrupt_soon, ())
        elif not self.came:
            sys.__unraisablehook__(caught)


def _interrupt_soon() -> None:
    sleep(0.01)
    _thread.interrupt_main()


def _end_at_last() -> None:
    sleep(PATIENCE_S)
    try:
        os.write(2, f"error: {INTERRUPTED}\n".encode())
    finally:
        os._exit(130)


class Stream(FileIO):
    """A standard stream; what it does not take (a full disk, a reader that left) is dropped."""

    refused: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write, or keep the first refusal in mind."""
        try:
            return super().write(data)
        except OSError as error:
            self.refused = self.refused or error
            return memoryview(data).nbytes


def _open_streams() -> Stream:
    """stdout and stderr that never fail, and what there is to know of stdout."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: the next file opened would be taken for it.  stdout takes nothing
            os.open(os.devnull, os.O_WRONLY if number == 2 else os.O_RDONLY)
    out, err = (Stream(number, "w", closefd=False) for number in (1, 2))
    if sys.platform != "win32":  # whose consoles are no files
        sys.stdout, sys.stderr = _text(out, sys.stdout), _text(err, sys.stderr)
    return out


def _text(stream: Stream, like: TextIO | None) -> TextIOWrapper:
    encoding = "utf-8" if like is None else like.encoding
    # A name may not fit the terminal's alphabet.
    return TextIOWrapper(
        BufferedWriter(stream), encoding, errors="backslashreplace", line_buffering=True
    )
