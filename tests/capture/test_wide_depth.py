"""Depth cameras that see a circle: their lens model need not hold in the corners of the image."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rakelight.capture import load_capture, write_capture
from rakelight.capture.images import encode_png, encode_tiff
from rakelight.capture.readers import kinect_mkv
from rakelight.errors import CaptureError
from rakelight.geometry.camera import back_project
from rakelight.geometry.distortion import fold_px, to_rays
from rakelight.model import Camera, Capture, Distortion, RigidTransform
from rakelight.prepare.register import register
from tests.capture.capture_builder import small_capture
from tests.capture.readers.kinect_files import Take, calibration, write_mkv

# A real Azure Kinect's, by its calibration.json: cx, cy, fx, fy, k1 to k6, centre, p2, p1, radius.
# Binned to 512x512 its model folds 300 pixels from the principal point, before all four corners.
FACTS = [
    0.51296979188919067, 0.51692354679107666, 0.4927808940410614, 0.49290284514427185,
    0.54793977737426758, -0.020971370860934258, -0.0026522316038608551, 0.88967907428741455,
    0.086130209267139435, -0.013910384848713875, 0, 0, -7.2104157879948616e-5,
    2.0557534298859537e-5, 1.74,
]  # fmt: skip
k1, k2, k3, k4, k5, k6, _, _, p2, p1, _ = FACTS[4:]
WIDE = Camera(
    512, 512, 512 * FACTS[2], 512 * FACTS[3], 512 * FACTS[0] - 0.5, 512 * FACTS[1] - 0.5,
    Distortion("brown-conrady", (k1, k2, p1, p2, k3, k4, k5, k6)),
)  # fmt: skip
SMALL = WIDE.resized(32, 32)
CENTRE = RigidTransform(np.eye(3), np.zeros(3))


def circle(camera, radius):
    """(h, w) True within so many pixels, of 512, of the middle of what the camera sees."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    radius *= camera.width / 512
    return np.hypot(columns - camera.cx, rows - camera.cy) < radius


def seen(radius):
    """A capture with depth within a circle of its depth camera."""
    capture = small_capture(maps=1)
    depth_m = np.where(circle(SMALL, radius), 0.6, np.nan)[None].astype(np.float32)
    return replace(capture, depth_m=depth_m, depth_camera=SMALL, depth_to_color=CENTRE)


def from_arrays(capture):
    return Capture.from_arrays(
        capture.photographs, capture.depth_m, capture.camera, mask=capture.mask, encoding="linear",
        depth_camera=capture.depth_camera,
    )  # fmt: skip


def test_the_lens_may_fold_where_no_depth_is(tmp_path):
    assert fold_px(WIDE) == pytest.approx(300, abs=1)
    capture = seen(250)
    assert from_arrays(capture).depth_camera == SMALL
    write_capture(capture, tmp_path / "capture")
    again = load_capture(tmp_path / "capture")
    assert again.depth_camera == SMALL
    assert np.array_equal(again.depth_m, capture.depth_m, equal_nan=True)


def test_depth_beyond_the_fold_is_refused(tmp_path):
    said = r"folds inside the image .seen 19 pixels.*needed beyond all depth, which reaches 22"
    with pytest.raises(CaptureError, match=f"^depth_camera: distortion {said}"):
        from_arrays(seen(350))
    write_capture(seen(250), tmp_path / "capture")
    depth = tmp_path / "capture/depth"
    write_capture(replace(seen(350), depth_camera=None), tmp_path / "whole")
    for file in (tmp_path / "whole/depth").iterdir():
        (depth / file.name).write_bytes(file.read_bytes())
    with pytest.raises(CaptureError, match=f"'depth_intrinsics.distortion' {said}") as refused:
        load_capture(tmp_path / "capture")
    assert refused.value.source.endswith("capture.toml")
    corner = np.zeros(SMALL.shape, bool)
    corner[-1, -1] = True
    assert fold_px(SMALL, ~corner & circle(SMALL, 280)) is None
    assert fold_px(SMALL, corner) is not None


def test_a_stated_lens_that_folds_is_used_where_it_shows_all_depth(tmp_path):
    def write(radius):
        capture = seen(radius)
        for i, photograph in enumerate(capture.photographs):
            (tmp_path / f"{i}.png").write_bytes(encode_png(photograph))
        (tmp_path / "depth.tiff").write_bytes(encode_tiff(capture.depth_m[0]))
        (tmp_path / "K.txt").write_text("40 0 15.25\n0 40.5 11.75\n0 0 1\n")
        facts = {key: getattr(SMALL, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
        facts["distortion"] = list(SMALL.distortion.coefficients)
        (tmp_path / "depth_intrinsics.json").write_text(json.dumps(facts))

    write(250)
    assert load_capture(tmp_path).depth_camera == SMALL
    write(350)
    with pytest.raises(CaptureError, match=r"depth_intrinsics\.json: lens distortion folds inside"):
        load_capture(tmp_path)


def test_depth_is_registered_up_to_where_it_ends():
    camera = WIDE.resized(256, 256)
    colour = Camera(320, 240, 160.0, 160.0, 159.5, 119.5)
    x, y = to_rays(*(axis.astype(float) for axis in np.meshgrid(*[np.arange(256)] * 2)), camera)
    assert np.isnan(x[0, 0])
    assert np.isnan(back_project(np.ones(camera.shape), camera)[0, 0, :2]).all()
    plane = 0.8 / (1 - 0.1 * x + 0.2 * y)  # z = 0.8 + 0.1 X - 0.2 Y
    depth_m = np.where(circle(camera, 250), plane, np.nan)
    pose = RigidTransform(np.eye(3), np.array([0.02, 0.0, 0.0]))
    found, _ = register(depth_m, 0.001 * depth_m, camera, pose, colour)
    across, down = np.meshgrid(np.arange(320.0), np.arange(240.0))
    across, down = (across - colour.cx) / colour.fx, (down - colour.cy) / colour.fy
    want = (0.8 - 0.1 * pose.translation_m[0]) / (1 - 0.1 * across + 0.2 * down)
    there = np.isfinite(found)
    assert there[:, 8:].all()
    assert np.abs(found - want)[there].max() < 2e-4


@pytest.mark.parametrize("side", [512, 1024])
def test_a_kinects_wide_mode_is_read(tmp_path, side):
    rows, columns = np.mgrid[:side, :side]
    inside = np.hypot(rows - side / 2, columns - side / 2) < 0.49 * side
    depth = [np.where(inside, 700, 0).astype(np.uint16)]
    attached = json.dumps(calibration(depth=FACTS)).encode()
    path = write_mkv(tmp_path / "rec.mkv", Take(depth=depth, attached=attached))
    made = kinect_mkv.recording(path)
    assert made.depth_camera.shape == (side, side)
    assert fold_px(made.depth_camera) is not None
    ((_, metres),) = made.depth.walk([0])
    assert np.array_equal(np.isfinite(metres), inside)
    assert fold_px(made.depth_camera, inside) is None
