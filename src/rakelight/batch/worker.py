"""What a worker process of our own does as it starts; Dask calls `dask_setup` in it."""

from __future__ import annotations

import gc
import os
import signal
from typing import Any

from rakelight.memory import keep_freed_memory, limit_memory


def dask_setup(worker: Any) -> None:
    """Take no part in the terminal, and no more memory than the worker's share.

    The first process ends the workers: what the terminal sends to all of them is not for them.
    """
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):  # what libraries print would fill the terminal
        os.dup2(nowhere, stream)
    os.close(nowhere)
    # As the program itself does; what a capture took is given back after it (`run_one`).
    keep_freed_memory()
    gc.set_threshold(100_000)
    share = worker.memory_manager.memory_limit
    if share:
        limit_memory(float(share))
