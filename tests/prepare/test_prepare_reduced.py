from dataclasses import replace

import numpy as np
import pytest

from rakelight.model import Camera, Capture, RigidTransform
from rakelight.prepare import prepare
from rakelight.prepare.reduced import joined, reduced
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene
from tests.check.moved_captures import still_scene


@pytest.mark.parametrize("changes", [{}, {"depth_factor": 1}, {"depth_factor": 4}])
def test_a_reduced_capture_shows_the_same_object(changes):
    capture = still_scene(**changes)
    small = reduced(capture, 800)
    assert 300 < small.mask.sum() <= 1000
    assert np.nanmedian(small.depth_m) == pytest.approx(np.nanmedian(capture.depth_m), rel=0.01)
    points = [prepare(each) for each in (capture, small)]
    wide = [np.ptp(np.nonzero(p.mask)[1]) / p.camera.fx for p in points]
    assert wide[1] == pytest.approx(wide[0], rel=0.1)


def test_a_small_capture_is_only_cut():
    capture = still_scene()
    cut = reduced(capture, 10**6)
    assert cut.mask.sum() == capture.mask.sum()
    assert cut.mask.shape < capture.mask.shape
    assert cut.photographs.dtype == capture.photographs.dtype


def test_depth_of_another_camera():
    beside = RigidTransform(np.eye(3), np.array([0.02, 0.0, 0.0]))
    vase = make_shape("vase")
    options = SceneOptions(
        camera=vase.camera.scaled(0.4), photographs=4, depth_factor=1.7, depth_to_color=beside
    )
    capture, _ = render_scene(vase, make_albedo("pattern"), options)
    small = reduced(capture, 900)
    assert small.depth_camera.shape == small.depth_m.shape[1:]
    assert prepare(small).measured.mean() > 0.3


def test_aligned_depth_with_a_fraction_of_a_depth_pixel_in_a_colour_pixel():
    vase, here = make_shape("vase"), RigidTransform(np.eye(3), np.zeros(3))
    options = SceneOptions(
        camera=vase.camera.resized(360, 270), photographs=4, depth_factor=7.5, depth_to_color=here
    )
    placed, _ = render_scene(vase, make_albedo("pattern"), options)
    capture = replace(placed, depth_camera=None, depth_to_color=None)
    small, same = reduced(capture, 3000), reduced(placed, 3000)
    assert 1500 < small.mask.sum() <= 3600
    assert small.depth_camera == same.depth_camera
    assert np.array_equal(small.depth_m, same.depth_m, equal_nan=True)


def test_a_thin_object_is_not_lost():
    capture = still_scene()
    thin = np.zeros_like(capture.mask)
    thin[40:100, 90:92] = True
    assert reduced(replace(capture, mask=thin), 30).mask.any()


def test_blocks_at_a_jump_keep_the_nearer_surface():
    depth = np.full((1, 4, 4), 1.0)
    depth[:, :, 1:] = 2.0
    np.testing.assert_allclose(joined(depth, 2)[0], [[1.0, 2.0]] * 2)


def test_a_reduced_mask_is_the_object_alone():
    mask = np.zeros((40, 40), bool)
    mask[9:31, 9:31] = True
    camera = Camera(40, 40, fx=50.0, fy=50.0, cx=19.5, cy=19.5)
    depth_m = np.ones((1, 40, 40), np.float32)
    small = reduced(Capture(np.full((3, 40, 40, 3), 9, np.uint8), depth_m, mask, camera), 60)
    side = round(50 / small.camera.fx)
    assert side > 1
    assert small.mask.sum() * side**2 <= mask.sum()
