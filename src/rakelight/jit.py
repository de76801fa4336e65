"""Compiled kernels: numba, cached on disk where that is possible, nothing compiled at import.

This module is light.  Modules with kernels import numba; load those on use only.
"""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from contextvars import ContextVar, copy_context
from functools import cache
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Lock, Thread
from typing import Any, TypeAlias, TypeVar, cast

from rakelight.errors import InputError
from rakelight.memory import require_addresses, require_threads, require_working_directory

# Below this many pixels the cores wait for each other longer than they work.
WORTH_SHARING = 1 << 14

# Bytes of addresses to load LLVM and compile every kernel: 1.0e9 on x86-64, and a margin.  With
# fewer LLVM ends the process, or it hangs.
COMPILER_BYTES = 1.2e9
STACK_BYTES = 8e6  # of addresses for each thread, as Linux gives them

Function: TypeAlias = Callable[..., Any]
S = TypeVar("S")
T = TypeVar("T")

_kernels: list[Kernel] = []
_wait: Callable[[Kernel], None] | None = None
_most_threads: ContextVar[int] = ContextVar("most threads", default=1 << 30)
# Blocks inside `one_blas_thread` in all threads, the limit that they share, and the lock of both.
_blas_blocks = 0
_blas_limit: Any = None
_blas_lock = Lock()


class Kernel:
    """A function that is compiled on its first call, to be called from Python; see `kernel`."""

    def __init__(self, dispatcher: Any) -> None:
        self.dispatcher = dispatcher
        self.__name__: str = dispatcher.__name__
        self.__module__ = dispatcher.__module__

    def __call__(self, *arguments: Any) -> Any:
        """Call it; before its first call, wait for a process that compiles it."""
        if _wait is not None and not self.dispatcher.signatures:
            _wait(self)
        return self.dispatcher(*arguments)

    @property
    def compiled(self) -> bool:
        """Whether it was compiled, by this process or, cached on disk, by another."""
        return bool(self.dispatcher.signatures) or _on_disk(self.dispatcher)

    @property
    def cacheable(self) -> bool:
        """Whether it is cached on disk for other processes when it has been compiled."""
        return self.dispatcher.stats.cache_path is not None


def kernel(function: Function, *, any_order: bool = False) -> Kernel:
    """Compile `function` on its first call, for a part of a loop; the interpreter's lock released.

    function : (first, last, ...), runs an outer loop from first up to last, which is not in it,
        or (block, ...); `in_parts` and `in_blocks` share the work among the cores.  numba's own
        prange compiles its body three times, and its threads do not survive a fork.
    any_order : whether sums may be taken in another order than written, so that their loops run in
        wide instructions; the place where a loop is split must not change them

    The machine code is cached beside the source, else in the user's cache folder (or where
    NUMBA_CACHE_DIR says).  Where none of them can be written it is compiled once per process; what
    is damaged there is compiled and written anew.

    Raises InputError where a variable of numba's environment is one that nothing can be compiled
    with, MachineError where the system gives too little for it.
    """
    _kernels.append(Kernel(_compiled_lazily(function, any_order=any_order)))
    return _kernels[-1]


def helper(function: Function, *, any_order: bool = False, inline: bool = False) -> Function:
    """As `kernel`, for a function that is called from kernels, or for the whole of a loop.

    inline : whether its code is put into each kernel before that is compiled, which takes longer
        then, and not after
    """
    return _compiled_lazily(function, any_order=any_order, inline=inline)


