"""The scene of a test module, rendered and refined once.

A module says which: `make_scene()` gives a capture and its truth, `run(capture)` the result.
"""

import pytest


@pytest.fixture(scope="module")
def scene(request):
    return request.module.make_scene()


@pytest.fixture(scope="module")
def capture(scene):
    return scene[0]


@pytest.fixture(scope="module")
def result(request, capture):
    return request.module.run(capture)
