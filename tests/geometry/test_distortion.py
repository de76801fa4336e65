"""Lens distortion against OpenCV and librealsense, and there and back over whole images."""

import cv2
import numpy as np
import pytest

from rakelight.capture.validate import MOST_STRETCHED
from rakelight.errors import InputError
from rakelight.geometry.camera import back_project, pixel_rays
from rakelight.geometry.distortion import (
    _evaluated,
    corner_px,
    corner_stretch,
    distort,
    fold_px,
    to_pixels,
    to_rays,
    undistort,
)
from rakelight.model import Camera, Distortion
from tests.capture.readers.realsense_files import librealsense

BROWN, INVERSE, KANNALA = "brown-conrady", "inverse-brown-conrady", "kannala-brandt"
AZURE = [0.4508, -2.6105, 0.00077, -0.00021, 1.4968, 0.3313, -2.4332, 1.4242]
# (model, coefficients, width, height, focal length): how strong they are in the field.
LENSES = {
    "phone": (BROWN, [0.12, -0.35, 0.0012, -0.0008, 0.25], 480, 360, 362.0),
    "wide RealSense": (BROWN, [-0.055, 0.066, 0.0006, -0.0004, -0.021], 640, 400, 320.0),
    "wide RealSense, inverse": (INVERSE, [-0.055, 0.066, 0.0006, -0.0004, -0.021], 640, 400, 320.0),
    "Azure Kinect, colour": (BROWN, AZURE, 640, 360, 302.0),
    "Azure Kinect, depth": (BROWN, [5.23, 3.58, -7e-5, 3e-5, 0.189, 5.556, 5.46, 1.02],
                            640, 576, 504.0),
    "four coefficients": (BROWN, [-0.2, 0.1, 0.003, -0.004], 320, 240, 300.0),
    "fisheye": (KANNALA, [-0.02, 0.011, -0.0085, 0.0018], 640, 400, 300.0),
}  # fmt: skip


def lens_camera(name):
    model, coefficients, width, height, focal = LENSES[name]
    centre = (width - 1) / 2 + 3, (height - 1) / 2 - 2
    return Camera(width, height, focal, 1.002 * focal, *centre, Distortion(model, coefficients))


def pixels(camera):
    return np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))


@pytest.mark.parametrize("name", LENSES)
def test_there_and_back_over_the_whole_image(name):
    camera = lens_camera(name)
    u, v = pixels(camera)
    x, y = to_rays(u, v, camera)
    again = to_pixels(x, y, camera)
    assert np.isfinite(x).all()
    assert np.abs(again[0] - u).max() < 1e-7
    assert np.abs(again[1] - v).max() < 1e-7
    # It is no identity.
    assert np.abs(camera.fx * x + camera.cx - u).max() > 1.0
    assert fold_px(camera) is None


@pytest.mark.parametrize("name", LENSES)
def test_corners_are_as_far_out_as_the_lens_shows_them(name):
    camera = lens_camera(name)
    u, v = corner_px(camera)
    x, y = to_rays(camera.cx - u, camera.cy - v, camera)  # all principal points lie right and up
    across, along = u / camera.fx, v / camera.fy
    assert abs(corner_stretch(camera) - np.hypot(across, along) / np.hypot(x, y)) < 0.01
    assert corner_stretch(camera) < MOST_STRETCHED - 0.2


@pytest.mark.parametrize("name", LENSES)
def test_points_are_where_opencv_shows_them(name):
    camera = lens_camera(name)
    lens = camera.distortion
    if lens.model == INVERSE:
        pytest.skip("not in OpenCV")
    x, y = (each[::7, ::7].ravel() for each in to_rays(*pixels(camera), camera))
    points = np.stack([x, y, np.ones_like(x)], axis=-1)
    zero, k = np.zeros(3), np.array(lens.coefficients)
    if lens.model == KANNALA:
        theirs = cv2.fisheye.projectPoints(points[None], zero, zero, camera.matrix, k)[0][0]
    else:
        theirs = cv2.projectPoints(points, zero, zero, camera.matrix, k)[0][:, 0]
    np.testing.assert_allclose(np.stack(to_pixels(x, y, camera), -1), theirs, atol=1e-9)


