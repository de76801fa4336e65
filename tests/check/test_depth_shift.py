"""Depth that is not registered to the photographs, and what only looks like it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rakelight.capture import load_capture
from rakelight.check.depth_shift import depth_shift
from rakelight.check.measured import Measured
from rakelight.check.outline import displacement, seen_by_sensor
from rakelight.errors import CaptureError
from rakelight.model import RigidTransform
from rakelight.synthetic import DepthNoise
from tests.check.moved_captures import still_scene, with_depth_moved

CAPTURES = Path(__file__).parents[3] / "shared" / "captures"
BESIDE = RigidTransform(np.eye(3), np.array([0.05, 0.0, 0.0]))


@pytest.fixture(scope="module")
def registered():
    return still_scene()


@pytest.mark.parametrize(
    ("shape", "changes"),
    [
        ("sphere", {}),
        ("head", {"depth_factor": 1}),
        ("vase", {"depth_factor": 4}),
        ("cloth", {}),
        ("coin", {}),
        ("vase", {"depth_factor": 1.7, "depth_to_color": BESIDE}),
    ],
)
def test_registered_depth_is_not_doubted(shape, changes):
    assert depth_shift(Measured(still_scene(shape, **changes))) == ()


@pytest.mark.parametrize(
    ("right", "down", "told"),
    [
        (3, -2, "7 pixels (6 right, 4 up)"),
        (-3, 1, "6 pixels (6 left, 2 down)"),
        (2, 3, "7 pixels (4 right, 6 down)"),
    ],
)
def test_shifted_depth_is_told_with_the_photographs_pixels(registered, right, down, told):
    (found,) = depth_shift(Measured(with_depth_moved(registered, right, down)))
    assert (found.severity, found.code) == ("warning", "depth-shifted")
    assert found.message.endswith(f"shifted by about {told}")
    assert found.remedy.startswith("register = true in capture.toml")


def test_depth_of_another_place_is_refused(registered):
    with pytest.raises(CaptureError, match="20 right") as refused:
        depth_shift(Measured(with_depth_moved(registered, 10, 0)))
    assert "not registered" in str(refused.value)
    assert "needed less than 10 pixels" in str(refused.value)


def test_registering_is_not_advised_where_it_was_done_or_cannot_be(registered):
    moved = with_depth_moved(registered, 3, 0)
    for capture in (replace(moved, register=True), moved.select([0])):
        (found,) = depth_shift(Measured(capture))
        assert found.remedy.startswith("give the depth camera's own")


@pytest.mark.parametrize("wider", [-5, 5, 9])
def test_a_mask_drawn_too_wide_or_too_narrow_is_no_shift(registered, wider):
    ball = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (abs(wider), abs(wider)))
    change = cv2.dilate if wider > 0 else cv2.erode
    mask = change(registered.mask.astype(np.uint8), ball) > 0
    assert depth_shift(Measured(replace(registered, mask=mask))) == ()


def test_a_depth_pixel_is_not_told(registered):
    assert depth_shift(Measured(with_depth_moved(registered, 1, 0))) == ()


def ending_early(capture, lost):
    """The capture without the depth of the last pixels before what has none, from the left."""
    depth = capture.depth_m.copy()
    depth[:, :, :-lost][np.isnan(capture.depth_m[:, :, lost:])] = np.nan
    return replace(capture, depth_m=depth)


@pytest.mark.parametrize("lost", [2, 4, 6])
def test_depth_that_ends_early_on_one_side_is_no_shift(lost):
    assert depth_shift(Measured(ending_early(still_scene(depth_noise=DepthNoise()), lost))) == ()


@pytest.mark.parametrize("name", ["mitten", "android", "monkey"])
def test_real_captures_are_not_doubted(name):
    if not (CAPTURES / name).exists():
        pytest.skip("the real captures are not here")
    capture = load_capture(CAPTURES / name)
    capture = replace(capture, depth_m=capture.depth_m[:1])
    assert depth_shift(Measured(capture)) == ()
    assert depth_shift(Measured(ending_early(capture, 4))) == ()
    assert depth_shift(Measured(with_depth_moved(capture, 10, 0)))[0].code == "depth-shifted"


def test_an_object_on_a_table_at_its_depth_is_no_shift(registered):
    depth = registered.depth_m.copy()
    bottom = np.nonzero(registered.mask.any(axis=1))[0].max() // 2
    depth[:, bottom - 3 :] = np.nanmedian(depth)
    assert depth_shift(Measured(replace(registered, depth_m=depth))) == ()


def test_a_mask_of_half_the_object_is_no_shift(registered):
    rows, columns = np.mgrid[:144, :192]
    for half in (rows < 72, columns > 96):
        assert depth_shift(Measured(replace(registered, mask=registered.mask & half))) == ()


def test_thin_objects_are_found_far_away():
    mask = np.zeros((80, 120), dtype=bool)
    mask[20:60, 30:33] = True
    mask[20:60, 40:43] = True
    mask[38:42, 30:43] = True
    found = displacement(mask, np.roll(mask, 9, axis=1))
    np.testing.assert_allclose(found.shift, (9, 0), atol=0.05)


def test_what_else_is_at_the_objects_depth_does_not_pull_the_shift():
    mask = np.zeros((90, 120), dtype=bool)
    mask[20:60, 30:70] = True
    seen = np.roll(mask, (3, 5), axis=(0, 1))
    seen[55:89, :119] = True  # a table
    np.testing.assert_allclose(displacement(mask, seen).shift, (5, 3), atol=1.2)


def test_an_outline_at_the_images_end_says_nothing():
    everything = np.ones((60, 80), dtype=bool)
    assert displacement(everything, np.eye(60, 80, dtype=bool)) is None
    assert displacement(np.eye(60, 80, dtype=bool), everything) is None


def test_the_object_in_depth_is_what_the_mask_holds(registered):
    around = ~registered.mask.reshape(72, 2, 96, 2).any(axis=(1, 3))
    wall = np.where(around, np.float32(1.5), registered.depth_m)
    seen, factor = seen_by_sensor(replace(registered, depth_m=wall))
    assert factor == 2
    assert not (seen & around).any()
    assert (seen | around).mean() > 0.95


def test_a_low_relief_that_is_one_with_its_background_has_no_shift():
    """Where the depth shows object and wall as one, the best fit lies outside the image."""
    mask = np.zeros((190, 170), dtype=bool)
    mask[20:170, 25:150] = True
    seen = np.ones_like(mask)
    seen[:, :2] = False
    assert displacement(mask, seen) is None
