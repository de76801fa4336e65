"""Whether the way to a lamp is free, against geometry that can be said in words."""

import numpy as np
import pytest

from rakelight.geometry.camera import back_project
from rakelight.model import Camera
from rakelight.photometry.cast_shadows import CLEARANCE_PX, in_sight

CAMERA = Camera(200, 20, fx=400.0, fy=400.0, cx=99.5, cy=9.5)
WALL_M, GROUND_M = 0.49, 0.50


def step():
    """(H, W) depth: a block 10 mm high over the left half."""
    return np.where(np.arange(200) < 100, WALL_M, GROUND_M) + np.zeros((20, 1))


def dark_columns(way):
    """(W,) columns of the middle row that a lamp does not reach."""
    depth = step()
    points = back_project(depth, CAMERA)[10]
    return ~in_sight(depth, CAMERA, points, np.broadcast_to(way(points), points.shape))


@pytest.mark.parametrize("slant_deg", [30, 45, 60])
def test_a_shadow_is_as_long_as_the_height_times_the_slant(slant_deg):
    slant = np.radians(slant_deg)
    dark = dark_columns(lambda points: 100 * np.array([-np.sin(slant), 0.0, -np.cos(slant)]))
    height_m = GROUND_M - WALL_M - CLEARANCE_PX * GROUND_M / CAMERA.fx
    length = height_m * np.tan(slant) * CAMERA.fx / GROUND_M
    assert not dark[:100].any()
    assert np.count_nonzero(dark) == pytest.approx(length, abs=1.5)
    assert dark[100 : 100 + int(length)].all()


def test_a_lamp_on_the_open_side_casts_none():
    assert not dark_columns(lambda points: 100 * np.array([0.6, 0.0, -0.8])).any()


def test_a_near_lamp_stands_at_its_place():
    lamp = np.array([-0.1, 0.0, 0.3])
    dark = dark_columns(lambda points: lamp - points)
    # Its ray over the rim, at x = 0, goes on to the ground behind.
    ground_m = GROUND_M - CLEARANCE_PX * GROUND_M / CAMERA.fx
    length = 0.1 * (ground_m - WALL_M) / (WALL_M - lamp[2]) * CAMERA.fx / GROUND_M
    assert np.count_nonzero(dark) == pytest.approx(length, abs=1.5)


def test_nothing_outside_the_object_hides_a_lamp():
    depth = step()
    depth[:, :100] = np.nan
    points = back_project(step(), CAMERA)[10, 100:]
    way = np.broadcast_to([-80.0, 0.0, -60.0], points.shape)
    assert in_sight(depth, CAMERA, points, way).all()


def dark_in_a_column(upside_down):
    """(200,) pixels that a step of 10 mm shades, the light from the side of the first rows."""
    camera = Camera(20, 200, fx=400.0, fy=300.0, cx=9.5, cy=99.5)
    depth = np.where(np.arange(200) < 60, 0.49, 0.5)[:, None] + np.zeros((1, 20))
    depth, down = (depth[::-1], -1) if upside_down else (depth, 1)
    points = back_project(depth, camera)[:, 10]
    way = 100 * np.array([0.0, -down * np.sin(np.pi / 4), -np.cos(np.pi / 4)])
    return ~in_sight(depth, camera, points, np.broadcast_to(way, points.shape))[::down]


@pytest.mark.parametrize("upside_down", [False, True])
def test_a_shadow_along_a_column_is_as_long_as_it_should_be(upside_down):
    dark = dark_in_a_column(upside_down)
    length = (0.01 - CLEARANCE_PX * 0.5 / 400) * 300 / 0.5
    assert not dark[:60].any()
    assert dark[60 : 60 + int(length)].all()
    assert np.count_nonzero(dark) == pytest.approx(length, abs=1.5)


def test_shadows_up_and_down_are_alike():
    assert np.count_nonzero(dark_in_a_column(False)) == np.count_nonzero(dark_in_a_column(True))


def test_rays_that_leave_at_the_top_are_free():
    camera = Camera(20, 200, fx=400.0, fy=400.0, cx=9.5, cy=99.5)
    depth = np.where(np.arange(200) < 100, 0.5, 0.49)[:, None] + np.zeros((1, 20))
    points = back_project(depth, camera)[:50].reshape(-1, 3)
    way = np.broadcast_to([0.0, -80.0, -60.0], points.shape)
    assert in_sight(depth, camera, points, way).all()