@pytest.mark.parametrize("name", LENSES)
def test_points_are_where_librealsense_shows_them(name):
    realsense = librealsense()
    camera = lens_camera(name)
    lens = camera.distortion
    if len(lens.coefficients) == 8:
        pytest.skip("librealsense has no rational model")
    there = realsense.intrinsics()
    there.width, there.height, there.fx, there.fy = (
        camera.width,
        camera.height,
        camera.fx,
        camera.fy,
    )
    there.ppx, there.ppy = camera.cx, camera.cy
    there.coeffs = [*lens.coefficients, *[0.0] * (5 - len(lens.coefficients))]
    models = realsense.distortion
    there.model = {
        BROWN: models.brown_conrady,
        INVERSE: models.inverse_brown_conrady,
        KANNALA: models.kannala_brandt4,
    }[lens.model]
    x, y = (each[::19, ::19].ravel() for each in to_rays(*pixels(camera), camera))
    theirs = [
        realsense.rs2_project_point_to_pixel(there, [*at, 1.0]) for at in zip(x, y, strict=True)
    ]
    # Single precision there.
    np.testing.assert_allclose(np.stack(to_pixels(x, y, camera), -1), theirs, atol=1e-3)


@pytest.mark.parametrize("name", LENSES)
def test_derivatives_are_those_of_the_formulas(name):
    lens = lens_camera(name).distortion
    x, y = np.array([0.0, 0.3, -0.4, 0.5]), np.array([0.0, 0.2, 0.35, -0.6])
    found, small = _evaluated(x, y, lens), 1e-6
    right, left = _evaluated(x + small, y, lens), _evaluated(x - small, y, lens)
    below, above = _evaluated(x, y + small, lens), _evaluated(x, y - small, lens)
    for derivative, after, before in (
        (found.xx, right.x, left.x),
        (found.yx, right.y, left.y),
        (found.xy, below.x, above.x),
        (found.yy, below.y, above.y),
    ):
        np.testing.assert_allclose(derivative, (after - before) / (2 * small), atol=1e-8)


def test_beyond_the_fold_there_is_nothing():
    lens = Distortion(BROWN, [-0.5, 0.0, 0.0, 0.0])
    fold = np.sqrt(1 / 1.5)  # of r - r^3 / 2
    x = np.array([0.99 * fold, 1.01 * fold, 3.0])
    shown, _ = distort(x, 0 * x, lens)
    assert np.isfinite(shown).tolist() == [True, False, False]
    largest = fold - fold**3 / 2
    back, _ = undistort(np.array([0.99 * largest, 1.01 * largest, np.nan]), np.zeros(3), lens)
    assert np.isfinite(back).tolist() == [True, False, False]
    assert fold_px(Camera(400, 300, 200.0, 200.0, 199.5, 149.5, lens)) == pytest.approx(
        200 * largest, abs=0.01
    )


def test_a_pole_is_beyond_the_range():
    lens = Distortion(BROWN, [0, 0, 0, 0, 0, -0.25, 0, 0])  # 1 / (1 - r^2 / 4)
    shown, _ = distort(np.array([1.9, 2.1]), np.zeros(2), lens)
    assert np.isfinite(shown).tolist() == [True, False]


def test_pixels_of_a_fisheye_beyond_84_degrees_have_no_ray():
    camera = Camera(848, 800, 286.0, 286.0, 423.5, 399.5, Distortion(KANNALA, [0.0] * 4))
    x, _ = to_rays(*pixels(camera), camera)
    assert 0.1 < np.isnan(x).mean() < 0.4
    assert fold_px(camera) is None


def test_points_along_undistorted_rays():
    camera = lens_camera("Azure Kinect, depth")
    points = back_project(np.full(camera.shape, 2.0), camera)
    u, v = to_pixels(points[..., 0] / 2, points[..., 1] / 2, camera)
    np.testing.assert_allclose(np.stack([u, v]), np.stack(pixels(camera)), atol=1e-7)


def test_nothing_takes_a_distorted_camera_for_an_ideal_one():
    with pytest.raises(InputError, match=r"camera: a camera with lens distortion.*Fix: hand"):
        pixel_rays(lens_camera("phone"))
