"""The loops of the knitted monkey are in its photograph and in its relief, everywhere."""

import numpy as np
import pytest

from rakelight.capture import load_capture
from tests.quality.loops import MONKEY, loops

pytestmark = pytest.mark.skipif(
    not MONKEY.exists(), reason="the capture is not part of the project"
)


@pytest.fixture(scope="module")
def parts():
    return loops(load_capture(MONKEY))


def test_the_photograph_shows_loops_above_its_noise_in_every_part(parts):
    assert min(part.contrast / part.noise for part in parts.values()) > 3


def test_the_relief_follows_them_in_every_part(parts):
    assert min(part.follows for part in parts.values()) > 0.3
    assert np.median([part.follows for part in parts.values()]) > 0.6
    heights = [part.height_mm for part in parts.values()]
    assert min(heights) > 0.05
    assert max(heights) < 0.3
