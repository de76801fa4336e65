"""Intrinsics in the files of other programs, as these write them."""

import json
from dataclasses import replace

import pytest

from rakelight.capture.intrinsics import MAX_BYTES, named_intrinsics, parse_intrinsics
from rakelight.errors import CaptureError
from rakelight.model import Camera, Distortion

PINHOLE = Camera(320, 240, 225.0, 226.0, 160.0, 120.0)
NO_SIZE = Camera(0, 0, 225.0, 226.0, 160.0, 120.0)
K = [[225.0, 0.0, 160.0], [0.0, 226.0, 120.0], [0.0, 0.0, 1.0]]
ROWS = [225, 0, 160, 0, 226, 120, 0, 0, 1]
COLUMNS = [225, 0, 0, 0, 226, 0, 160, 120, 1]
SIZE = {"width": 320, "height": 240}
FIGURES = {"fx": 225, "fy": 226, "cx": 160, "cy": 120}


def lens(*coefficients):
    return Distortion("brown-conrady", coefficients)


@pytest.mark.parametrize(
    ("text", "camera", "distortion"),
    [
        ("225 226 160 120", NO_SIZE, None),
        ("225 226 160 120 0.1 0 0 0.01", NO_SIZE, lens(0.1, 0, 0, 0.01)),
        ("225 0 160 0\n0 226 120 0\n0 0 1 0\n0 0 0 1\n", NO_SIZE, None),
        (json.dumps({**FIGURES, **SIZE}), PINHOLE, None),
        (json.dumps({"K": ROWS, **SIZE}), PINHOLE, None),
        (json.dumps({"intrinsic_matrix": COLUMNS, **SIZE}), PINHOLE, None),
        (json.dumps({"intrinsic": {"intrinsic_matrix": COLUMNS, **SIZE}}), PINHOLE, None),
        (json.dumps({"color": FIGURES, "depth": {**FIGURES, "fx": 200}}), NO_SIZE, None),
        (json.dumps({**FIGURES, "distortion": {"k1": 0.1}}), NO_SIZE, lens(0.1, *(0,) * 7)),
        ("# mm\nfx = 225\nfy=226  # px\ncx = 160.0\ncy = 120\n", NO_SIZE, None),
        ("\n".join(f"{k},{v}" for k, v in {**FIGURES, **SIZE}.items()), PINHOLE, None),
        ("fx,fy,cx,cy,width,height\n225,226,160,120,320,240\n", PINHOLE, None),
        ("[ 320x240  p[160 120]  f[225 226]  Inverse Brown Conrady [0 0 0 0 0] ]", PINHOLE, None),
        ("[ 320x240  p[160 120]  f[225 226]  Brown Conrady [0.1 0 0 0 0] ]", PINHOLE,
         lens(0.1, 0, 0, 0, 0)),
    ],
    ids=[
        "four", "eight", "ScanNet", "names", "rows", "columns", "Open3D's nested", "two cameras",
        "nested distortion", "lines", "lines of CSV", "a row of names", "librealsense prints",
        "librealsense prints a lens",
    ],
)  # fmt: skip
def test_numbers_and_tables(text, camera, distortion):
    found = parse_intrinsics(text.encode(), "camera.txt", named=True)
    assert found == replace(camera, distortion=distortion)


