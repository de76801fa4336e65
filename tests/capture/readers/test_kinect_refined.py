"""A lamp that moves round a shape, recorded as an Azure Kinect does: what its JPEGs cost."""

import json

import numpy as np

from rakelight import MultiLight, evaluate, load_capture, refine
from rakelight.capture.from_arrays import capture_from_arrays
from rakelight.model import RigidTransform, Truth
from tests.capture.moving_lamp import head_seen_by_two_cameras
from tests.capture.readers.kinect_files import (
    DEPTH_HEIGHT,
    DEPTH_WIDTH,
    HEIGHT,
    WIDTH,
    Take,
    calibration,
    plain_lens,
    write_mkv,
)

BESIDE = RigidTransform(np.eye(3), np.array([0.02, 0.0, 0.0]))
AT, DEPTH_AT = (200, 300), (110, 90)
"""Row and column at which the scene is set into the frames."""
# What the lamp is: nothing is to be found out about it.
LAMP = MultiLight(lights="white", distance="distant")
WALL_MM = 300
"""From the object's farthest point to what stands behind it."""


def placed(images, shape, at):
    """(N, *shape, ...) frames that hold smaller ones and are black around them."""
    framed = np.zeros((len(images), *shape, *images.shape[3:]), images.dtype)
    height, width = images.shape[1:3]
    framed[:, at[0] : at[0] + height, at[1] : at[1] + width] = images
    return framed


def moved(camera, shape, at):
    """The camera of such frames."""
    return type(camera)(
        shape[1], shape[0], camera.fx, camera.fy, camera.cx + at[1], camera.cy + at[0]
    )


def test_a_recording_is_refined_as_well_as_its_frames(tmp_path):
    made, truth = head_seen_by_two_cameras(0.3, 2.5, BESIDE)
    color_shape, depth_shape = (HEIGHT, WIDTH), (DEPTH_HEIGHT, DEPTH_WIDTH)
    camera = moved(made.camera, color_shape, AT)
    depth_camera = moved(made.depth_camera, depth_shape, DEPTH_AT)
    frames = placed(made.photographs, color_shape, AT)
    values = placed(np.rint(1000 * np.nan_to_num(made.depth_m)), depth_shape, DEPTH_AT)
    values = np.where(values > 0, values, values.max() + WALL_MM).astype(np.uint16)
    facts = calibration(
        color=plain_lens(camera, 960, 1280, (0, 120)),
        depth=plain_lens(depth_camera, 512, 512, (96, 90)),
        place=BESIDE,
    )
    take = Take(color=frames, depth=values, attached=json.dumps(facts).encode())
    found = load_capture(write_mkv(tmp_path / "rec.mkv", take))
    assert np.allclose(
        (found.camera.fx, found.camera.cx, found.camera.cy), (camera.fx, camera.cx, camera.cy)
    )
    direct = capture_from_arrays(
        frames,
        (values / 1000).astype(np.float32),
        camera,
        encoding="srgb",
        depth_camera=depth_camera,
        depth_to_color=BESIDE,
    )
    depth_m = placed(np.nan_to_num(truth.depth)[None], color_shape, AT)[0]
    normals, albedo = (
        placed(each[None], color_shape, AT)[0] for each in (truth.normals, truth.albedo)
    )
    framed = Truth(np.where(depth_m > 0, depth_m, np.nan), normals, albedo)
    both = framed.mask & found.mask & direct.mask
    assert both.sum() > 0.9 * framed.mask.sum()
    scores = [evaluate(refine(each, options=LAMP), framed, both) for each in (found, direct)]
    of_recording, of_frames = [(each.depth.rmse_mm, each.normals.mae_deg) for each in scores]
    for ours, theirs in zip(of_recording, of_frames, strict=True):
        assert 0 < ours < 1.3 * theirs
