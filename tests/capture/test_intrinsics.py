"""Intrinsics in the files of other programs, as these write them."""

import json
from dataclasses import replace

import pytest

from rakelight.capture.extrinsics import depth_to_color
from rakelight.capture.intrinsics import (
    MAX_BYTES,
    parse_depth_intrinsics,
    parse_intrinsics,
    parse_lens,
)
from rakelight.capture.intrinsics.names import named_intrinsics
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


METASHAPE = """\
<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>frame</projection>
  <width>320</width>
  <height>240</height>
  <f>226</f>
  <cx>0.5</cx>
  <cy>0.5</cy>
  <b1>-1</b1>
  <k1>0.1</k1>
  <p1>0.003</p1>
  <p2>0.002</p2>
  <date>2026-11-14T23:30:12Z</date>
</calibration>
"""
CAMERAS_XML = """\
<document version="1.5.0"><chunk><sensors><sensor id="0" type="frame">
<resolution width="320" height="240"/>
<calibration type="frame" class="initial">
  <resolution width="320" height="240"/><f>200</f></calibration>
<calibration type="frame" class="adjusted">
  <resolution width="320" height="240"/>
  <f>226</f><cx>0.5</cx><cy>0.5</cy><b1>-1</b1><k1>0.1</k1><p1>0.003</p1><p2>0.002</p2>
</calibration></sensor></sensors>
<cameras><camera id="0"><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera></cameras>
</chunk></document>
"""
MATLAB = {
    "ImageSize": [240, 320], "RadialDistortion": [0.1, 0], "TangentialDistortion": [0.002, 0.003],
    "FocalLength": [225, 226], "PrincipalPoint": [161, 121], "Skew": 0,
    "IntrinsicMatrix": [[225, 0, 0], [0, 226, 0], [161, 121, 1]],
}  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [METASHAPE, CAMERAS_XML, json.dumps(MATLAB), json.dumps({"cameraParams": MATLAB})],
    ids=["Metashape", "its cameras", "MATLAB", "MATLAB's variable"],
)
def test_programs_whose_first_pixel_is_elsewhere(text):
    """Metashape's has its centre at (0.5, 0.5) and exchanges p1 and p2, MATLAB's at (1, 1)."""
    found = parse_intrinsics(text.encode(), "camera.xml")
    assert replace(found, distortion=None) == PINHOLE
    assert found.distortion == lens(0.1, 0, 0.002, 0.003, 0, 0, 0, 0)


def test_the_transposed_matrix_of_matlab_alone():
    text = json.dumps({"IntrinsicMatrix": MATLAB["IntrinsicMatrix"]})
    assert parse_intrinsics(text.encode()) == NO_SIZE


KITTI = """\
P0: 220 0 150 0 0 220 110 0 0 0 1 0
P1: 220 0 150 -380 0 220 110 0 0 0 1 0
P2: 2.25e+02 0 160 45 0 226 120 0.2 0 0 1 0.003
P3: 2.25e+02 0 160 -340 0 226 120 2.2 0 0 1 0.003
R0_rect: 1 0 0 0 1 0 0 0 1
Tr_velo_to_cam: 0 -1 0 0 0 0 -1 0 1 0 0 0
"""
SCANNET = """\
axisAlignment = 0.9 0.2 0 1 -0.2 0.9 0 2 0 0 1 0 0 0 0 1
colorHeight = 240
colorToDepthExtrinsics = 1 0 0 -0.03 0 1 0 0 0 0 1 0 0 0 0 1
colorWidth = 320
depthHeight = 120
depthWidth = 160
fx_color = 225
fx_depth = 110
fy_color = 226
fy_depth = 111
mx_color = 160
mx_depth = 80
my_color = 120
my_depth = 60
sceneType = Apartment
"""


@pytest.mark.parametrize(
    ("text", "camera"),
    [
        (KITTI, NO_SIZE),
        (KITTI.partition("P2")[1] + KITTI.partition("P2")[2], NO_SIZE),
        (SCANNET, PINHOLE),
        ("\n".join(f"{key}_color = {value}" for key, value in FIGURES.items()), NO_SIZE),
        ("K: 225 0 160 0 226 120 0 0 1\nD: 0.1 0 0 0 0",
         replace(NO_SIZE, distortion=lens(0.1, 0, 0, 0, 0))),
    ],
    ids=["KITTI", "KITTI's P2", "ScanNet", "fx_color", "a matrix in a line"],
)  # fmt: skip
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_lines_of_other_programs(text, camera, encoding):
    assert parse_intrinsics(text.replace("\n", "\r\n").encode(encoding)) == camera


