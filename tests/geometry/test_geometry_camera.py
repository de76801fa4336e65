"""The pixel convention: centres at integers from 0, kept by scaling and cropping."""

import numpy as np
import pytest

from rakelight.geometry.camera import back_project, pixel_rays
from rakelight.model import Camera

CAMERA = Camera(width=40, height=30, fx=50.0, fy=45.0, cx=18.7, cy=16.2)
POINTS = np.random.default_rng(1).uniform([-0.2, -0.2, 0.5], [0.2, 0.2, 1.5], (50, 3))


def project(points, camera):
    x, y, z = points.T
    return camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy


@pytest.mark.parametrize("factor", [2, 3, 0.5, 0.1])
def test_scaling_keeps_the_place_in_the_image(factor):
    # Distances count from the image's edge, which lies half a pixel before the first centre.
    scaled = CAMERA.scaled(factor)
    for before, after in zip(project(POINTS, CAMERA), project(POINTS, scaled), strict=True):
        np.testing.assert_allclose((before + 0.5) * factor, after + 0.5, atol=1e-12)
    assert (scaled.width, scaled.height) == (40 * factor, 30 * factor)


def test_scaled_pixel_is_the_mean_of_its_block():
    # The coarse pixel's ray is the mean of the rays of the pixels that it covers.
    x, y = pixel_rays(CAMERA)
    coarse_x, coarse_y = pixel_rays(CAMERA.scaled(0.5))
    np.testing.assert_allclose(coarse_x[0] / 25.0, (x[0, ::2] + x[0, 1::2]) / 2 / 50.0)
    np.testing.assert_allclose(coarse_y[:, 0] / 22.5, (y[::2, 0] + y[1::2, 0]) / 2 / 45.0)


@pytest.mark.parametrize("factor", [2, 4, 5])
def test_scaling_there_and_back(factor):
    back = CAMERA.scaled(factor).scaled(1 / factor)
    for name in ("width", "height", "fx", "fy", "cx", "cy"):
        assert getattr(back, name) == pytest.approx(getattr(CAMERA, name), abs=1e-12)


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        (slice(3, 20), slice(5, 11)),
        (slice(0, 30), slice(0, 40)),
        (slice(None), slice(-7, None)),
        (slice(29, 99), slice(39, 40)),
    ],
)
def test_cropping_keeps_the_ray_of_a_pixel(rows, columns):
    image = back_project(np.ones(CAMERA.shape), CAMERA)
    window = CAMERA.cropped(rows, columns)
    assert window.shape == image[rows, columns].shape[:2]
    seen = back_project(np.ones(window.shape), window)
    np.testing.assert_allclose(seen, image[rows, columns], atol=1e-15)


def test_back_projection_and_projection_are_inverse():
    depth = np.random.default_rng(2).uniform(0.4, 2.0, CAMERA.shape)
    points = back_project(depth, CAMERA)
    u, v = project(points.reshape(-1, 3), CAMERA)
    rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width]
    np.testing.assert_allclose(u, columns.ravel(), atol=1e-12)
    np.testing.assert_allclose(v, rows.ravel(), atol=1e-12)
    np.testing.assert_array_equal(points[..., 2], depth)
