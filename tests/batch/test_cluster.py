"""Dask's side of a batch, with a cluster and a client that do nothing."""

import io
import logging
import socket
from contextlib import suppress
from typing import ClassVar

import pytest

from rakelight.batch import cluster
from rakelight.errors import MachineError

distributed = pytest.importorskip("distributed")


class Ends:
    """A client or a cluster that tells of its end in Dask's log, as its connections do."""

    workers: ClassVar = {}
    fails = False

    def __init__(self, *_, **__):
        pass

    def close(self, timeout):
        logging.getLogger("distributed.batched").error("connection closed")
        if self.fails:
            raise TimeoutError


@pytest.fixture
def log(monkeypatch):
    """A handler of Dask's log."""
    monkeypatch.setattr(cluster, "_local_cluster", Ends)
    monkeypatch.setattr(distributed, "Client", Ends)
    handler = logging.StreamHandler(io.StringIO())
    logger = logging.getLogger("distributed")
    logger.addHandler(handler)
    yield handler
    logger.removeHandler(handler)


@pytest.mark.parametrize("fails", [False, True])
def test_dask_says_nothing_of_a_cluster_that_is_closed(log, monkeypatch, fails):
    monkeypatch.setattr(Ends, "fails", fails)
    before = {handler: handler.level for handler in logging.getLogger("distributed").handlers}
    with pytest.raises(KeyboardInterrupt), cluster.local_client(1, {}):
        raise KeyboardInterrupt
    assert log.stream.getvalue() == ""
    levels = [handler.level for handler in before]
    # What has not ended in time still has threads that would tell of it.
    assert levels == [logging.CRITICAL] * len(before) if fails else levels == [*before.values()]
    for handler, level in before.items():
        handler.setLevel(level)


def test_nothing_stays_in_the_folder_for_temporary_files(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with cluster.local_client(1, {}) as client:
        assert client.submit(abs, -1).result() == 1
    assert list(tmp_path.iterdir()) == []


def test_another_cluster_on_this_machine_is_no_matter(tmp_path, recwarn):
    with socket.socket() as taken:
        with suppress(OSError):  # somebody else has it already
            taken.bind(("", 8787))
        with cluster._local_cluster(1, str(tmp_path), {}) as local:
            (port,) = {service.port for service in local.scheduler.services.values()}
            address = local.scheduler.http_server.address
    assert not recwarn.list
    assert port != 8787
    assert address == "127.0.0.1"


@pytest.mark.usefixtures("deleted_working_directory")
def test_a_working_directory_that_is_gone_is_told_of():
    with (
        pytest.raises(MachineError, match="the working directory is not there any more"),
        cluster.local_client(1, {}),
    ):
        pass