def test_a_number_of_6000_digits_is_no_bug_of_ours():
    numbers = f"[0x{'f' * 5000}, 1]"
    with pytest.raises(CaptureError, match="no camera matrix"):
        parse_intrinsics(f"FocalLength: {numbers}".encode(), "a.yaml")
    with pytest.raises(CaptureError, match="no pose"):
        depth_to_color(f"depth_to_color: {numbers}".encode(), "a.yaml", "a")


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.json", '{"fx": 225, "fy": 226, "cx": 9, "cy": 9, "fx": 260}', "'fx'.*225 and 260"),
        ("a.json", '{"K": {"fx": 225}, "K": {"fx": 260}}', "'K'.*two tables"),
        ("a.yaml", "fx: 225\nfy: 226\ncx: 9\ncy: 9\nfx: 260\n", "'fx'.*225 and 260"),
        ("a.yml", "%YAML:1.0\n---\nK: [1]\nK: [2]\n", "'K'.*two tables"),
    ],
)
def test_a_key_with_two_values(name, text, says):
    with pytest.raises(CaptureError, match=rf"{name}: key {says}.*Fix: keep one of them"):
        parse_intrinsics(text.encode(), name)


def test_a_key_twice_is_harmless_with_one_value_or_in_a_note():
    twice = '{"fx": 225, "fy": 226, "cx": 160, "cy": 120, "fx": 225}'
    assert parse_intrinsics(twice.encode(), "a.json") == NO_SIZE
    assert parse_intrinsics(b"lens: 35 mm\nlens: 50 mm\n", "readme.txt") is None


def test_one_of_several_cameras_is_chosen_by_its_size():
    text = json.dumps({"0": {**FIGURES, **SIZE}, "1": {**FIGURES, "fx": 9, "width": 640}})
    assert parse_intrinsics(text.encode(), size=(320, 240)) == PINHOLE
    with pytest.raises(CaptureError, match="several camera matrices"):
        parse_intrinsics(text.encode(), size=(640, 360))


def test_fisheye_is_told_from_the_others():
    text = KALIBR.replace("radtan", "equidistant")
    assert parse_intrinsics(text.encode()).distortion.model == "kannala-brandt"


CALIBRATION_SAMPLE = """\
%YAML:1.0
---
image_width: 320
image_height: 240
flags: 0
fisheye_model: 1
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 225., 0., 160., 0., 226., 120., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 4
   cols: 1
   dt: d
   data: [ 1.0e-01, 0.02, 0.03, 0. ]
"""
CALIBRATION_SAMPLE_XML = """\
<?xml version="1.0"?>
<opencv_storage>
<image_width>320</image_width>
<image_height>240</image_height>
<fisheye_model>1</fisheye_model>
<camera_matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>225. 0. 160. 0. 226. 120. 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix">
  <rows>4</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>1.0e-01 0.02 0.03 0.</data></distortion_coefficients>
</opencv_storage>
"""
INSTANT_NGP = {
    "fl_x": 225, "fl_y": 226, "cx": 160.5, "cy": 120.5, "w": 320, "h": 240, "k1": 0.1, "k2": 0.02,
    "k3": 0.03, "k4": 0.0, "p1": 0.0, "p2": 0.0, "is_fisheye": True, "frames": [],
}  # fmt: skip
COEFFICIENTS = [0.1, 0.02, 0.03, 0.0]
FISHEYE = {"K": ROWS, **SIZE, "D": COEFFICIENTS}


@pytest.mark.parametrize(
    "text",
    [
        CALIBRATION_SAMPLE,
        CALIBRATION_SAMPLE_XML,
        *map(json.dumps, (
            INSTANT_NGP, {**FISHEYE, "fisheye": True}, {"fisheye": FISHEYE},
            {**FISHEYE, "fisheye": True, "camera_model": "pinhole"},
            {**FIGURES, **SIZE,
             "distortion": {"model": "fisheye", "k1": 0.1, "k2": 0.02, "k3": 0.03}},
            {**FISHEYE, "distortion": "equidistant"},
        )),
    ],
)  # fmt: skip
def test_a_file_that_says_fisheye(text):
    lens = Distortion("kannala-brandt", COEFFICIENTS)
    assert parse_intrinsics(text.encode()) == replace(PINHOLE, distortion=lens)


