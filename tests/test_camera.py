"""Cameras from calibration matrices, and back."""

import json
from dataclasses import asdict, astuple
from fractions import Fraction

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.model import Camera, Distortion

K = np.array([[525.5, 0.0, 318.25], [0.0, 520.0, 241.0], [0.0, 0.0, 1.0]])
WIDE = np.array([[900.0, 0, 645], [0, 900.0, 362], [0, 0, 1]])
WHOLE = np.array([[500, 0, 320], [0, 500, 240], [0, 0, 1]])


def changed(row, column, value):
    matrix = K.copy()
    matrix[row, column] = value
    return matrix


@pytest.mark.parametrize("given", [K, K.tolist(), K.astype(np.float32), np.asfortranarray(K)])
def test_a_matrix_and_its_camera(given):
    camera = Camera.from_matrix(given, (480, 640))
    assert camera == Camera(640, 480, 525.5, 520.0, 318.25, 241.0)
    assert camera.matrix.dtype == np.float64
    np.testing.assert_array_equal(camera.matrix, K)


def test_the_matrix_projects_as_the_camera_does():
    point = np.array([0.1, -0.2, 0.8])
    u, v, w = Camera.from_matrix(K, (480, 640)).matrix @ point
    assert (u / w, v / w) == pytest.approx((525.5 * 0.125 + 318.25, 520.0 * -0.25 + 241.0))


def test_shapes_of_numpy_and_lists():
    assert Camera.from_matrix(WHOLE, np.zeros((480, 640, 3)).shape[:2]).fx == 500.0
    camera = Camera.from_matrix(WHOLE, [np.int64(480), 640])
    assert (type(camera.height), type(camera.fx)) == (int, float)


@pytest.mark.parametrize("number", [np.float32, np.float64, Fraction, np.int16])
def test_numbers_of_any_kind_become_plain_ones(number):
    camera = Camera(np.int64(640), np.uint16(480), *map(number, (525, 520, 318, 241)))
    assert camera == Camera(640, 480, 525.0, 520.0, 318.0, 241.0)
    assert json.loads(json.dumps(asdict(camera)))["fx"] == 525
    assert {type(value) for value in astuple(camera)[:-1]} <= {int, float}
    # What is no number waits for the check of the whole capture.
    assert Camera(640, 480, "525", None, 1.0, 1.0).fx == "525"


@pytest.mark.parametrize("factor", [0, -1, np.nan, np.inf, "2", None])
def test_a_scale_is_a_number_above_0(factor):
    with pytest.raises(InputError, match="factor: no scale of an image"):
        Camera(640, 480, 525.0, 520.0, 318.0, 241.0).scaled(factor)


def test_what_the_caller_has_stays_as_it_is():
    mine = K.copy()
    camera = Camera.from_matrix(mine, (480, 640))
    mine[:] = 0
    camera.matrix[:] = 0
    np.testing.assert_array_equal(camera.matrix, K)


BAD = [
    (None, (480, 640), "not a calibration matrix .seen NoneType"),
    (K[:2], (480, 640), r"seen \(2, 3\) float64"),
    ([[1, 2], [3]], (480, 640), "not a calibration matrix .seen list"),
    (K.astype(object), (480, 640), "object"),
    (K.astype(complex), (480, 640), "complex128"),
    (np.ma.masked_equal(K, 0), (480, 640), "MaskedArray"),
    (changed(0, 0, np.nan), (480, 640), "finite numbers"),
    (changed(1, 2, np.inf), (480, 640), "finite numbers"),
    (changed(0, 1, 0.5), (480, 640), "a camera with skew .seen 0.5 and 0, needed both 0"),
    (changed(1, 0, 0.5), (480, 640), "a camera with skew"),
    (K.T, (480, 640), "Fix: transpose K"),
    (2 * K, (480, 640), r"Fix: divide K by K\[2, 2\]"),
    (changed(0, 0, -525.5), (480, 640), "fx = -525.5, fy = 520, needed both above 0"),
    (changed(1, 1, 0.0), (480, 640), "fy = 0"),
    (K, (480, 640, 3), r"needed \(height, width\)"),
    (K, 480, r"needed \(height, width\)"),
    (K, None, "seen None"),
    (K, (480.0, 640.0), "two whole numbers"),
    (K, (0, 640), "above 0"),
    (K, (True, 640), "two whole numbers"),
    (WIDE, (1280, 720), r"exchanged .*Fix: give \(720, 1280\)"),
]


@pytest.mark.parametrize(("matrix", "shape", "words"), BAD)
def test_what_is_no_camera(matrix, shape, words):
    with pytest.raises(InputError, match=words) as refused:
        Camera.from_matrix(matrix, shape)
    assert refused.value.needed
    assert refused.value.remedy


def test_a_camera_on_its_side_is_no_exchange():
    assert Camera.from_matrix(WIDE, (720, 1280)).shape == (720, 1280)
    assert Camera.from_matrix(changed(0, 2, 359.5), (960, 720)).shape == (960, 720)


def test_the_principal_point_of_a_cutout_may_lie_beside_it():
    cut = Camera.from_matrix(K, (480, 640)).cropped(slice(300, 480), slice(400, 640))
    assert Camera.from_matrix(cut.matrix, cut.shape) == cut


LENS = Distortion("brown-conrady", (0.1, -0.2, 0.001, 0.002, 0.03))


@pytest.mark.parametrize(
    "given",
    [
        LENS,
        list(LENS.coefficients),
        np.array([LENS.coefficients]),  # as cv2.calibrateCamera returns it
        np.array(LENS.coefficients)[:, None],
    ],
)
def test_a_matrix_with_distortion(given):
    assert Camera.from_matrix(K, (480, 640), given).distortion == LENS


def test_coefficients_that_opencv_pads():
    padded = np.zeros(14)
    padded[:8] = np.arange(8) / 10
    assert len(Camera.from_matrix(K, (480, 640), padded).distortion.coefficients) == 8
    padded[9] = 0.1
    with pytest.raises(InputError, match=r"another number of coefficients .*seen 14"):
        Camera.from_matrix(K, (480, 640), padded)


def test_distortion_does_not_change_with_the_image():
    camera = Camera.from_matrix(K, (480, 640), LENS)
    for other in (
        camera.scaled(0.5),
        camera.resized(320, 120),
        camera.cropped(slice(3, 90), slice(5, 70)),
    ):
        assert other.distortion == LENS


@pytest.mark.parametrize(
    ("model", "coefficients", "words"),
    [
        ("brown", (0, 0, 0, 0), "seen brown, needed brown-conrady, inverse-brown-conrady, kannala"),
        (None, (0, 0, 0, 0), "unknown model"),
        ("brown-conrady", (0, 0, 0), "seen 3, needed 4 or 5 or 8"),
        ("inverse-brown-conrady", (0, 0, 0, 0), "seen 4, needed 5"),
        ("kannala-brandt", (0, 0, 0, 0, 0), "seen 5, needed 4"),
        ("brown-conrady", (0, 0, np.nan, 0), "finite"),
        ("brown-conrady", (0, 0, "1", 0), "finite"),
        ("brown-conrady", (0, 10**400, 0, 0), "finite"),
        ("brown-conrady", 3.0, "seen 1, needed"),
        ("brown-conrady", None, "finite"),
    ],
)
def test_what_is_no_distortion(model, coefficients, words):
    with pytest.raises(InputError, match=words) as refused:
        Distortion(model, coefficients)
    assert refused.value.needed
    assert refused.value.remedy
