"""Folders of 3D Scanner App and Polycam: each is found, read exactly, refused where it lies."""

import json

import numpy as np
import pytest

from rakelight.capture import load_capture
from rakelight.capture.readers import find_reader, polycam, scanner_app
from rakelight.errors import CaptureError
from tests.capture.readers.phone_sources import (
    CAMERA,
    DEPTH_HEIGHT,
    DEPTH_WIDTH,
    FPS,
    depth_maps,
    expected,
    frames,
    png,
    write_open3d,
    write_polycam,
    write_r3d,
    write_scanner_app,
    write_tum,
)
from tests.capture.readers.test_recordings import COUNT, decoded, depth_of, images_of

READERS = {
    "3d-scanner-app": (scanner_app, write_scanner_app, "frame_00005.json"),
    "polycam": (polycam, write_polycam, f"keyframes/cameras/{293814600474 + 33000 * 5}.json"),
}
each_reader = pytest.mark.parametrize("name", READERS)


@each_reader
def test_it_is_found_and_read_exactly(tmp_path, name):
    reader, write, _ = READERS[name]
    path = write(tmp_path / "scan")
    assert find_reader(path).name == name
    recording, poses = reader.recording(path)
    for key in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(recording.camera, key) == pytest.approx(getattr(CAMERA, key))
    assert np.array_equal(images_of(recording), [decoded(image) for image in frames()])
    assert np.array_equal(depth_of(recording), expected(depth_maps(), 1000), equal_nan=True)
    assert recording.depth_camera == recording.camera.resized(DEPTH_WIDTH, DEPTH_HEIGHT)
    assert np.ptp(recording.color.times_s) == pytest.approx((COUNT - 1) / FPS, rel=0.02)
    np.testing.assert_allclose(recording.color.times_s, recording.depth.times_s)
    np.testing.assert_allclose(poses.positions_m, [[0.1, 0.2, 0.3]] * COUNT)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(poses.quaternions, [[0, 0, half, half]] * COUNT, atol=1e-9)


@each_reader
def test_a_phone_that_moved_is_told_of(tmp_path, name):
    _, write, _ = READERS[name]
    still = load_capture(write(tmp_path / "still"))
    assert "phone-moved" not in [finding.code for finding in still.findings]
    moved = load_capture(write(tmp_path / "moved", place=lambda i: (0.1 + 0.02 * i, 0.2, 0.3)))
    assert "phone-moved" in [finding.code for finding in moved.findings]


@each_reader
def test_a_frame_without_pose_or_intrinsics_is_of_no_weight(tmp_path, name):
    reader, write, facts = READERS[name]
    path = write(tmp_path / "scan")
    (path / facts).write_text('{"fx": "wide", "intrinsics": [1, null], "cameraPoseARFrame": 5}')
    recording, poses = reader.recording(path)
    assert recording.camera.fx == pytest.approx(CAMERA.fx)
    assert np.isnan(poses.positions_m[5]).all()
    assert len(recording.color) == COUNT


@each_reader
def test_damaged_files_are_named(tmp_path, name):
    reader, write, facts = READERS[name]
    path = write(tmp_path / "scan")
    (path / facts).write_text("{")
    with pytest.raises(CaptureError, match=r"\.json: not JSON"):
        reader.recording(path)
    for each in path.rglob("*.json"):
        each.write_text('{"cameraPoseARFrame": [], "t_00": 1}')
    with pytest.raises(CaptureError, match="no frame states its intrinsics"):
        reader.recording(path)


def test_photographs_of_some_frames_are_those_of_their_numbers(tmp_path):
    path = write_scanner_app(tmp_path / "scan", every=4)
    recording, poses = scanner_app.recording(path)
    assert recording.names == ("frame_00000.jpg", "frame_00004.jpg", "frame_00008.jpg")
    assert (len(recording.depth), len(poses.positions_m)) == (COUNT, 3)
    assert np.allclose(np.diff(recording.color.times_s), 4 / FPS)