@pytest.mark.parametrize(
    "text",
    [
        CALIBRATION_SAMPLE.replace("model: 1", "model: 0"),
        CALIBRATION_SAMPLE_XML.replace("model>1", "model>0"),
        json.dumps({**FISHEYE, "fisheye": False}),
    ],
)
def test_a_file_that_says_no_fisheye(text):
    found = parse_intrinsics(text.encode())
    assert found == replace(PINHOLE, distortion=lens(*COEFFICIENTS))


@pytest.mark.parametrize(
    ("distortion", "read"),
    [
        ("0.1 0.2 0 0 0", lens(0.1, 0.2, 0, 0, 0)),
        ("[0.1, 0.2, 0, 0]", lens(0.1, 0.2, 0, 0)),
        ("0 0 0 0", None), ("none", None), ("", None), (None, None), (0, None), ([], None),
        ({}, None), ({"rows": 1, "cols": 4, "data": [0, 0, 0, 0]}, None),
    ],
)  # fmt: skip
def test_distortion_in_a_text(distortion, read):
    text = json.dumps({**FIGURES, "distortion": distortion})
    assert parse_intrinsics(text.encode()) == replace(NO_SIZE, distortion=read)


def test_a_vector_in_xml():
    text = CALIBRATION_SAMPLE_XML.partition("<fisheye")[0] + (
        "<K>225. 0. 160. 0. 226. 120. 0. 0. 1.</K>\n<D>\n  1.0e-01 0.02\n  0. 0. 0.</D>\n"
    )
    read = replace(PINHOLE, distortion=lens(0.1, 0.02, 0, 0, 0))
    assert parse_intrinsics(text.encode()) == read


def test_a_distance_is_no_distortion():
    text = json.dumps({**FIGURES, "dist": 0.6, "d": "600"})
    assert parse_intrinsics(text.encode()) == NO_SIZE


@pytest.mark.parametrize(
    "distortion",
    [
        "k1 = 0.1", {"radial": [0.1, 0.2], "tangential": [0, 0]}, [[0.1, 0.2], [0.3]],
        ["0.1", "a"], {"data": "0.1 0 0 0"}, [float("nan")] * 4,
    ],
)  # fmt: skip
def test_distortion_that_is_not_understood(distortion):
    text = json.dumps({**FIGURES, "distortion": distortion})
    with pytest.raises(CaptureError, match=r"a\.json: the distortion is not understood"):
        parse_intrinsics(text.encode(), "a.json")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (json.dumps({**FISHEYE, "fisheye": 1, "distortion_model": "plumb_bob"}), "and fisheye"),
        (json.dumps({**FISHEYE, "fisheye": 1, "D": [0.1, 0, 0, 0, 0.1]}), "kannala-brandt"),
        (json.dumps({**FIGURES, "model": "modified_brown_conrady", "coeffs": [0.1, 0, 0, 0, 0]}),
         "this model of distortion is not read"),
        (json.dumps({"cam0": FIGURES, "cam1": {**FIGURES, "fy": 227}}), "several camera matrices"),
        (ROS_SAVES.replace("data: [225,", "data: ["), "damaged"),
        ("500 1 320 0 500 240 0 0 1", "skew"),
        ("[ 320x240  p[160 120]  f[225 226]  Modified Brown Conrady [0.1 0 0 0 0] ]",
         "this model of distortion is not read"),
        (METASHAPE.replace("<k1>", "<k4>0.01</k4><k1>"), "seen k4"),
        (METASHAPE.replace(">frame", ">fisheye"), "another projection"),
        (json.dumps({**MATLAB, "Skew": 2}), "skew"),
        ("color: [ 320x240  p[160 120]  f[225 226]  Brown Conrady [0 0 0 0 0] ]\n"
         "color: [ 320x240  p[160 120]  f[225 227]  Brown Conrady [0 0 0 0 0] ]",
         "several camera matrices"),
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
        "fx 225\nfy 226\ncx 160\ncy 120\nfx 400\n",
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
        "two values of a name",
        "large",
    ],
)
def test_what_is_no_such_file(text):
    assert parse_intrinsics(text.encode(), "notes.txt") is None