def in_parts(
    work: Function, first: int, last: int, pixels: int, *arguments: Any, least: int = 1
) -> None:
    """Call the kernel `work` for as many equal parts of a loop as there are cores, side by side.

    pixels : the work's size: below `WORTH_SHARING` it is one part; least : iterations of a part
    """
    parts = max(min(_threads(pixels), (last - first) // least), 1)
    if parts == 1:
        work(first, last, *arguments)
        return
    ends = [first + part * (last - first) // parts for part in range(parts + 1)]
    in_blocks(lambda part: work(ends[part], ends[part + 1], *arguments), parts, pixels)


def in_blocks(work: Callable[[int], None], blocks: int, pixels: int) -> None:
    """Call work(0), work(1), ... work(blocks - 1) on all cores, as these get free.

    pixels : the work's size: below `WORTH_SHARING` one core does it
    work : calls kernels, which release the interpreter's lock; no block needs another's result

    What one of them raises is raised here, when none is at work any more.
    """
    threads = min(_threads(pixels), blocks)
    left = iter(range(blocks))

    def take() -> None:
        for block in left:
            work(block)

    if threads == 1:
        take()
        return
    ended: SimpleQueue[BaseException | None] = SimpleQueue()
    for _ in range(threads - 1):
        _tasks().put((take, ended))
    try:
        take()
    finally:
        for _ in left:  # after an error, or an interrupt, nothing more is begun
            pass
        errors = [ended.get() for _ in range(threads - 1)]
    for error in errors:
        if error is not None:
            raise error


@contextmanager
def limited_threads(most: int) -> Iterator[None]:
    """Kernels called inside use at most so many cores."""
    token = _most_threads.set(most)
    try:
        yield
    finally:
        _most_threads.reset(token)


class StoppedError(Exception):
    """Work, or a wait, whose result nobody waits for any more."""


def side_by_side(
    work: Callable[[S, Callable[[], None]], T], items: Iterable[S], workers: int
) -> Iterator[T]:
    """work(item, check) of each, in their order, some at a time, each on its part of the cores.

    workers : how many at a time; work : calls check() several times a second, which ends it after
        an error or an interrupt

    For work that does not keep all cores busy by itself.

    >>> list(side_by_side(lambda item, check: item + 1, [1, 2, 3], workers=2))
    [2, 3, 4]
    """
    stop, share = Event(), max(1, cores() // workers)

    def check() -> None:
        if stop.is_set():
            raise StoppedError

    def alone(item: S) -> T:
        with limited_threads(share):
            return work(item, check)

    waiting: deque[Future[T]] = deque()
    with ThreadPoolExecutor(workers) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(copy_context().run, alone, item))
                if len(waiting) > workers:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            stop.set()
            for future in waiting:
                future.cancel()


def worth_side_by_side() -> int:
    """How many pieces of work that are partly Python go side by side on these cores: one or two.

    More than two would wait for the interpreter.
    """
    return min(cores(), 2)


def _threads(pixels: int) -> int:
    """How many cores work of that size is worth."""
    return 1 if pixels < WORTH_SHARING else min(cores(), _most_threads.get())


def cores() -> int:
    """How many cores this process may use, or fewer, as NUMBA_NUM_THREADS says."""
    threads: int = _numba().config.NUMBA_NUM_THREADS
    return threads


@cache
def _tasks() -> SimpleQueue[Any]:
    """The queue of the threads beside the caller's: a function, and the queue for how it ended.

    One thread less than there are cores, made once.  Queues hand work over in less than half the
    time of concurrent.futures; a kernel on a small image takes no longer than that.
    """
    tasks: SimpleQueue[Any] = SimpleQueue()

    def work() -> None:
        while True:
            function, ended = tasks.get()
            try:
                function()
            except BaseException as error:  # the caller raises it
                ended.put(error)
            else:
                ended.put(None)
            del function, ended  # arrays must not live until the next task

    for _ in range(cores() - 1):
        Thread(target=work, name="rakelight", daemon=True).start()
    return tasks


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Dense products inside use one core.

    They are small here, and the threads of a BLAS, which wait awake, would keep the kernels' off.
    The number is the process's: of all threads the first one inside sets it, the last one out puts
    it back.  Enter it before threads are begun whose products it is about: a BLAS is not made for
    its number to change while it is at work.
    """
    from threadpoolctl import threadpool_limits

    global _blas_blocks, _blas_limit
    with _blas_lock:
        if not _blas_blocks:
            _blas_limit = threadpool_limits(1, user_api="blas")
            _let_others_set_it()
        _blas_blocks += 1
    try:
        yield
    finally:
        with _blas_lock:
            _blas_blocks -= 1
            if not _blas_blocks:
                _blas_limit.restore_original_limits()
                _let_others_set_it()


def _let_others_set_it() -> None:
    """Let any thread set the number next: threadpoolctl 3.8 heeds only the one that did, else."""
    from threadpoolctl import OpenBLASController

    if hasattr(OpenBLASController, "clear_controlling_thread"):
        OpenBLASController.clear_controlling_thread()


def compiled() -> bool:
    """Whether kernels were compiled before, by this process or, cached on disk, by another.

    False means that the next call takes seconds: worth announcing to a person.
    """
    return any(each.compiled for each in _kernels)


def to_be_cached() -> list[Kernel]:
    """The kernels loaded so far that were never compiled, and will be cached for other processes.

    Those of modules that have been imported.
    """
    return [each for each in _kernels if each.cacheable and not each.compiled]


@contextmanager
def waiting_for_others(wait: Callable[[Kernel], None]) -> Iterator[None]:
    """Inside, wait(kernel) is called before the first call of each kernel, by whatever thread."""
    global _wait
    _wait = wait
    try:
        yield
    finally:
        _wait = None


def compiler_addresses() -> float:
    """Bytes of addresses that the compiler and its threads take on this machine.

    >>> compiler_addresses() > COMPILER_BYTES
    True
    """
    return COMPILER_BYTES + (os.cpu_count() or 1) * STACK_BYTES


@cache
def _numba() -> Any:
    """numba; InputError for an environment and MachineError for a system that it cannot work in."""
    source = "compiling the kernels"
    _require_number_of_threads()
    require_addresses(compiler_addresses(), source=source)
    # numba imports scipy.linalg.cython_blas with its first kernel.  Where another thread imports
    # scipy.linalg at that moment, each waits for the other, and Python ends one with an error.
    import_module("scipy.linalg")
    numba = import_module("numba")
    if numba.config.DISABLE_JIT:
        raise InputError(
            "set, so that no kernel is compiled; uncompiled they would take hours",
            source="NUMBA_DISABLE_JIT",
            remedy="`unset NUMBA_DISABLE_JIT`",
        )
    threads: int = numba.config.NUMBA_NUM_THREADS
    require_threads(
        threads,
        source=source,
        remedy="raise the limit on processes (`ulimit -u`), or set NUMBA_NUM_THREADS=1",
    )
    return numba


def _require_number_of_threads() -> None:
    """Raise InputError for a NUMBA_NUM_THREADS with which numba fails, or prints a traceback."""
    name = "NUMBA_NUM_THREADS"
    text = os.environ.get(name, "1")
    if not re.fullmatch(r"\s*0*[1-9][0-9]*\s*", text):
        raise InputError(
            "no number of threads",
            source=name,
            seen=repr(text),
            needed="1 or more",
            remedy=f"set it to such a number, or `unset {name}`",
        )


class _Cache:
    """numba's cache of a function on disk; no damaged file and no full disk lets a call fail."""

    def __init__(self, cache: Any) -> None:
        self._cache = cache
        self.cache_path: str = cache.cache_path
        self.flush: Callable[[], None] = cache.flush

    def load_overload(self, *key: Any) -> Any:
        """What was compiled before; None, so that it is compiled now, where none can be read."""
        try:
            loaded = self._cache.load_overload(*key)
        except Exception:  # unpickling what is damaged raises anything
            self._begin_anew()
            loaded = None
        if loaded is None:
            require_working_directory(needed="one in which numba can compile")
        return loaded

    def save_overload(self, *compiled: Any) -> None:
        """Save it for other processes, where the system lets us."""
        with suppress(OSError):
            self._cache.save_overload(*compiled)

    def _begin_anew(self) -> None:
        """Empty the index; where it must stay, damaged, nothing is saved, either."""
        try:
            self._cache.flush()
        except OSError:
            self._cache.disable()


def _compiled_lazily(function: Function, *, any_order: bool, inline: bool = False) -> Function:
    njit = _numba().njit
    # No more of fastmath than that: the same numbers however the work is split.
    options: dict[str, Any] = {
        "nogil": True, "error_model": "numpy",
        "fastmath": {"reassoc", "contract", "nsz"} if any_order else False,
        "inline": "always" if inline else "never",
        # Else a kernel calls whichever copy of a helper this process has: its own is rounded
        # otherwise than that in kernels that are loaded from the cache.
        "forceinline": True,
    }  # fmt: skip
    dispatcher: Any = njit(**options)(function)
    with suppress(RuntimeError):  # numba found no folder to cache in
        dispatcher.enable_caching()
        dispatcher._cache = _Cache(dispatcher._cache)
    return cast("Function", dispatcher)


def _on_disk(dispatcher: Any) -> bool:
    folder = dispatcher.stats.cache_path
    stem = Path(dispatcher.py_func.__code__.co_filename).stem
    # The code, not the index to it: numba writes that first, and may find no room for more.
    pattern = f"{stem}.{dispatcher.py_func.__qualname__}-*.nbc"
    return folder is not None and any(Path(folder).glob(pattern))


# A forked process lacks the threads of its parent, and makes its own; none of them holds the lock.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_tasks.cache_clear)
    os.register_at_fork(
        before=_blas_lock.acquire,
        after_in_parent=_blas_lock.release,
        after_in_child=_blas_lock.release,
    )
