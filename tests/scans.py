"""Laser scans as truth.  They lie beside the project, and are not part of it."""

from pathlib import Path

import pytest

SCANS = sorted((Path(__file__).resolve().parents[2] / "shared" / "shapes").glob("*.npz"))
NO_SCANS = pytest.mark.skip(reason="no scans in ../shared/shapes")


def for_every_scan(case=lambda path: path):
    """Parameters, `case(path)` of every scan; without scans one that is skipped and says why."""
    return [pytest.param(case(path), id=path.stem) for path in SCANS] or [
        pytest.param(None, id="no scans", marks=NO_SCANS)
    ]
