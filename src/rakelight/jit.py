"""Compiled kernels: numba, cached on disk where that is possible, nothing compiled at import.

This module is light.  Modules with kernels import numba; load those on use only.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from rakelight.errors import MachineError
from rakelight.memory import free_addresses, require_threads

# Below this many pixels the cores wait for each other longer than they work.
WORTH_SHARING = 1 << 14

# Bytes of addresses to load LLVM and compile every kernel: 1.0e9 on x86-64, and a margin.  With
# fewer LLVM ends the process, or it hangs.
COMPILER_BYTES = 1.2e9
STACK_BYTES = 8e6  # of addresses for each thread, as Linux gives them

Function: TypeAlias = Callable[..., Any]

_kernels: list[Any] = []


def kernel(function: Function, *, any_order: bool = False, parallel: bool = True) -> Function:
    """Compile `function` on its first call: prange on all cores, the interpreter's lock released.

    any_order : whether sums may be taken in another order than written, so that their loops run in
        wide instructions; how the work is split among cores must not change such loops
    parallel : False for a function of one block of the work, which `in_blocks` shares among the
        cores.  Numba compiles the body of a prange three times: seconds for a large one.

    The machine code is cached beside the source, else in the user's cache folder (or where
    NUMBA_CACHE_DIR says).  Where none of them can be written it is compiled once per process.
    """
    compiled_function = _compiled_lazily(function, parallel=parallel, any_order=any_order)
    _kernels.append(compiled_function)
    return compiled_function


def helper(function: Function, *, any_order: bool = False, inline: bool = False) -> Function:
    """As `kernel`, for a function without a parallel loop, called from kernels.

    inline : whether its code becomes part of each kernel, which is compiled longer then
    """
    return _compiled_lazily(function, parallel=False, any_order=any_order, inline=inline)


@contextmanager
def threads_for(pixels: int, rows: int = 0) -> Iterator[None]:
    """Kernels called inside use one core unless there are enough pixels to share.

    rows : that a core takes at a time, for rows of unequal work; 0 shares them out at once
    """
    numba = _numba()
    before = numba.get_num_threads()
    numba.set_num_threads(before if pixels >= WORTH_SHARING else 1)
    try:
        with numba.parallel_chunksize(rows):
            yield
    finally:
        numba.set_num_threads(before)


def in_blocks(work: Callable[[int], None], blocks: int, pixels: int) -> None:
    """Call work(0), work(1), ... work(blocks - 1) on all cores.

    pixels : with fewer than `WORTH_SHARING` on one core
    work : calls kernels that release the interpreter's lock; blocks must not depend on each other.
    What one of them raises is raised here, once none is at work any more.
    """
    threads: int = _numba().get_num_threads() if pixels >= WORTH_SHARING else 1
    left = iter(range(blocks))  # each block goes to the thread that asks next

    def take() -> None:
        for block in left:
            work(block)

    others = [_pool(threads).submit(take) for _ in range(min(threads, blocks) - 1)]
    try:
        take()
    finally:
        for _ in left:  # after an error or an interrupt nothing more is begun
            pass
        wait(others)
    for other in others:
        other.result()


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    """Threads beside the caller's; a forked process, which lacks them, makes its own."""
    return ThreadPoolExecutor(max(threads - 1, 1), thread_name_prefix="rakelight")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Dense products inside use one core.

    They are small here, and the threads of a BLAS, which wait awake, would keep the kernels' off.
    """
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1, user_api="blas"):
        yield


def share(columns: int) -> int:
    """How many columns each thread takes: all that there are, split evenly, but 64 or more."""
    threads: int = _numba().get_num_threads()
    return max(-(-columns // threads), 64)


def compiled() -> bool:
    """Whether kernels were compiled before, by this process or, cached on disk, by another.

    False means that the next call takes seconds: worth announcing to a person.
    """
    return any(each.signatures or _on_disk(each) for each in _kernels)


def __getattr__(name: str) -> Any:
    # Kernels take numba's prange from here: then numba is loaded only where there is room for it.
    if name == "prange":
        return _numba().prange
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


@cache
def _numba() -> Any:
    """numba; MachineError where the system gives too little for it to end well."""
    source, cores = "compiling the kernels", os.cpu_count() or 1
    free, needed = free_addresses(), COMPILER_BYTES + cores * STACK_BYTES
    if free < needed:
        raise MachineError(
            "too few addresses for this process",
            source=source,
            seen=f"{free / 1e6:,.0f} MB free",
            needed=f"{needed / 1e6:,.0f} MB",
            remedy="raise the limit on virtual memory (`ulimit -v unlimited`)",
        )
    numba = import_module("numba")
    threads: int = numba.config.NUMBA_NUM_THREADS
    require_threads(
        threads,
        source=source,
        remedy="raise the limit on processes (`ulimit -u`), or set NUMBA_NUM_THREADS=1",
    )
    return numba


def _compiled_lazily(
    function: Function, *, parallel: bool, any_order: bool, inline: bool = False
) -> Function:
    njit = _numba().njit
    # No more of fastmath than that: the same numbers however the work is split.
    options: dict[str, Any] = {
        "parallel": parallel, "nogil": True, "error_model": "numpy",
        "fastmath": {"reassoc", "contract", "nsz"} if any_order else False,
        "inline": "always" if inline else "never",
    }  # fmt: skip
    dispatcher: Function
    try:
        dispatcher = njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder to cache in
        dispatcher = njit(**options)(function)
    return dispatcher


def _on_disk(dispatcher: Any) -> bool:
    folder = dispatcher.stats.cache_path
    stem = Path(dispatcher.py_func.__code__.co_filename).stem
    pattern = f"{stem}.{dispatcher.py_func.__qualname__}-*.nbi"
    return folder is not None and any(Path(folder).glob(pattern))


def _after_fork() -> None:
    """Let a forked process run kernels: on one core, as the other threads stayed with its parent.

    OpenMP would wait for them for ever, wherefore numba ends a process that lacks them.  A team of
    one waits for nobody; starting numba's threads again tells it whose process this is.
    """
    _pool.cache_clear()
    numba = sys.modules.get("numba")
    try:
        if numba is None or numba.threading_layer() != "omp":
            return  # the other layers look after themselves
    except ValueError:  # no kernel was loaded yet
        return
    from ctypes import CFUNCTYPE, c_int

    layer = import_module("numba.np.ufunc.omppool")
    CFUNCTYPE(None, c_int)(layer.launch_threads)(1)
    numba.set_num_threads(1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
