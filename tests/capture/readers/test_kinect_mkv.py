"""Recordings of an Azure Kinect: cameras as its SDK has them, frames as they were, one clock."""

import json
import re

import cv2
import numpy as np
import pytest

from rakelight.capture.readers import find_reader, kinect_mkv
from rakelight.capture.readers.kinect_calibration import (
    COLOR,
    DEPTH,
    color_camera,
    depth_camera,
    listed_cameras,
)
from rakelight.errors import CaptureError
from rakelight.geometry.distortion import to_pixels
from rakelight.model import RigidTransform
from tests.capture.readers.kinect_files import (
    COLOR_LENS,
    DEPTH_LENS,
    FORMS,
    FPS,
    TILTED,
    Take,
    calibration,
    listed_camera,
    some_color,
    some_depth,
    write_mkv,
)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return write_mkv(tmp_path_factory.mktemp("kinect") / "rec.mkv")


def cameras(facts):
    return listed_cameras(json.dumps(facts).encode(), "calibration.json")


def test_cameras_are_those_of_the_sdk():
    """What Microsoft's SDK printed of the device whose numbers these are (1080p, NFOV unbinned).

    From github.com/panispani/3DReconstruct, pointCloudGen/calib.md.
    """
    found = cameras(calibration())
    color = color_camera(found[COLOR], (1080, 1920), "c")
    seen = (color.fx, color.fy, color.cx, color.cy)
    assert np.allclose(seen, (904.141541, 903.521362, 953.284424, 555.142456), rtol=0, atol=1e-4)
    lens = (0.722746, -2.885590, 0.000783, -0.000143, 1.632723, 0.602199, -2.719626, 1.565053)
    assert np.allclose(color.distortion.coefficients, lens, rtol=0, atol=1e-6)
    depth = depth_camera(found[DEPTH], (576, 640), "c")
    seen = (depth.fx, depth.fy, depth.cx, depth.cy)
    assert np.allclose(seen, (503.927643, 503.978729, 332.064270, 325.880615), rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("shape", "binned", "row"),
    [((720, 1280), 3.2, 120), ((1440, 2560), 1.6, 240), ((1536, 2048), 2, 0), ((3072, 4096), 1, 0)],
)
def test_every_colour_mode_shows_its_part_of_the_sensor(shape, binned, row):
    """Pixel by pixel: the same ray hits the same place of the sensor."""
    found = cameras(calibration())
    camera, whole = (color_camera(found[COLOR], each, "c") for each in (shape, (3072, 4096)))
    rays = np.array([-0.3, 0.0, 0.4]), np.array([0.2, -0.1, 0.25])
    (u, v), (u0, v0) = to_pixels(*rays, camera), to_pixels(*rays, whole)
    assert np.allclose(u, (u0 + 0.5) / binned - 0.5)
    assert np.allclose(v, (v0 + 0.5) / binned - 0.5 - row)


@pytest.mark.parametrize(
    ("shape", "binned", "corner"),
    [((288, 320), 2, (192, 180)), ((512, 512), 2, (0, 0)), ((576, 640), 1, (192, 180))],
)
def test_every_depth_mode_shows_its_part_of_the_sensor(shape, binned, corner):
    found = cameras(calibration())
    camera, whole = (depth_camera(found[DEPTH], each, "c") for each in (shape, (1024, 1024)))
    rays = np.array([-0.3, 0.0, 0.4]), np.array([0.2, -0.1, 0.25])
    (u, v), (u0, v0) = to_pixels(*rays, camera), to_pixels(*rays, whole)
    assert np.allclose(u, (u0 - corner[0] + 0.5) / binned - 0.5)
    assert np.allclose(v, (v0 - corner[1] + 0.5) / binned - 0.5)


def test_an_old_calibration_is_of_the_middle_of_the_sensor():
    """16:9: its rows are the middle 2304 of 3072."""
    lens = list(COLOR_LENS)
    lens[1], lens[3] = (lens[1] * 3072 - 384) / 2304, lens[3] * 3072 / 2304
    old = cameras(calibration(color=lens, sensor=(4096, 2304)))
    new = cameras(calibration())
    for shape in ((720, 1280), (1536, 2048)):
        a, b = (color_camera(each[COLOR], shape, "c") for each in (old, new))
        assert np.allclose((a.fx, a.fy, a.cx, a.cy), (b.fx, b.fy, b.cx, b.cy))


def test_the_lens_is_opencvs_rational_model():
    """The order of the two tangential coefficients is the other way round in the file."""
    lens = list(DEPTH_LENS)
    lens[12], lens[13] = 0.002, -0.003
    camera = depth_camera(cameras(calibration(depth=lens))[DEPTH], (576, 640), "c")
    points = np.array([[-0.4, 0.2, 1.0], [0.3, 0.35, 1.0], [0.1, -0.3, 1.0]])
    opencv = np.array([lens[4], lens[5], -0.003, 0.002, *lens[6:10]])
    there, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, opencv)
    u, v = to_pixels(points[:, 0], points[:, 1], camera)
    assert np.allclose(np.stack([u, v], -1), there[:, 0], rtol=0, atol=1e-6)


def test_it_is_found_by_its_content(sound, tmp_path):
    assert find_reader(sound).name == "azure-kinect"
    other = tmp_path / "a.mkv"
    other.write_bytes(b"\x1aE\xdf\xa3\x9f\x42\x82\x84webm")
    assert not kinect_mkv.sniff(other)


