"""The camera moved between photographs, and what only looks like it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rakelight.capture import load_capture
from rakelight.check import camera_motion as motion
from rakelight.check.alignment import details
from rakelight.check.camera_motion import (
    beside_most,
    camera_motion,
    confirmed,
    stood_still,
    views,
)
from rakelight.check.measured import Measured
from rakelight.model import Camera, Capture
from rakelight.prepare.detail import detail
from tests.check.moved_captures import still_scene, with_photographs_moved
from tests.check.tiled_scene import ball, cloth, tiled_scene

MITTEN = Path(__file__).parents[3] / "shared" / "captures" / "mitten"


@pytest.fixture(scope="module")
def still():
    return still_scene()


@pytest.mark.parametrize(
    ("shape", "albedo", "changes"),
    [
        ("sphere", "pattern", {}),
        ("vase", "complicated", {"cast_shadows": True, "specular": 0.5}),
        ("cloth", "white", {"tilt_deg": (20.0, 60.0)}),
        ("head", "white", {"exposure_spread": 0.5}),
        ("head", "pattern", {"lamp_distance_m": 0.4, "image_noise": 0.05}),
        ("coin", "grey", {"bits": 8, "encoding": "srgb"}),
        ("vase", "pattern", {"lighting": "rgb-leds"}),
    ],
)
def test_lights_and_shadows_are_no_motion_of_the_camera(shape, albedo, changes):
    assert camera_motion(Measured(still_scene(shape, albedo, **changes))) == ()


@pytest.mark.parametrize(("right", "down"), [(1.5, -1.0), (0.0, 2.0), (-9.0, 4.0)])
def test_one_moved_photograph_is_named_with_its_pixels(still, right, down):
    shifts, moved = stood_still(with_photographs_moved(still, [3], right, down))
    assert moved.tolist() == [False, False, False, True, False]
    np.testing.assert_allclose(shifts[3], (right, down), atol=0.15)
    np.testing.assert_allclose(shifts[~moved], 0, atol=0.15)


@pytest.mark.parametrize("which", range(5))
def test_whichever_photograph_moved_the_others_are_at_rest(still, which):
    _, moved = stood_still(with_photographs_moved(still, [which], 0.0, 3.0))
    assert np.flatnonzero(moved).tolist() == [which]


def test_a_bump_moves_all_later_photographs(still):
    (found,) = camera_motion(Measured(with_photographs_moved(still, [3, 4], 2.0, 0.0)))
    assert (found.severity, found.code) == ("warning", "camera-moved")
    assert "003.png, 004.png shifted by 2." in found.message
    assert "2.0 right" in found.message or "1.9 right" in found.message


def test_photographs_beside_each_other_by_less_than_they_tell_are_not_named(still):
    assert camera_motion(Measured(with_photographs_moved(still, [1], 0.3, 0.0))) == ()


@pytest.mark.skipif(not MITTEN.exists(), reason="the real captures are not here")
def test_the_mitten_stood_still_and_a_pixel_is_seen():
    mitten = load_capture(MITTEN)
    assert camera_motion(Measured(mitten)) == ()
    shifts, moved = stood_still(with_photographs_moved(mitten, [7], 0.0, 1.5))
    assert np.flatnonzero(moved).tolist() == [7]
    np.testing.assert_allclose(shifts[7], (0, 1.5), atol=0.3)


def test_shifts_that_scatter_by_shadows_are_no_motion():
    rng = np.random.default_rng(0)
    scattered = 0.28 * rng.standard_normal((16, 2))
    scattered[7] = (0.0, 0.7)

    def tracked(shifts):
        return np.flatnonzero(beside_most(shifts)[1]).tolist()

    assert tracked(scattered) == []
    assert tracked(0.2 * scattered + [[0.7 * (i == 7), 0] for i in range(16)]) == [7]
    assert tracked(scattered + [[2.0 * (i == 7), 0] for i in range(16)]) == [7]


def test_nothing_is_said_of_few_photographs_of_a_surface_without_texture():
    bare = still_scene("head", "white", cast_shadows=True, ambient=0.0)
    shifts, moved = stood_still(with_photographs_moved(bare, [2], 3.0, 0.0))
    assert np.isnan(shifts[2]).all()
    assert not moved.any()


def test_many_photographs_of_one_show_it_by_its_outline_and_relief():
    bare = still_scene("head", "white", photographs=12)
    assert camera_motion(Measured(bare)) == ()
    shifts, moved = stood_still(with_photographs_moved(bare, [2], 3.0, 0.0))
    assert np.flatnonzero(moved).tolist() == [2]
    np.testing.assert_allclose(shifts[2], (3.0, 0.0), atol=0.15)


def test_of_two_photographs_none_is_known_to_have_moved(still):
    two = with_photographs_moved(still.select([0, 1]), [1], 3.0, 0.0)
    shifts, moved = stood_still(two)
    assert np.isnan(shifts).all()
    assert not moved.any()


def test_black_beside_texture_has_no_detail():
    photograph = np.zeros((112, 110, 3), np.uint8)
    photograph[8:59, 13:67] = np.random.default_rng(0).integers(0, 255, (51, 54, 3))
    picture = detail(photograph)
    assert (picture[-10:] == 128).all()
    assert picture[8:59, 13:67].std() > 20


def test_black_photographs_and_tiny_ones_say_nothing(still):
    assert camera_motion(Measured(still_scene(size=0.05))) == ()
    black = replace(still, photographs=np.zeros_like(still.photographs))
    assert camera_motion(Measured(black)) == ()


@pytest.mark.parametrize(("dimmed", "expected"), [(0.2, [3]), (0.02, [])])
def test_a_photograph_that_the_lamp_hardly_reaches_is_not_judged(still, dimmed, expected):
    moved = with_photographs_moved(still, [3], 3.0, 0.0)
    photographs = moved.photographs.copy()
    photographs[3] = np.rint(dimmed * photographs[3])
    _, found = stood_still(replace(moved, photographs=photographs))
    assert np.flatnonzero(found).tolist() == expected


@pytest.mark.parametrize("relief", [cloth, ball])
def test_shading_that_moves_over_a_relief_is_no_motion(relief):
    assert camera_motion(Measured(tiled_scene(relief))) == ()


def test_a_shift_that_moves_paint_and_outline_apart_is_not_confirmed():
    """The shading of a cloth is that of a photograph moved by a wave of it."""
    capture = tiled_scene(cloth)
    _, view = views(capture.mask)
    third = np.arange(12)[:, None] == 2

    def bands(capture):
        return details([view.light(each, capture.encoding) for each in capture.photographs])

    for wave in ((10.0, 0.0), (-10.0, 1.0), (1.0, 2.0)):
        assert not confirmed(bands(capture), third * np.array(wave), third[:, 0])
    moved = with_photographs_moved(capture, [2], 1.0, 2.0)
    assert confirmed(bands(moved), third * np.array((1.0, 2.0)), third[:, 0])


@pytest.mark.parametrize("relief", [cloth, ball])
def test_a_wall_behind_the_object_shows_a_camera_that_drifts(relief):
    capture = tiled_scene(relief)
    for i in range(len(capture.photographs)):
        capture = with_photographs_moved(capture, [i], 0.29 * i, 0.2 * i)
    (found,) = camera_motion(Measured(capture))
    assert found.code == "camera-moved"
    _, moved = stood_still(capture)
    assert moved.sum() >= 5
    assert moved[[0, -1]].any()


def test_one_photograph_moved_before_tiles_is_named_alone():
    shifts, moved = stood_still(with_photographs_moved(tiled_scene(ball), [5], 1.5, 1.3))
    assert np.flatnonzero(moved).tolist() == [5]
    np.testing.assert_allclose(shifts[5], (1.5, 1.3), atol=0.1)


@pytest.mark.parametrize("value", [65535, 32768, 0])
def test_a_photograph_that_shows_nothing_has_not_moved(value):
    capture = with_photographs_moved(still_scene(size=0.6), [3], 2.0, 0.0)
    capture.photographs[1] = value
    shifts, moved = stood_still(capture)
    assert np.flatnonzero(moved).tolist() == [3]
    assert np.isnan(shifts[1]).all()
    np.testing.assert_allclose(shifts[3], (2.0, 0.0), atol=0.15)


def test_of_few_photographs_of_a_bare_object_the_first_can_have_moved():
    bare = still_scene("sphere", "white", photographs=6)
    assert camera_motion(Measured(bare)) == ()
    shifts, moved = stood_still(with_photographs_moved(bare, [0], 8.0, -4.0))
    assert moved[0]
    np.testing.assert_allclose(shifts[0], (8.0, -4.0), atol=2.0)


def test_shifts_are_in_the_photographs_pixels_however_large_they_are(monkeypatch):
    texture = np.random.default_rng(0).random((400, 500)).astype(np.float32)
    texture = cv2.GaussianBlur(texture, (0, 0), 4)
    texture = (texture - texture.min()) / np.ptp(texture)
    shown = [np.roll(texture, 6 * (i == 2), axis=1) * (0.5 + 0.05 * i) for i in range(6)]
    values = np.rint(255 * np.stack(shown)).astype(np.uint8)[..., None].repeat(3, -1)
    mask = np.zeros((400, 500), bool)
    mask[150:250, 200:300] = True
    camera = Camera(500, 400, fx=400.0, fy=400.0, cx=249.5, cy=199.5)
    capture = Capture(values, np.ones((1, 400, 500), np.float32), mask, camera, "linear")
    monkeypatch.setattr(motion, "SIDE_PX", 100)
    shifts, moved = motion.stood_still(capture)
    assert np.flatnonzero(moved).tolist() == [2]
    np.testing.assert_allclose(shifts[2], [6, 0], atol=0.7)