ROS_PRINTS = """\
height: 240
width: 320
distortion_model: "plumb_bob"
D: [0.1, 0.0, 0.0, 0.0, 0.0]
K: [225, 0, 160, 0, 226, 120, 0, 0, 1]
R: [1, 0, 0, 0, 1, 0, 0, 0, 1]
P: [225, 0, 160, 0, 0, 226, 120, 0, 0, 0, 1, 0]
---
height: 240
"""
ROS_SAVES = """\
image_width: 320
image_height: 240
camera_matrix:
  rows: 3
  cols: 3
  data: [225, 0, 160, 0, 226, 120, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.1, 0, 0, 0, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
"""
KALIBR = """\
cam0:
  camera_model: pinhole
  distortion_coeffs: [0.1, 0, 0, 0]
  distortion_model: radtan
  intrinsics: [225, 226, 160, 120]
  resolution: [320, 240]
"""
ORB_SLAM = """\
%YAML:1.0

Camera.type: "PinHole"
Camera.fx: 225.0
Camera.fy: 226.0
Camera.cx: 160.0
Camera.cy: 120.0
Camera.k1: 0.1
Camera.k2: 0.0
Camera.width: 320
Camera.height: 240
DepthMapFactor: 1000.0
"""
NERFSTUDIO = json.dumps(
    {"fl_x": 225, "fl_y": 226, "cx": 160.5, "cy": 120.5, "w": 320, "h": 240, "k1": 0.1,
     "camera_model": "OPENCV", "frames": [{"file_path": "0.jpg", "transform_matrix": K}]}
)  # fmt: skip
PYYAML = """\
camera_matrix:
- - 225.0
  - 0.0
  - 160.0
- - 0.0
  - 226.0
  - 120.0
- - 0.0
  - 0.0
  - 1.0
dist_coeff:
- - 0.1
  - 0.0
  - 0.0
  - 0.0
"""


@pytest.mark.parametrize(
    ("text", "size"),
    [
        (ROS_PRINTS, 320), (ROS_SAVES, 320), (KALIBR, 320), (ORB_SLAM, 320), (NERFSTUDIO, 320),
        (PYYAML, 0),
    ],
    ids=["ROS prints", "ROS saves", "Kalibr", "ORB-SLAM", "nerfstudio", "PyYAML"],
)  # fmt: skip
def test_programs_with_a_lens(text, size):
    found = parse_intrinsics(text.encode(), "camera.txt")
    assert replace(found, distortion=None) == (PINHOLE if size else NO_SIZE)
    first, *others = found.distortion.coefficients
    assert (found.distortion.model, first, set(others)) == ("brown-conrady", 0.1, {0.0})


def test_fisheye_is_told_from_the_others():
    text = KALIBR.replace("radtan", "equidistant")
    assert parse_intrinsics(text.encode()).distortion.model == "kannala-brandt"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (json.dumps({**FIGURES, "model": "inverse_brown_conrady", "coeffs": [0.1, 0, 0, 0, 0]}),
         "this model of distortion is not read"),
        (json.dumps({"cam0": FIGURES, "cam1": {**FIGURES, "fy": 227}}), "several camera matrices"),
        (ROS_SAVES.replace("data: [225,", "data: ["), "damaged"),
        ("500 1 320 0 500 240 0 0 1", "skew"),
        ("[ 320x240  p[160 120]  f[225 226]  Inverse Brown Conrady [0.1 0 0 0 0] ]",
         "this model of distortion is not read"),
    ],
)  # fmt: skip
def test_what_is_refused(text, says):
    with pytest.raises(CaptureError, match=says):
        parse_intrinsics(text.encode(), "camera.txt", named=True)


@pytest.mark.parametrize(
    "text",
    [
        "225 226 160 120",  # any four numbers
        "fx: &f 225\nfy: *f\ncx: 160\ncy: 120\n",  # an alias is not followed
        "a: !!python/object/apply:os.getcwd []\nK: [225, 0, 160, 0, 226, 120, 0, 0, 1]\n",
        "[" * 5000,
        "distances: [0.1, 0.2, 0.3, 0.4]",
        "- K\n- D\n",
        "frames 225\nlamp = 3\n",
        " " * (MAX_BYTES + 1),
    ],
    ids=[
        "numbers",
        "alias",
        "object",
        "nested",
        "another list",
        "no table",
        "pairs of others",
        "large",
    ],
)
def test_what_is_no_such_file(text):
    assert parse_intrinsics(text.encode(), "notes.txt") is None


def test_names_that_say_so():
    assert all(map(named_intrinsics, ("K", "camera_info", "calibration_matrix", "Intrinsic-1")))
    assert not any(map(named_intrinsics, ("kinect", "poses", "lights")))