def test_names_that_say_so():
    assert all(map(named_intrinsics, ("K", "camera_info", "calibration_matrix", "Intrinsic-1")))
    assert not any(map(named_intrinsics, ("kinect", "poses", "lights", "CameraTrajectory")))


INVERSE = [0.1, 0.02, 0.003, -0.004, 0.05]
ENUMERATED = """\
 Intrinsic of "Color" / 320x240 / {{RGB8/BGR8}}
  Width:      \t320
  Height:     \t240
  PPX:        \t160
  PPY:        \t120
  Fx:         \t225
  Fy:         \t226
  Distortion: \tInverse Brown Conrady
  Coeffs:     \t{}
""".format("  \t".join(map(str, INVERSE)))


@pytest.mark.parametrize(
    "text",
    [
        ENUMERATED,
        "[ 320x240  p[160 120]  f[225 226]  Inverse Brown Conrady [0.1 0.02 0.003 -0.004 0.05] ]",
        json.dumps({**FIGURES, **SIZE, "model": "distortion.inverse_brown_conrady",
                    "coeffs": INVERSE}),
        json.dumps({**FIGURES, **SIZE, "model": "inverse_brown_conrady", "k1": 0.1, "k2": 0.02,
                    "p1": 0.003, "p2": -0.004, "k3": 0.05}),
    ],
    ids=["rs-enumerate-devices", "librealsense prints", "pyrealsense2", "by name"],
)  # fmt: skip
def test_the_inverse_model_of_librealsense(text):
    found = parse_intrinsics(text.encode(), "camera.txt")
    assert found == replace(PINHOLE, distortion=Distortion("inverse-brown-conrady", INVERSE))


@pytest.mark.parametrize("name", ["{}_color", "{}_rgb", "color_{}", "rgb{}"])
@pytest.mark.parametrize("prefix", ["", "distortion_"])
@pytest.mark.parametrize("read", [parse_intrinsics, parse_depth_intrinsics])
def test_no_coefficient_of_a_camera_is_lost(name, prefix, read):
    """k2_color is no pose from k to the colour camera."""
    if read is parse_depth_intrinsics:
        name = name.replace("color", "depth").replace("rgb", "depth")
    coefficients = {"k1": 0.1, "k2": 0.02, "p1": 0.003, "p2": -0.004, "k3": 0.05}
    facts = FIGURES | {prefix + key: value for key, value in coefficients.items()}
    text = json.dumps({name.format(key): value for key, value in facts.items()})
    assert read(text.encode()) == replace(NO_SIZE, distortion=lens(*coefficients.values(), 0, 0, 0))


NUMBERS = [-0.28, 0.11, 0.001, -0.0005, -0.02]
BY_NAME = dict(zip(("k1", "k2", "p1", "p2", "k3"), NUMBERS, strict=True))
VINS = """\
%YAML:1.0
---
model_type: PINHOLE
image_width: 320
image_height: 240
distortion_parameters:
   k1: -0.28
   k2: 0.11
   p1: 0.001
   p2: -0.0005
projection_parameters:
   fx: 225.0
   fy: 226.0
   cx: 160.0
   cy: 120.0
"""
ZIVID = """\
CameraIntrinsics:
  CameraMatrix: {CX: 160, CY: 120, FX: 225, FY: 226}
  Distortion: {K1: -0.28, K2: 0.11, K3: -0.02, P1: 0.001, P2: -0.0005}
"""


