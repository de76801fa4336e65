"""What could not be read again is refused, by the field's name, before anything is written."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.export import load_result
from rakelight.model import Camera, Finding, Lights, Truth
from rakelight.report import save_result
from tests.export.conftest import make_sphere

SPHERE = make_sphere()
VECTOR, AMBIENT = SPHERE.lights.vector, SPHERE.lights.ambient
SIGMA = np.where(SPHERE.mask, 0.001, np.nan)
LARGE = 10**400

WRONG = {
    "depth": [None, 3],
    "normals": [None, -SPHERE.normals, 100 * SPHERE.normals, 0 * SPHERE.normals],
    "albedo": [None],
    "confidence": [None],
    "prepared_depth": [None, -SPHERE.prepared_depth],
    "depth_sigma": [3, -SIGMA],
    "normal_sigma": [3, -SIGMA],
    "camera": [
        None,
        3,
        *(Camera(64, 48, length, 280.0, 29.0, 26.5) for length in (0.0, -5.0, np.nan, 1e-300)),
        Camera("a", 48, 300.0, 280.0, 29.0, 26.5),
        Camera(64, 48, 300.0, 280.0, np.inf, 26.5),
    ],
    "lights": [None, 3],
    "method": [None, 3, b"x"],
    "options": [None, 3, {"a": 10**5000}],
    "iterations": [None, -1, "x", 1.5, True, np.nan],
    "energy": [None, 3, "ab", ("a",), (1j,), (LARGE,)],
    "converged": [None, "no", 3],
    "timings_s": [None, 3, {"a": "b"}],
    "findings": [
        None, 3, ("a",), (Finding("error", "x", "y"),), (Finding("note", None, None),)
    ],
    "source": [None, 3],
    "photograph_names": [None, [1, 2], "ab", ("a",)],
    "capture": [None, 3, {"photographs": "x"}, {"bits": np.nan}, {"depth_to_color": 3}],
    "prediction_errors": [None, 3, ("a",)],
}  # fmt: skip
ALL = [(field, value) for field, values in WRONG.items() for value in values]


def refused(result, folder):
    """What is said of a result that is not saved."""
    with pytest.raises(InputError) as caught:
        save_result(result, folder / "out", mesh="none")
    assert "\n" not in str(caught.value)
    assert list(folder.iterdir()) == []
    return caught.value


@pytest.mark.parametrize(("field", "value"), ALL, ids=[field for field, _ in ALL])
def test_a_wrong_field_is_named(tmp_path, field, value):
    assert refused(replace(SPHERE, **{field: value}), tmp_path).source == field


@pytest.mark.parametrize(
    ("field", "lights"),
    [
        ("lights.ambient", Lights(VECTOR, None)),
        ("lights.ambient", Lights("a", "b")),
        ("lights.ambient", Lights(np.ones((2, 2, 3)), np.ones((2, 2)))),
        ("lights.ambient", Lights(np.ones((0, 1, 3)), np.ones((0, 1)))),
        ("lights.vector", Lights(None, AMBIENT)),
        ("lights.vector", Lights(VECTOR, np.ones((5, 1)))),
        ("lights.position_m", Lights(VECTOR, AMBIENT, VECTOR[:1], VECTOR[0, 0])),
        ("lights.middle_m", Lights(VECTOR, AMBIENT, VECTOR, VECTOR[0])),
        ("lights.beam", Lights(VECTOR, AMBIENT, None, VECTOR[0, 0], AMBIENT)),
        ("lights.ambient_direction", Lights(VECTOR, AMBIENT, ambient_direction=VECTOR[0])),
    ],
)
def test_a_wrong_array_of_the_lights_is_named(tmp_path, field, lights):
    result = replace(SPHERE, lights=lights, photograph_names=())
    assert refused(result, tmp_path).source == field


@pytest.mark.parametrize("maps", [3, {"depth": None}, {"normals": None}])
def test_a_wrong_truth_is_named(tmp_path, maps):
    whole = Truth(SPHERE.depth, SPHERE.normals, SPHERE.albedo)
    truth = maps if maps == 3 else replace(whole, **maps)
    with pytest.raises(InputError, match=r"^truth"):
        save_result(SPHERE, tmp_path / "out", mesh="none", truth=truth)


def test_what_single_precision_cannot_hold_is_left_out(tmp_path):
    """And nothing is said on stderr: warnings are errors here."""
    depth = SPHERE.depth.astype(float)
    row, column = np.argwhere(SPHERE.mask)[300]
    depth[row, column] = 1e300
    save_result(replace(SPHERE, depth=depth), tmp_path / "out")
    again = load_result(tmp_path / "out")
    np.testing.assert_array_equal(np.isnan(again.depth), ~SPHERE.mask | (depth == 1e300))
    assert [each.code for each in again.findings] == ["mask-full", "not-finite"]


def test_a_depth_that_single_precision_cannot_hold_is_none(tmp_path):
    refused(replace(SPHERE, depth=1e300 * SPHERE.depth.astype(float)), tmp_path)


@pytest.mark.parametrize(
    "kept",
    [
        {"iterations": np.int64(3)},
        {"converged": np.bool_(True)},
        {"energy": [2, np.float32(1)]},
        {"energy": np.array([2.0, 1.0])},
        {"photograph_names": ["a", "b"]},
        {"options": {1: object()}},
        {"iterations": sys.maxsize},
        {"normals": SPHERE.normals.astype(np.float16)},
        {"depth_sigma": SIGMA.astype(np.float32), "normal_sigma": SIGMA},
        {"lights": Lights(np.ones((2, 3, 3)), np.ones((2, 3)))},
    ],
    ids=lambda kept: "-".join(kept),
)
def test_what_says_the_same_in_another_type_is_written(tmp_path, kept):
    save_result(replace(SPHERE, **kept), tmp_path / "out", mesh="none")
    load_result(tmp_path / "out")
