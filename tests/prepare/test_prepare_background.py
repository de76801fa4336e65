"""The background that shows at the object's border."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from rakelight.model import Camera
from rakelight.prepare import prepare
from rakelight.prepare.background import LEAST_PART, beside_the_object
from rakelight.synthetic.implicit import Solid, trace
from tests.prepare.test_prepare_mask import COLOUR, ball, ring, scene, table, union, wall

CAMERA = Camera(12, 9, fx=100.0, fy=100.0, cx=5.5, cy=4.0)


@pytest.mark.parametrize("things", [(ball, wall), (ball, table, wall), (ring, wall)])
def test_the_wall_at_the_objects_border_is_not_its_depth(things):
    capture, mask = scene(*things)
    truth = trace(Solid(union(*things), 0.8, radius_m=0.75, steepness=1.1), COLOUR).depth
    prepared = prepare(replace(capture, mask=mask))
    error = np.abs(prepared.embed(prepared.depth_m, np.nan) - truth)[mask]
    assert (error > 0.02).mean() < 0.01
    assert error.max() < 0.06
    assert np.nanmax(prepared.sensor.depth_m) < 0.85


def test_what_is_before_or_far_from_the_object_stays():
    covered = np.zeros(CAMERA.shape, bool)
    covered[2:7, 2:5] = True
    touched = np.zeros(CAMERA.shape, bool)
    touched[1:8, 1:6] = True
    touched[4, 9:12] = True  # a thin part of its own
    depth = np.where(covered, 1.0, 1.5)
    depth[1, 1:6] = 0.7  # nearer than the object: it may be its rim
    found = beside_the_object(depth, touched, covered, CAMERA, 1)
    expected = touched & ~covered & (depth > 1)
    expected[4, 9:12] = False
    np.testing.assert_array_equal(found, expected)
    # of one surface with what is covered
    assert not beside_the_object(np.ones(CAMERA.shape), touched, covered, CAMERA, 1).any()


def test_thin_parts_of_the_objects_surface_stay():
    # What lies between them is not in the mask.
    covered = np.zeros(CAMERA.shape, bool)
    covered[4:8, 2:9] = True
    touched = covered.copy()
    touched[2, 2:9] = True
    depth = np.repeat(1 + 0.005 * np.arange(9.0)[::-1, None], 12, axis=1)
    assert not beside_the_object(depth, touched, covered, CAMERA, 1).any()


@pytest.mark.parametrize("by_px", [-1, 1])  # of its own pixels, two of the photographs
@pytest.mark.parametrize("things", [(ball, wall), (ball, table, wall), (ring, wall)])
def test_the_wall_is_not_the_objects_depth_where_the_depth_map_is_shifted(things, by_px):
    capture, mask = scene(*things)
    factor = mask.shape[1] // capture.depth_m.shape[2]
    depth = np.roll(capture.depth_m, by_px, axis=2)
    prepared = prepare(replace(capture, mask=mask, depth_m=depth))
    truth = trace(Solid(union(*things), 0.8, radius_m=0.75, steepness=1.1), COLOUR).depth
    # No deeper than the farthest of the true object near each pixel.
    reach = 2 * factor * abs(by_px) + 7
    farthest = maximum_filter(np.where(mask, truth, -np.inf), reach)
    off = (prepared.embed(prepared.depth_m, np.nan) - farthest)[mask]
    assert (off > 0.02).mean() < 0.002
    assert off.max() < 0.05


def test_the_border_is_of_the_photographs_as_they_are_at_every_scale(monkeypatch):
    factors = []

    def seen(depth_m, touched, covered, camera, factor):
        factors.append(factor)
        return np.zeros_like(touched)

    monkeypatch.setattr("rakelight.prepare.beside_the_object", seen)
    capture, mask = scene(ball, wall)
    for scale in (1, 2):
        prepare(replace(capture, mask=mask), scale)
    assert factors == [2.0, 2.0]


def test_only_a_narrow_rim_behind_the_object_is_left_out():
    # The mask ends in the middle of a surface, and a step in front of it lies well inside.
    depth = np.full((20, 30), 1.0)
    depth[:, 12:18] = 0.8
    touched = np.zeros(depth.shape, bool)
    touched[2:18, 4:26] = True
    camera = Camera(30, 20, fx=100.0, fy=100.0, cx=14.5, cy=9.5)
    assert not beside_the_object(depth, touched, touched, camera, 1).any()
    # A rim of three pixels behind it goes; one of four may be the object's.
    for rim, gone in ((3, True), (4, False)):
        narrow = touched.copy()
        narrow[:, : 12 - rim] = False
        narrow[:, 18 + rim :] = False
        found = beside_the_object(depth, narrow, narrow, camera, 1)
        expected = narrow & (depth == 1.0) if gone else np.zeros_like(narrow)
        middle = np.s_[8:12]  # the corners are nearer to the mask's ends
        np.testing.assert_array_equal(found[middle], expected[middle])


def test_a_handle_behind_the_object_keeps_its_depth():
    depth = np.full((20, 30), np.nan)
    depth[4:16, 4:16] = 0.8
    depth[8:10, 16:24] = 0.9
    touched = np.isfinite(depth)
    camera = Camera(30, 20, fx=100.0, fy=100.0, cx=14.5, cy=9.5)
    assert not beside_the_object(depth, touched, touched, camera, 1).any()
    # before a wall that is a jump behind it, too
    whole = np.where(touched, depth, 1.5)
    assert not beside_the_object(whole, touched, touched, camera, 1).any()
    # on a table that carries it on, it cannot be told from the table
    whole = np.where(touched, depth, 0.9)
    assert beside_the_object(whole, touched, touched, camera, 1)[8:10, 16:19].all()


@pytest.mark.parametrize("count", [1, LEAST_PART - 1, LEAST_PART])
@pytest.mark.parametrize("background_m", [1.5, np.nan])
def test_flying_pixels_that_agree_are_left_out(count, background_m):
    # Some pixels of the rim lie at the same depth, between the object and the wall.
    camera = Camera(30, 20, fx=100.0, fy=100.0, cx=14.5, cy=9.5)
    touched = np.zeros((20, 30), bool)
    touched[4:16, 4:16] = True
    depth = np.where(touched, 0.8, background_m)
    depth[6 : 6 + count, 15] = 1.1  # inside the mask
    depth[6, 16:18] = 1.1  # and beyond it
    found = beside_the_object(depth, touched, touched, camera, 1)
    # Without a wall, or more of them, they may be a part of the object.
    flying = count < LEAST_PART and np.isfinite(background_m)
    np.testing.assert_array_equal(found, touched & (depth == 1.1) & flying)