@pytest.mark.parametrize(
    "text",
    [
        VINS,
        ZIVID,
        *map(json.dumps, (
            {"intrinsics": FIGURES, "distortion": NUMBERS},
            {"distortion": BY_NAME, "intrinsics": FIGURES},
            {"intrinsics": FIGURES, "distortion_coefficients": [NUMBERS]},
            {"intrinsics": FIGURES, **BY_NAME},
            {"intrinsics": {"K": ROWS}, "distortion": {"coeffs": NUMBERS, "model": "radtan"}},
            {"camera": {"intrinsic": FIGURES, "distortion": BY_NAME}},
            {"camera": {"intrinsic": FIGURES}, "distortion": BY_NAME},
            {"color": {"intrinsics": FIGURES, "distortion": NUMBERS},
             "depth": {"intrinsics": {**FIGURES, "fx": 200}, "distortion": [1, 0, 0, 0]}},
            {"rgb_intrinsic": FIGURES, "rgbDistortion": BY_NAME,
             "depth_intrinsic": {**FIGURES, "fx": 200}, "depth_distortion": {"k1": 1}},
            {"intrinsics": FIGURES, "distortion": NUMBERS, "depth_intrinsics": FIGURES},
            {"intrinsics": FIGURES, "color_distortion": NUMBERS},
            {"color_intrinsics": FIGURES, "distortion": NUMBERS},
            {**FIGURES, "color_distortion": NUMBERS},
            {"K": ROWS, "kc": NUMBERS},
            {**FIGURES, "disto": NUMBERS},
            {**FIGURES, "coefficients": NUMBERS},
            {**FIGURES, "distorsion": NUMBERS},
            {"camera_matrix": K, "camera_distortion": [NUMBERS]},
            {**FIGURES, **{f"distortion_{key}": value for key, value in BY_NAME.items()}},
        )),
    ],
)  # fmt: skip
def test_a_lens_beside_its_camera(text):
    found = parse_intrinsics(text.encode(), "camera.yaml")
    assert (found.fx, found.distortion.model) == (225, "brown-conrady")
    expected = NUMBERS[:4] if text is VINS else NUMBERS
    assert found.distortion.coefficients[:5] == (*expected, *[0.0] * (5 - len(expected)))


@pytest.mark.parametrize(
    "facts",
    [
        {"depth_intrinsics": FIGURES, "depth_distortion": NUMBERS},
        {"depth_intrinsics": FIGURES, "distortion": NUMBERS},
        {"depth": {"intrinsics": FIGURES, "distortion": BY_NAME}, "color": {"K": ROWS}},
        {"cameras": {"depth_intrinsics": FIGURES}, "distortion": NUMBERS},
    ],
)
def test_a_lens_beside_the_depth_camera(facts):
    found = parse_depth_intrinsics(json.dumps(facts).encode(), "a.json")
    assert found.distortion.coefficients[:5] == tuple(NUMBERS)


def test_a_model_beside_the_camera_is_that_of_the_lens_there():
    facts = {"intrinsics": FIGURES, "distortion": {"model": "fisheye", "k1": 0.1}}
    assert parse_intrinsics(json.dumps(facts).encode()).distortion.model == "kannala-brandt"
    facts = {"model": "fisheye", "intrinsics": FIGURES, "distortion": [0.1, 0, 0, 0]}
    assert parse_intrinsics(json.dumps(facts).encode()).distortion.model == "kannala-brandt"
    facts["intrinsics"] = {**FIGURES, "distortion": [0, 0, 0, 0]}
    assert parse_intrinsics(json.dumps(facts).encode()).distortion is None


@pytest.mark.parametrize(
    ("facts", "says"),
    [
        ({**FIGURES, "radial_distortion": [0.1, 0, 0]}, "not understood"),
        ({"intrinsics": FIGURES, "radial_distortion": [0.1, 0, 0]}, "not understood"),
        ({**FIGURES, "lensDistortion": NUMBERS}, "not understood"),
        ({**FIGURES, "distortion_k": [0.1, 0, 0], "distortion_p": [0, 0]}, "not understood"),
        ({**FIGURES, "radial_1": 0.1, "p1": 0.1}, "not understood"),
        ({"color": FIGURES, "depth": FIGURES, "distortion": NUMBERS}, "of which camera"),
        ({"camera": FIGURES, "lens": {"distortion": NUMBERS}}, "of which camera"),
        ({**FIGURES, "lens": BY_NAME}, "of which camera"),
    ],
)
def test_a_lens_that_is_not_clear_is_refused(facts, says):
    with pytest.raises(CaptureError, match=says):
        parse_intrinsics(json.dumps(facts).encode(), "a.json")


@pytest.mark.parametrize(
    "facts",
    [
        {**FIGURES, "radial_distortion": [0, 0, 0], "distortion_model": "radtan"},
        {**FIGURES, "undistorted_size": [320, 240]},
        {**FIGURES, "distortion_error": 0.3, "distortion_map": "map1.png"},
        {**FIGURES, "color_correction": {"coeffs": [1, 2, 3, 4]}},
        {"intrinsics": FIGURES, "d": [0, 0, 600], "p1": 3, "dist": 0.6},
        {"intrinsics": FIGURES, "depth_distortion": NUMBERS},
        {**FIGURES, "depth_distortion": NUMBERS},
        {"a": {**FIGURES, **SIZE}, "b": {**FIGURES, "w": 640, "h": 480, "distortion": {"k1": 1}}},
        {**FIGURES, **SIZE, "depth": {"intrinsics": FIGURES, "distortion": NUMBERS}},
    ],
)
def test_what_is_no_lens_of_the_camera(facts):
    found = parse_intrinsics(json.dumps(facts).encode(), size=(320, 240))
    assert found == replace(NO_SIZE, width=found.width, height=found.height)


