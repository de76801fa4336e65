"""A small capture folder, and the browser of the reports' tests."""

import shutil

import pytest

from rakelight.capture import write_capture
from tests.cli.cli_helpers import small_scene
from tests.report.conftest import browser, launch  # noqa: F401 - fixtures


@pytest.fixture(scope="session")
def pristine(tmp_path_factory):
    """A capture without its truth: 24 x 18 pixels under four lights."""
    folder = tmp_path_factory.mktemp("pristine") / "capture"
    scene, _ = small_scene(photographs=4)
    write_capture(scene, folder, depth_scale=10_000)
    return folder


@pytest.fixture
def capture(pristine, tmp_path):
    """A capture folder of the test's own."""
    return shutil.copytree(pristine, tmp_path / "captures" / "coin")
