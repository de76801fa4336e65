"""Dask's side of a batch: worker processes of our own, or a cluster that exists."""

from __future__ import annotations

import logging
import os
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import isfinite
from tempfile import TemporaryDirectory
from typing import Any

from rakelight.errors import InputError, MachineError, causes, counted
from rakelight.extras import needs
from rakelight.memory import (
    free_memory,
    require_files,
    require_memory,
    require_working_directory,
)

# Bytes that a worker needs for the smallest capture: its libraries alone take 0.3e9.
LEAST_BYTES = 0.6e9
# Bytes that a worker should have where their number is ours to choose: a capture of 1.2 megapixels
# takes 0.7e9 to 2.0e9 (benchmarks/README.md).
USUAL_BYTES = 2e9
# Files and connections that Dask opens here: 17 and 10 for each worker (distributed 2026, Linux),
# and a margin.  With fewer it hangs, or prints tracebacks.
OPEN_FILES = 20
OPEN_FILES_PER_WORKER = 10
# Seconds in which a scheduler has to answer, and its first worker to be there.
ANSWER_S = 10.0
# Seconds that ending the workers may take; after five the program ends in any case.
CLOSE_S = 2.0

# A capture whose worker died is tried once more.  Nothing is swapped: a worker that takes more
# than its share is ended before the machine comes to a stand.
_SETTINGS = {
    "distributed.scheduler.allowed-failures": 1,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
}

# Signals by which worker processes of our own ended, by their addresses.
Deaths = dict[str, int]


def require_dask() -> None:
    """Raise MissingExtraError where Dask is not installed."""
    needs("distributed", "batch", "rakelight batch")