@pytest.mark.parametrize("form", FORMS)
def test_frames_are_those_that_were_recorded(tmp_path, form):
    made = kinect_mkv.recording(write_mkv(tmp_path / "a.mkv", Take(form=form)))
    seen = dict(made.color.walk([0, 2]))
    assert list(seen) == [0, 2]
    off = np.abs(seen[2].astype(int) - some_color()[2])
    assert off.mean() < (0 if form == "BGRA" else 1.5) + 1e-9
    assert off.max() <= (0 if form == "BGRA" else 10)
    assert [finding.code for finding in made.findings] == ["compressed"] * (form == "MJPG")


def test_depth_is_metres_on_the_clock_of_colour(sound):
    made = kinect_mkv.recording(sound)
    stored = some_depth()
    for number, metres in made.depth.walk(range(3)):
        values = stored[number]
        assert metres.dtype == np.float32
        assert np.array_equal(np.isnan(metres), values == 0)
        assert np.allclose(metres[values > 0], values[values > 0] / 1000, rtol=1e-6)
    for stream in (made.color, made.depth):
        assert np.allclose(stream.times_s, np.arange(3) / FPS, atol=1e-3)


# How the entries of the index, with their tracks from 1, are changed.
INDICES = {
    "of every track": {},
    "of colour, as k4arecorder writes it": {2: 9, 3: 9},
    "of nothing": {1: 9, 2: 9, 3: 9},
    "of the wrong tracks": {1: 2, 2: 1},
}


@pytest.mark.parametrize("index", INDICES)
def test_far_frames_are_those_that_are_asked_for(tmp_path, index):
    depth = some_depth(50)
    path = write_mkv(tmp_path / "a.mkv", Take(color=[*some_color(1)] * 50, depth=depth))
    data = path.read_bytes()
    start = data.rindex(b"\x1c\x53\xbb\x6b")
    tracks = {b"\xf7\x81" + bytes([a]): b"\xf7\x81" + bytes([b]) for a, b in INDICES[index].items()}
    changed = re.sub(rb"\xf7\x81.", lambda each: tracks.get(each[0], each[0]), data[start:])
    path.write_bytes(data[:start] + changed)
    made = kinect_mkv.recording(path)
    for wanted in ([49], [0, 20, 21, 48], range(0, 50, 17)):
        seen = [(i, round(1000 * float(metres[200, 10]))) for i, metres in made.depth.walk(wanted)]
        assert seen == [(i, int(depth[i, 200, 10])) for i in wanted]
        assert [i for i, _ in made.color.walk(wanted)] == list(wanted)


def test_the_depth_camera_stands_where_the_file_says(tmp_path):
    """Both places are relative to the device."""
    turn = np.array([[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]])
    of_depth = RigidTransform(turn, np.array([0.1, 0.2, 0.3]))
    facts = calibration(place=TILTED, depth_place=of_depth)
    take = Take(color=some_color(1), depth=some_depth(1), attached=json.dumps(facts).encode())
    found = kinect_mkv.recording(write_mkv(tmp_path / "a.mkv", take)).depth_to_color
    point = np.array([0.3, -0.1, 0.9])
    in_depth = turn @ point + of_depth.translation_m
    in_color = TILTED.rotation @ point + TILTED.translation_m
    assert np.allclose(found.rotation @ in_depth + found.translation_m, in_color)


def changed(**changes):
    """calibration.json with one thing changed."""
    return json.dumps(calibration(**changes)).encode()


def without(key):
    facts = calibration()
    del facts["CalibrationInformation"]["Cameras"][0][key]
    return json.dumps(facts).encode()


WRONG = {
    "the calibration of the cameras is not in it": Take(attached=None),
    "not JSON": Take(attached=b"<html>"),
    "CalibrationInformation is missing": Take(attached=b"{}"),
    "Rt of CALIBRATION_CameraLocationD0 is missing": Take(attached=without("Rt")),
    "no camera CALIBRATION_CameraLocationD0 in it": Take(attached=without("Location")),
    "the size of the sensor CALIBRATION_CameraLocationD0 is not known": Take(
        attached=without("SensorWidth")
    ),
    "the lens of CALIBRATION_CameraLocationPV0 is incomplete": Take(
        attached=changed(color=[0.5] * 8)
    ),
    "unknown model of lens distortion.*0.1": Take(
        attached=changed(color=[*COLOR_LENS[:10], 0.1, *COLOR_LENS[11:]])
    ),
    "the colour sensor has other proportions": Take(attached=changed(sensor=(3000, 3000))),
    "the place of CALIBRATION_CameraLocationPV0 is no rigid motion": Take(
        attached=changed(place=RigidTransform(2 * np.eye(3), np.zeros(3)))
    ),
    "an unknown mode of the colour camera": Take(color=some_color(1)[:, :700]),
    "frames of 1280x960, needed 1280x720.*Fix: record with one": Take(
        color=np.zeros((1, 960, 1280, 3), np.uint8)
    ),
    "an unknown mode of the depth camera": Take(depth=some_depth(1)[:, :200]),
    "no track of colour": Take(titles=("video", "DEPTH", "IR")),
    "no track of depth": Take(titles=("COLOR", "D", "IR")),
    "more than one track of depth": Take(titles=("COLOR", "DEPTH", "DEPTH")),
    "this kind of depth is not read": Take(depth_form="YUY2"),
    "no colour frames in it": Take(color=[]),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_missing_is_said(tmp_path, what):
    with pytest.raises(CaptureError, match=what):
        kinect_mkv.recording(write_mkv(tmp_path / "a.mkv", WRONG[what]))


def test_another_model_of_the_lens_is_refused():
    model = "CALIBRATION_LensDistortionModelRational6KT"
    facts = listed_camera(COLOR, COLOR_LENS, (4096, 3072), model=model)
    with pytest.raises(CaptureError, match=r"unknown model of lens distortion.*Rational6KT"):
        color_camera(facts, (720, 1280), "c")
