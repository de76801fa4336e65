"""`make kills`, shorter, and that it sees what it looks for."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rakelight import folders
from rakelight.errors import InputError
from tests.faults import kills

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and SIGKILL")

SOURCES = Path(folders.__file__).resolve().parents[1]


def test_killed_runs_lose_nothing():
    done = subprocess.run(
        [sys.executable, kills.__file__, "--kills", "16"],
        env={**os.environ, "PYTHONPATH": os.fspath(SOURCES)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    fixed, _, first, fresh, _, second = done.stdout.splitlines()
    assert (fixed, first, second) == (f"seed {kills.FIXED_SEED}", "16 of 16", "16 of 16")
    assert fresh.startswith("seed ")


OVERWRITES = kills.Case(overwrites=True, exchanges=True, killed_at=0)


@pytest.fixture
def killed(tmp_path, monkeypatch):
    """What is said of a result at `out` after something was done to it."""
    monkeypatch.setattr(folders, "_exchange", folders._exchange)  # put back after the test
    out = kills.prepared(OVERWRITES._replace(overwrites=False), tmp_path)
    whole = []
    for result in (kills.NEW, kills.OLD):
        assert kills.save(result, out) == ()
        whole.insert(0, kills.content(out))

    def killed(case=OVERWRITES):
        return kills.complaint(case, out, *whole)

    killed.out = out
    return killed


def test_a_whole_result_is_all_right(killed):
    assert killed() == ""
    assert kills.content(killed.out)["report.html"] == b"new"


def test_what_is_lost_is_seen(killed, monkeypatch):
    out = killed.out
    hidden = out.with_name(".out.rakelight-01234567.old")
    out.rename(hidden)
    assert killed() == "the folder is missing"
    two_renames = OVERWRITES._replace(exchanges=False)
    with monkeypatch.context() as patch:
        patch.setattr(folders, "_moved_aside", lambda _: None)
        with pytest.raises(InputError, match="no report here"):
            killed(two_renames)
    assert killed(two_renames) == ""
    (out / "depth.png").unlink()
    assert killed() == "the folder is neither the old nor the new result"


def test_what_is_changed_beside_it_is_seen(killed):
    (killed.out.parent / "thesis.docx").write_text("y")
    assert killed() == "thesis.docx, which is somebody else's, was changed"


def test_litter_is_seen(killed, monkeypatch):
    monkeypatch.setattr(folders, "_delete_older", lambda *_: ())
    assert killed().startswith("the next run leaves .out.rakelight-")
