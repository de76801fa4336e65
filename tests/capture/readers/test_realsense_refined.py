"""A lamp that moves round a shape, recorded and refined: nothing is lost on the way."""

import numpy as np

from rakelight import MultiLight, evaluate, load_capture, refine
from rakelight.capture.from_arrays import capture_from_arrays
from rakelight.model import RigidTransform
from tests.capture.moving_lamp import head_seen_by_two_cameras
from tests.capture.readers.realsense_files import Take, write_db3

BESIDE = RigidTransform(np.eye(3), np.array([0.015, 0.0, 0.0]))
UNIT_M = 0.001
# What the lamp is: nothing is to be found out about it.
LAMP = MultiLight(lights="white", distance="distant")


def recorded(path, capture):
    depth = np.rint(np.nan_to_num(capture.depth_m) / UNIT_M).astype(np.uint16)
    take = Take(
        color=list(capture.photographs),
        depth=list(depth),
        camera=capture.camera,
        depth_camera=capture.depth_camera,
        depth_to_color=capture.depth_to_color,
        unit_m=UNIT_M,
    )
    write_db3(path, take)


def test_a_recording_is_refined_as_well_as_its_frames(tmp_path):
    capture, truth = head_seen_by_two_cameras(0.15, 1.5, BESIDE)
    recorded(tmp_path / "rec.db3", capture)
    found = load_capture(tmp_path / "rec.db3")
    direct = capture_from_arrays(
        capture.photographs,
        capture.depth_m,
        capture.camera,
        encoding="srgb",
        depth_camera=capture.depth_camera,
        depth_to_color=capture.depth_to_color,
    )
    both = truth.mask & found.mask & direct.mask
    assert both.sum() > 0.9 * truth.mask.sum()
    scores = [evaluate(refine(each, options=LAMP), truth, both) for each in (found, direct)]
    of_recording, of_frames = [(each.depth.rmse_mm, each.normals.mae_deg) for each in scores]
    for ours, theirs in zip(of_recording, of_frames, strict=True):
        assert 0 < ours < 1.3 * theirs
