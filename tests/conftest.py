"""The scene of a test module, rendered and refined once.

A module says which: `make_scene()` gives a capture and its truth, `run(capture)` the result.
"""

import sys
from contextlib import ExitStack

import pytest
from hypothesis import settings

from rakelight.jit import limited_threads

# The same examples at every run: a red run of `make test` is due to the change.  `make fuzz` tries
# fresh ones (--hypothesis-profile=default).
settings.register_profile("same", derandomize=True)
settings.load_profile("same")


def pytest_configure(config):
    """Files that run side by side (pytest -n) use a core each, or they wait for each other."""
    if hasattr(config, "workerinput"):
        stack = ExitStack()
        stack.enter_context(limited_threads(1))
        config.add_cleanup(stack.close)


@pytest.fixture
def deleted_working_directory(tmp_path, monkeypatch):
    """Be in a folder that was deleted."""
    if sys.platform == "win32":
        pytest.skip("nobody can delete it there")
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()


@pytest.fixture(scope="module")
def scene(request):
    return request.module.make_scene()


@pytest.fixture(scope="module")
def capture(scene):
    return scene[0]


@pytest.fixture(scope="module")
def result(request, capture):
    return request.module.run(capture)
