"""What the way through a phone's files costs a result, against the same frames without it."""

from dataclasses import replace

import pytest

from rakelight import evaluate, refine
from rakelight.capture import load_capture
from rakelight.model import Capture
from tests.capture.readers.phone_sources import (
    CAMERA,
    depth_maps,
    expected,
    frames,
    scene,
    write_r3d,
    write_stray,
)


def errors(capture):
    """(mm, degrees) of the refined capture, on the object's true mask."""
    truth = scene()[1]
    scores = evaluate(refine(replace(capture, mask=truth.mask)), truth)
    return scores.depth.rmse_mm, scores.normals.mae_deg


@pytest.fixture(scope="module")
def direct():
    made = scene()[0]
    return errors(
        Capture.from_arrays(
            frames(), expected(depth_maps()), CAMERA, mask=made.mask, encoding="srgb",
            depth_camera=made.depth_camera, depth_to_color=made.depth_to_color,
        )
    )  # fmt: skip


def test_r3d_costs_what_its_jpegs_cost(tmp_path, direct):
    through = errors(load_capture(write_r3d(tmp_path / "a.r3d")))
    assert through[0] < direct[0] + 0.4  # measured: 0.31 mm of 6.6
    assert through[1] < direct[1] + 1.0  # measured: 0.4 degrees of 10.6


def test_video_costs_what_its_blocks_cost(tmp_path, direct):
    through = errors(load_capture(write_stray(tmp_path / "scan", crf=18)))
    assert through[0] < direct[0] + 0.6
    assert through[1] < direct[1] + 3.5
