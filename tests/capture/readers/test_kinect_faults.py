"""Damaged recordings of an Azure Kinect are read, or refused in one line."""

from collections import Counter
from random import Random

import pytest

from rakelight.capture.readers import kinect_mkv
from rakelight.errors import CaptureError
from tests.capture.readers.kinect_files import Take, some_color, some_depth, write_mkv
from tests.faults.fuzz import tried
from tests.faults.mutations import mutated

HEADERS = 2400
"""Bytes of all that is no frame: tracks, attachments, tags, the first cluster's header."""


def read_all(path):
    made = kinect_mkv.recording(path)
    for stream in (made.color, made.depth):
        for _ in stream.walk(range(len(stream))):
            pass


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    path = tmp_path_factory.mktemp("kinect") / "rec.mkv"
    return write_mkv(path, Take(color=some_color(2), depth=some_depth(2))).read_bytes()


@pytest.mark.parametrize("part", [HEADERS, None])
def test_every_damaged_recording_is_read_or_refused(tmp_path, sound, part):
    path, random = tmp_path / "rec.mkv", Random(str(part))
    outcomes = Counter()
    for _ in range(60):
        path.write_bytes(mutated(random, sound[:part], sound) + sound[len(sound[:part]) :])
        outcomes[tried(lambda: read_all(path))] += 1
    assert set(outcomes) == {"read", "refused"}
    assert list(tmp_path.iterdir()) == [path]


def test_a_recording_that_was_cut_off_is_read_up_to_there(tmp_path, sound):
    """Its frames are found without the index at its end."""
    path = tmp_path / "rec.mkv"
    path.write_bytes(sound[: len(sound) - len(sound) // 4])
    made = kinect_mkv.recording(path)
    assert len(made.depth) < 2 or len(made.color) == 2
    read_all(path)


@pytest.mark.parametrize("count", [3, 40, 300, 900])
def test_what_has_no_frames_is_refused(tmp_path, sound, count):
    path = tmp_path / "rec.mkv"
    path.write_bytes(sound[:count])
    with pytest.raises(CaptureError):
        kinect_mkv.recording(path)
