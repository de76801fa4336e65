"""Depth of a camera of its own against what the colour camera really sees."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import maximum_filter, minimum_filter

from rakelight.geometry.camera import back_project
from rakelight.model import Camera, RigidTransform
from rakelight.prepare.register import project, register, sensor_grid
from tests.prepare.ray_traced import COLOUR, POSE, depth_of

HERE = RigidTransform(np.eye(3), np.zeros(3))
# Colour pixels per depth pixel: two, and not a whole number.
DEPTH = {
    2.0: Camera(252, 192, fx=225.0, fy=226.0, cx=127.0, cy=94.0),
    1.754: Camera(288, 216, fx=256.5, fy=258.0, cx=146.0, cy=104.0),
}


def jumps(depth):
    """Pixels with a jump of 30 mm between them and a neighbour."""
    return maximum_filter(depth, 3) - minimum_filter(depth, 3) > 0.03


@pytest.fixture(scope="module", params=DEPTH)
def registered(request):
    """(camera, its depth, the grid, depth and noise on the grid, the truth there)."""
    camera = DEPTH[request.param]
    depth = depth_of(camera, POSE)
    grid = sensor_grid(COLOUR, camera)
    return camera, depth, grid, *register(depth, 0.002 * depth, camera, POSE, grid), depth_of(grid)


def visible_to_the_sensor(truth, grid, camera, depth):
    """Points of the truth that the depth camera sees, and those that something hides from it."""
    inverse = RigidTransform(POSE.rotation.T, -POSE.rotation.T @ POSE.translation_m)
    u, v, z = np.moveaxis(project(back_project(truth, grid), inverse, camera), -1, 0)
    inside = (u > 1) & (v > 1) & (u < camera.width - 2) & (v < camera.height - 2)
    column, row = (np.rint(np.where(inside, value, 0)).astype(int) for value in (u, v))
    ahead = minimum_filter(depth, 3)[row, column]
    behind = maximum_filter(depth, 3)[row, column]
    return inside & (ahead > z - 0.01) & (behind < z + 0.01), inside & (behind < z - 0.05)


def test_depth_is_the_truths(registered):
    *_, depth, _, truth = registered
    seen = np.isfinite(depth) & ~jumps(truth)
    error = np.abs(depth - truth)[seen]
    assert seen.mean() > 0.85
    assert np.median(error) < 1e-9  # the wall is a plane, and stays one
    # the ball's curvature within a pixel
    assert np.quantile(error, 0.99) < 0.2e-3
    assert error.max() < 1e-3


def test_nothing_bleeds_at_jumps(registered):
    # Every depth is one that the truth has within a pixel, but for steps that a limb has from one
    # pixel to the next: nothing lies between surfaces that are 170 mm and more apart.
    *_, depth, _, truth = registered
    nearby = sliding_window_view(np.pad(truth, 1, mode="edge"), (3, 3)).reshape(*truth.shape, 9)
    off = np.abs(nearby - depth[..., None]).min(axis=-1)
    assert np.nanmax(off) < 0.03
    assert (jumps(truth) & np.isfinite(depth)).sum() > 500


def test_what_both_cameras_see_has_depth(registered):
    camera, sensor, grid, depth, _, truth = registered
    seen, _ = visible_to_the_sensor(truth, grid, camera, sensor)
    assert seen.sum() > 30000
    assert np.isfinite(depth[seen]).all()


def test_what_a_near_surface_hides_from_the_sensor_has_none(registered):
    camera, sensor, grid, depth, _, truth = registered
    _, hidden = visible_to_the_sensor(truth, grid, camera, sensor)
    hidden &= ~jumps(truth)
    assert hidden.sum() > 500
    assert not np.isfinite(depth[hidden]).any()


def test_the_near_surface_wins(registered):
    # Behind the post and the ball the sensor sees the wall, which the colour camera does not.
    *_, depth, _, truth = registered
    front = (truth < 0.85) & ~jumps(truth) & np.isfinite(depth)
    assert front.sum() > 2000
    assert depth[front].max() < 0.85


def test_noise_goes_with_its_depth(registered):
    *_, depth, noise, truth = registered
    seen = np.isfinite(depth)
    np.testing.assert_array_equal(np.isfinite(noise), seen)
    # the cameras' depths of one point differ by a few millimetres
    seen &= ~jumps(truth)
    np.testing.assert_allclose(noise[seen], 0.002 * depth[seen], rtol=0.03)


def test_the_same_camera_changes_nothing():
    camera = DEPTH[2.0]
    depth = depth_of(camera)
    depth[10:14, 20:30] = np.nan
    found, _ = register(depth, depth, camera, HERE, camera)
    np.testing.assert_allclose(found, depth, rtol=1e-9)


def test_pixels_alone_are_carried_over():
    camera = Camera(9, 7, fx=50.0, fy=50.0, cx=4.0, cy=3.0)
    depth = np.full(camera.shape, np.nan)
    depth[3, 2] = depth[5, 7] = 1.0
    right = RigidTransform(np.eye(3), np.array([0.02, 0.0, 0.0]))  # one pixel
    found, _ = register(depth, depth, camera, right, camera)
    assert np.argwhere(np.isfinite(found)).tolist() == [[3, 3], [5, 8]]


@pytest.mark.parametrize("near_m", [0.0, 1e-9, 0.002, 0.02])
def test_what_touches_the_camera_is_left_out(near_m):
    camera = DEPTH[2.0]
    pose = RigidTransform(np.eye(3), np.array([0.0, 0.0, near_m - 1.0]))
    depth = np.ones(camera.shape)
    depth[:9] = 2.0
    found, _ = register(depth, depth, camera, pose, camera)
    assert np.nanmin(found, initial=np.inf) > 0.9


@pytest.mark.parametrize("shift", [[0, 0, -2.0], [5.0, 0, 0]])
def test_out_of_sight(shift):
    camera = DEPTH[2.0]
    pose = RigidTransform(np.eye(3), np.array(shift))
    found, noise = register(depth_of(camera), np.ones(camera.shape), camera, pose, camera)
    assert np.isnan(found).all()
    assert np.isnan(noise).all()


@pytest.mark.parametrize(
    ("colour", "shape"),
    [
        (Camera(1280, 720, 920.0, 920.0, 639.5, 359.5), (411, 730)),
        (Camera(1296, 968, 1050.0, 1050.0, 647.5, 483.5), (484, 648)),
        (Camera(1280, 960, 1050.0, 1050.0, 639.5, 479.5), (480, 640)),
    ],
)
def test_the_grid_has_the_sensors_pixels_and_the_colour_cameras_view(colour, shape):
    depth = Camera(640, 480, fx=525.0, fy=525.0, cx=319.5, cy=239.5)
    grid = sensor_grid(colour, depth)
    assert grid.shape == shape
    assert grid.fx == pytest.approx(525, rel=2e-3)
    for corner in (-0.5, 0.5):
        at = colour.width * (corner + 0.5) - 0.5
        there = grid.width * (corner + 0.5) - 0.5
        ray = (at - colour.cx) / colour.fx
        assert (there - grid.cx) / grid.fx == pytest.approx(ray, abs=1e-12)


def test_the_grid_of_a_sensor_whose_focal_lengths_differ():
    colour = Camera(1280, 720, fx=920.0, fy=920.0, cx=639.5, cy=359.5)
    depth = Camera(640, 240, fx=525.0, fy=262.5, cx=319.5, cy=119.5)
    assert sensor_grid(colour, depth).shape == (205, 730)
