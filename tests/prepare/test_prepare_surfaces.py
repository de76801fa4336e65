"""Connected surfaces, and the background that shows at the object's border."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.model import Camera
from rakelight.prepare import prepare
from rakelight.prepare.surfaces import beside_the_object, surfaces
from rakelight.synthetic.implicit import Solid, trace
from tests.prepare.test_prepare_mask import COLOUR, ball, ring, scene, table, union, wall

CAMERA = Camera(12, 9, fx=100.0, fy=100.0, cx=5.5, cy=4.0)


def test_surfaces_end_at_jumps_and_holes():
    depth = np.full(CAMERA.shape, 1.0)
    depth[:, 4:] = 1.5
    depth[5, 4:] = np.nan
    depth[7, 9] = 1.0
    parts, count = surfaces(depth, CAMERA)
    assert count == 4
    assert (parts == -1).sum() == 8
    for part, size in ((np.s_[:, :4], 36), (np.s_[:5, 4:], 40), (np.s_[7:8, 9:10], 1)):
        assert (parts == parts[part].flat[0]).sum() == size
    assert surfaces(np.full((3, 4), np.nan), CAMERA)[1] == 0


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
    found = beside_the_object(depth, touched, covered, CAMERA)
    expected = touched & ~covered & (depth > 1)
    expected[4, 9:12] = False
    np.testing.assert_array_equal(found, expected)
    # of one surface with what is covered
    assert not beside_the_object(np.ones(CAMERA.shape), touched, covered, CAMERA).any()


def test_thin_parts_of_the_objects_surface_stay():
    # What lies between them is not in the mask.
    covered = np.zeros(CAMERA.shape, bool)
    covered[4:8, 2:9] = True
    touched = covered.copy()
    touched[2, 2:9] = True
    depth = np.repeat(1 + 0.005 * np.arange(9.0)[::-1, None], 12, axis=1)
    assert not beside_the_object(depth, touched, covered, CAMERA).any()
