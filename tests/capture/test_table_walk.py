"""Whose intrinsics and whose lens it is that a table of a calibration file states."""

import json

import pytest

from rakelight.capture.intrinsics import parse_depth_intrinsics, parse_intrinsics, parse_lens
from rakelight.model import Camera, Distortion

FIGURES = {"fx": 225, "fy": 226, "cx": 160, "cy": 120}
COLOR, DEPTH = Camera(0, 0, 225.0, 226.0, 160.0, 120.0), Camera(0, 0, 200.0, 226.0, 160.0, 120.0)
LENS, OTHER_LENS = [0.1, 0.02, 0.003, -0.004, 0.05], [0.3, 0, 0, 0, 0]


def matrix(fx):
    """As cv::FileStorage writes it."""
    return {"rows": 3, "cols": 3, "data": [fx, 0, 160, 0, 226, 120, 0, 0, 1]}


@pytest.mark.parametrize(
    ("facts", "color", "depth"),
    [
        ({"depth_matrix": matrix(200)}, None, DEPTH),
        ({"color_matrix": matrix(225), "depth_matrix": matrix(200)}, COLOR, DEPTH),
        ({"depth": {f"depth_{key}": n for key, n in FIGURES.items()} | {"depth_fx": 200}},
         None, DEPTH),
        ({**FIGURES, "distortion_coefficients_depth": LENS}, COLOR, None),
        ({"color": FIGURES, "rgb": {}, "depth": {**FIGURES, "fx": 200}, "infrared": {}},
         COLOR, DEPTH),
        ({"rgbd": {"color": FIGURES, "depth": {**FIGURES, "fx": 200}}}, COLOR, DEPTH),
    ],
)  # fmt: skip
def test_whose_camera_it_is(facts, color, depth):
    data = json.dumps(facts).encode()
    assert (parse_intrinsics(data), parse_depth_intrinsics(data)) == (color, depth)


def test_whose_lens_it_is_in_a_file_without_cameras():
    facts = {"depth_distortion": OTHER_LENS, "color_distortion": LENS}
    data = json.dumps(facts).encode()
    assert parse_lens(data) == Distortion("brown-conrady", LENS)
    assert parse_lens(data, of_depth=True) == Distortion("brown-conrady", OTHER_LENS)
    assert parse_lens(json.dumps({"depth": {"distortion": OTHER_LENS}}).encode()) is None


def test_a_table_called_fisheye_in_a_file_without_cameras():
    data = json.dumps({"fisheye": {"D": LENS[:4]}}).encode()
    assert parse_lens(data) == Distortion("kannala-brandt", LENS[:4])


def test_a_camera_stated_for_each_of_many_photographs_is_one():
    tables = {str(i): {"cam_K": matrix(225)["data"], "depth_scale": 0.1} for i in range(1000)}
    assert parse_intrinsics(json.dumps(tables).encode()) == COLOR