def worker_count(asked: int | None, jobs: int) -> int:
    """How many worker processes: as asked, else one for each core that has memory and work.

    Raises InputError for fewer than one, MachineError where so many have too little memory.

    >>> worker_count(None, 1)
    1
    """
    if asked is not None and asked < 1:
        raise InputError(
            "no number of workers", source="--workers", seen=str(asked), needed="1 or more"
        )
    count = max(min(_cores(), int(min(free_memory() // USUAL_BYTES, 1000)), jobs), 1)
    count = count if asked is None else min(asked, jobs)
    require_memory(
        count * LEAST_BYTES,
        source=counted(count, "worker"),
        remedy="close other programs" + _or_one(count),
    )
    return count


def _or_one(workers: int) -> str:
    return ", or --workers 1" if workers > 1 else ""


@contextmanager
def local_client(workers: int, deaths: Deaths) -> Iterator[Any]:
    """A Dask client with so many worker processes, each with its share of cores and memory.

    They end with the block, at once where it raises, and with this process in any case.

    deaths : what is known of workers that died is added to it

    Raises MachineError where none can be started.
    """
    require_dask()
    require_working_directory(needed="one in which worker processes can start")
    require_files(
        OPEN_FILES + OPEN_FILES_PER_WORKER * workers,
        source=counted(workers, "worker"),
        remedy="raise the limit on open files (`ulimit -n`)" + _or_one(workers),
    )
    import dask
    from distributed import Client

    with (
        TemporaryDirectory(prefix="rakelight-batch-", ignore_cleanup_errors=True) as scratch,
        _environment_kept(),
        dask.config.set({**_SETTINGS, "temporary-directory": scratch}),
    ):
        cluster = client = None
        levels = _silenced()
        try:
            try:
                cluster = _local_cluster(workers, scratch, deaths)
                client = Client(cluster, set_as_default=False)
            except (OSError, RuntimeError) as error:
                raise _no_workers(error) from error
            yield client
        except BaseException:
            if cluster is not None:
                _kill_workers(cluster)
            raise
        finally:
            ended = [_closed(each) for each in (client, cluster) if each is not None]
            if all(ended):  # else its threads go on, and tell of connections that are gone
                for handler, level in levels.items():
                    handler.setLevel(level)


def _silenced() -> dict[logging.Handler, int]:
    """The levels of Dask's log handlers, from now on above all that it says.

    A cluster silences it only until it is closed itself, before its connections are.
    """
    levels = {handler: handler.level for handler in logging.getLogger("distributed").handlers}
    for handler in levels:
        handler.setLevel(logging.CRITICAL)
    return levels


def _closed(ends: Any) -> bool:
    """Whether a client or a cluster could be closed, in time."""
    try:
        ends.close(timeout=CLOSE_S)
    except Exception:
        return False
    return True


def _local_cluster(workers: int, scratch: str, deaths: Deaths) -> Any:
    from distributed import LocalCluster, Nanny

    class Watched(Nanny):  # type: ignore[misc]
        """Says how its process ended, which Dask only logs."""

        def _on_worker_exit_sync(self, *how: Any) -> Any:
            if how and isinstance(how[0], int) and self.worker_address:
                deaths[self.worker_address] = -how[0]
            return super()._on_worker_exit_sync(*how)

    share = free_memory() / workers
    return LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        memory_limit=int(share) if isfinite(share) else "auto",
        worker_class=Watched,
        # Without a dashboard it still listens, and warns where the port is taken: any free one.
        scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
        local_directory=scratch,
        preload=["rakelight.batch.worker"],
        env={
            "NUMBA_NUM_THREADS": str(max(_cores() // workers, 1)),
            "OMP_WAIT_POLICY": "PASSIVE",
            # What a killed worker leaves there is deleted with the rest.
            "TMPDIR": scratch,
        },
    )


@contextmanager
def _environment_kept() -> Iterator[None]:
    """Dask sets the workers' environment variables in this process, too: not for longer."""
    before = dict(os.environ)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def _kill_workers(cluster: Any) -> None:
    """End the workers at once: they are at work for minutes, and their results are not wanted."""
    for nanny in list(cluster.workers.values()):
        nanny.auto_restart = False
        with suppress(OSError, TypeError):  # it has ended, or has not begun
            os.kill(nanny.pid, getattr(signal, "SIGKILL", signal.SIGTERM))


@contextmanager
def remote_client(address: str) -> Iterator[Any]:
    """A Dask client of the cluster at `address`, as "tcp://host:8786".

    Raises InputError for what is no address, and for workers that would do several captures in one
    process, MachineError where nobody answers or no worker comes.
    """
    require_dask()
    from distributed import Client

    if not re.fullmatch(r"[a-z]+://[^/\s]+:[0-9]{1,5}", address):
        raise InputError(
            "no address of a scheduler",
            source="--scheduler",
            seen=address,
            needed="tcp://HOST:PORT",
        )
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise MachineError(
            "no Dask scheduler answers there",
            source=address,
            seen=str(error),
            remedy="start one with `dask scheduler`, or leave --scheduler away",
        ) from error
    try:
        _require_workers(client, address)
        yield client
    finally:
        with suppress(Exception):
            client.close(timeout=CLOSE_S)


def _require_workers(client: Any, address: str) -> None:
    remedy = f"start them with `dask worker {address} --nthreads 1`"
    try:
        client.wait_for_workers(1, timeout=ANSWER_S)
    except OSError as error:
        raise MachineError("this scheduler has no workers", source=address, remedy=remedy) from (
            error
        )
    threads = max(client.nthreads().values())
    if threads > 1:
        raise InputError(
            "these workers would refine several captures in one process",
            source=address,
            seen=f"{threads} threads",
            needed="1",
            remedy=remedy,
        )


def _no_workers(error: OSError | RuntimeError) -> MachineError:
    """Dask's failure to start them, with what the system said last, where it said anything."""
    told = [cause.strerror for cause in causes(error) if isinstance(cause, OSError)]
    return MachineError(
        "no worker processes can be started",
        seen=[str(error), *filter(None, told)][-1],
        remedy="use fewer --workers, or raise the limits on processes and open files "
        "(`ulimit -u`, `ulimit -n`)",
    )


def _cores() -> int:
    """Cores that this process may use, as containers limit them, too."""
    require_dask()
    from dask.system import CPU_COUNT

    return int(CPU_COUNT)
