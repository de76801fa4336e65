from dataclasses import replace

import numpy as np
import pytest

from rakelight.check.depth_orientation import (
    SURELY,
    depth_orientation,
    explained,
    orientation_fits,
)
from rakelight.errors import CaptureError
from tests.check.wrong_captures import SOLIDS, noise_alone, one_lamp, sound, with_turned_photographs


@pytest.mark.parametrize("shape", SOLIDS)
def test_a_sound_capture_lies_right(shape):
    capture, _ = sound(shape)
    assert depth_orientation(capture) == ()
    assert max(fit.evidence for fit in orientation_fits(capture)) < SURELY / 2


@pytest.mark.parametrize("shape", SOLIDS)
def test_turned_photographs_are_refused_with_the_turn_that_fits(shape):
    capture, _ = sound(shape)
    turned = replace(capture, photographs=np.ascontiguousarray(capture.photographs[:, ::-1, ::-1]))
    # The vase looks the same in a mirror: of what fits, the turn is named.
    with pytest.raises(CaptureError, match="turned by 180 degrees") as error:
        depth_orientation(turned)
    assert "give the depth" in error.value.remedy


def test_the_mask_may_be_turned_with_the_photographs():
    capture, _ = sound("head")
    with pytest.raises(CaptureError, match="180 degrees"):
        depth_orientation(with_turned_photographs(capture, lambda image: image[::-1, ::-1]))


def test_mirrored_photographs_are_refused():
    capture, _ = sound("head")
    with pytest.raises(CaptureError, match="left to right"):
        depth_orientation(with_turned_photographs(capture, lambda image: image[:, ::-1]))


@pytest.mark.parametrize(
    ("turn", "words"), [(1, "by 90 degrees clockwise"), (-1, "by 90 degrees anticlockwise")]
)
def test_a_quarter_turn_is_named_where_the_image_is_square(turn, words):
    capture, _ = sound("head")
    side = min(capture.mask.shape)
    start = (np.array(capture.mask.shape) - side) // 2
    window = tuple(slice(at, at + side) for at in start)
    square = replace(
        capture,
        photographs=np.ascontiguousarray(capture.photographs[:, *window]),
        mask=np.ascontiguousarray(capture.mask[window]),
        depth_m=np.ascontiguousarray(capture.depth_m[:, *window]),
        camera=capture.camera.cropped(*window),
    )
    assert depth_orientation(square) == ()
    with pytest.raises(CaptureError, match=words):
        # What turns the depth back is the turn that was given to the photographs.
        depth_orientation(with_turned_photographs(square, lambda image: np.rot90(image, -turn)))


@pytest.mark.parametrize("change", [one_lamp, noise_alone])
def test_photographs_without_information_say_nothing_of_it(change):
    capture, _ = sound("head")
    assert depth_orientation(change(capture)) == ()


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_photographs_say_nothing(count):
    capture, _ = sound("head")
    assert orientation_fits(capture.select(range(count))) == []


def test_an_explanation_of_unrelated_slopes_is_small():
    rng = np.random.default_rng(0)
    slopes, components = rng.normal(size=(2000, 2)), rng.normal(size=(3, 2000))
    assert explained(slopes, components) < 0.01
    assert explained(slopes + (3 * components[:1]).T, components) == pytest.approx(0.9, abs=0.02)