def test_a_scan_that_was_broken_off_is_read_as_far_as_it_goes(tmp_path):
    path = write_scanner_app(tmp_path / "scan")
    (path / "frame_00011.jpg").write_bytes(b"")
    (path / "frame_00010.json").unlink()
    recording, _ = scanner_app.recording(path)
    assert len(recording.color) == COUNT - 2
    assert len(recording.depth) == COUNT - 1
    for each in path.glob("frame_*.json"):
        if each.name != "frame_00011.json":
            each.unlink()
    with pytest.raises(CaptureError, match="no photograph, or no depth, whose frame has its JSON"):
        scanner_app.recording(path)


def test_photographs_and_depth_of_others_are_not_taken_for_the_app_s(tmp_path):
    path = write_scanner_app(tmp_path / "scan")
    for each in path.glob("frame_*.json"):
        each.write_text(json.dumps({"K": CAMERA.matrix.ravel().tolist()}))
    assert find_reader(path).name == "photographs"


def test_polycam_s_cameras_of_another_size_and_further_files(tmp_path):
    path = write_polycam(tmp_path / "scan", half=True)
    (path / "keyframes/depth/293814600474.Clean.png").write_bytes(png(np.ones((4, 4), np.uint8)))
    for place in (path, path / "keyframes"):
        assert find_reader(place).name == "polycam"
        recording, _ = polycam.recording(place)
        assert recording.camera.fx == pytest.approx(CAMERA.fx)
        assert recording.camera.cx == pytest.approx(CAMERA.cx)
        assert len(recording.depth) == COUNT


def test_polycam_s_images_without_their_cameras(tmp_path):
    path = write_polycam(tmp_path / "scan")
    for each in (path / "keyframes/images").iterdir():
        each.rename(each.with_name(f"1{each.name}"))
    with pytest.raises(CaptureError, match="no image has a camera of its number"):
        polycam.recording(path)


@pytest.mark.parametrize("write", [write_scanner_app, write_polycam, write_open3d, write_tum])
def test_a_mask_in_the_folder_of_a_recording_is_read(tmp_path, write):
    path = write(tmp_path / "scan")
    (unmasked,) = [f for f in load_capture(path).findings if f.code == "no-mask"]
    assert "save it as mask.png" in unmasked.remedy
    mask = np.zeros(CAMERA.shape, bool)
    mask[30:60, 40:80] = True
    (path / "mask.png").write_bytes(png(mask.astype(np.uint8) * 255))
    capture = load_capture(path)
    np.testing.assert_array_equal(capture.mask, mask)
    assert "no-mask" not in [finding.code for finding in capture.findings]
    linked = load_capture(path).mask
    (path / "._mask.png").write_bytes(b"\0\5\26\7")  # what macOS puts beside it on other disks
    assert "ignored-files" not in [f.code for f in load_capture(path).findings]
    (path / "mask.png").rename(path / "drawn.png")
    (path / "mask.png").symlink_to("drawn.png")
    np.testing.assert_array_equal(load_capture(path).mask, linked)
    (path / "drawn.png").rename(tmp_path / "drawn.png")
    (path / "mask.png").unlink()
    (path / "mask.png").symlink_to(tmp_path / "drawn.png")
    with pytest.raises(CaptureError, match="a file outside the folder"):
        load_capture(path)
    (path / "mask.png").unlink()
    (path / "mask.png").write_bytes(png(mask[1:].astype(np.uint8)))
    with pytest.raises(CaptureError, match=r"mask\.png: the mask has another size"):
        load_capture(path)


def test_a_recording_in_one_file_is_to_be_imported_first(tmp_path):
    path = write_r3d(tmp_path / "a.r3d")
    (unmasked,) = [f for f in load_capture(path).findings if f.code == "no-mask"]
    assert "`rakelight import` it" in unmasked.remedy