def test_a_camera_with_a_lens_keeps_it_from_those_in_it():
    rectified = {"K": ROWS, "width": 640, "height": 480}
    facts = {"K": ROWS, **SIZE, "D": NUMBERS, "rectified": rectified}
    found = parse_intrinsics(json.dumps(facts).encode(), size=(640, 480))
    assert found == replace(NO_SIZE, width=640, height=480)


@pytest.mark.parametrize("text", ["k1 is about -0.28", "1 2 0.1", '{"radial_distortion": [0.1]}'])
def test_a_file_of_a_lens_that_is_not_understood(text):
    with pytest.raises(CaptureError, match=r"distortion\.txt: "):
        parse_lens(text.encode(), "distortion.txt")
    if text == "1 2 0.1":
        assert parse_lens(text.encode(), "dist.txt", sure=False) is None


@pytest.mark.parametrize("text", ["the lens does not distort", "0.6", "", "{}"])
def test_a_file_that_states_no_lens(text):
    assert parse_lens(text.encode(), "dist.txt") is None
    assert parse_lens(b"0 0 0 0", "dist.txt").is_none


@pytest.mark.parametrize("text", ["0.61 0.62 0.63 0.64", "0,1,0,1,0", "0 0 0 0.1 0"])
def test_numbers_like_no_lens_in_a_file_that_may_be_of_distances(text):
    assert parse_lens(text.encode(), "dist.txt", sure=False) is None
    assert parse_lens(b"-0.4 1.2 0.02 0.09 0", "dist.txt", sure=False).coefficients[3] == 0.09


@pytest.mark.parametrize("text", ["-0.04 0.3 -1.2 1.5", "0.1 0.2 0 3", "1 2 3 4 5 6"])
def test_numbers_like_no_lens_under_a_name_of_one(text):
    with pytest.raises(CaptureError, match=r"coeffs\.txt: the distortion is not understood"):
        parse_lens(text.encode(), "dist_coeffs.txt")


@pytest.mark.parametrize(
    "fact",
    [
        {"lensDistortionCenter": [160.2, 120.4]},
        {"distortion_error": [0.1, 0.2]},
        {"radial_errors": [0.1, 0.2]},
        {"distorted_image_size": [320, 240]},
        {"distorted_points": [[1.5, 2], [3, 4]]},
        {"distortion_check": {"rms": 0.2}},
        {"max_distortion1": 2.5},
        {"tangential_speed": [0.1, 0.2]},
    ],
)
def test_what_is_told_of_a_lens_and_is_no_coefficient(fact):
    assert parse_intrinsics(json.dumps({**FIGURES, **fact}).encode()) == NO_SIZE


@pytest.mark.parametrize(
    "name",
    [
        "lens_distortion_vector", "lensDistortionLookupTable", "cam0_radial_distortion",
        "tangential_params", "radial_k1", "distortion_2", "distortion_values",
        "left_cam_distortion", "inverseLensDistortionLookupTable",
    ],
)  # fmt: skip
def test_coefficients_whose_order_no_name_says(name):
    value = 0.1 if name[-1].isdigit() else [0.1, 0.2]
    with pytest.raises(CaptureError, match="not understood"):
        parse_intrinsics(json.dumps({**FIGURES, name: value}).encode())


@pytest.mark.parametrize(
    "text", ["rms 0.25 px", "calibrated on 12.11.2024", "grid (9, 6), crop [10 12 600 440], 0.5 px"]
)
def test_a_text_about_a_lens_without_its_coefficients(text):
    assert parse_lens(text.encode(), "distortion_report.txt") is None


@pytest.mark.parametrize(
    "text", ["nan 0 0 0 0", "the lens has (-0.28, 0.1, 0, 0)", "K_1 = about -.28", "[0.1 NaN 0 0]"]
)
def test_a_text_of_coefficients_that_are_not_read(text):
    with pytest.raises(CaptureError, match=r"dist_coeffs\.txt: the distortion is not understood"):
        parse_lens(text.encode(), "dist_coeffs.txt")
