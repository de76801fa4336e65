"""The camera moved between photographs, and what only looks like it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rakelight.capture import load_capture
from rakelight.check.camera_motion import camera_motion, detail, stood_still
from rakelight.check.measured import Measured
from tests.check.moved_captures import still_scene, with_photographs_moved

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


def test_shifts_that_scatter_by_shadows_are_no_motion(still, monkeypatch):
    rng = np.random.default_rng(0)
    scattered = 0.28 * rng.standard_normal((16, 2))
    scattered[7] = (0.0, 0.7)
    many = replace(still, photographs=np.repeat(still.photographs[:1], 16, axis=0))

    def tracked(shifts):
        answer = shifts.copy(), np.full(16, 0.1)
        monkeypatch.setattr("rakelight.check.camera_motion._tracked", lambda *_: answer)
        return np.flatnonzero(stood_still(many)[1]).tolist()

    assert tracked(scattered) == []
    assert tracked(0.2 * scattered + [[0.7 * (i == 7), 0] for i in range(16)]) == [7]
    assert tracked(scattered + [[2.0 * (i == 7), 0] for i in range(16)]) == [7]


def test_nothing_is_said_of_a_surface_without_texture():
    bare = still_scene("head", "white", cast_shadows=True, ambient=0.0)
    shifts, moved = stood_still(with_photographs_moved(bare, [2], 3.0, 0.0))
    assert np.isnan(shifts).all()
    assert not moved.any()


def test_black_beside_texture_has_no_detail():
    photograph = np.zeros((112, 110, 3), np.uint8)
    photograph[8:59, 13:67] = np.random.default_rng(0).integers(0, 255, (51, 54, 3))
    picture = detail(photograph, 1)
    assert (picture[-10:] == 128).all()
    assert picture[8:59, 13:67].std() > 20


def test_black_photographs_and_tiny_ones_say_nothing(still):
    assert camera_motion(Measured(still_scene(size=0.05))) == ()
    black = replace(still, photographs=np.zeros_like(still.photographs))
    assert camera_motion(Measured(black)) == ()
