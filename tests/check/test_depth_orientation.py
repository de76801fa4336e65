from dataclasses import replace

import numpy as np
import pytest

from rakelight import check_capture, refine
from rakelight.check.depth_orientation import (
    depth_orientation,
    evidence,
    orientation_fits,
    total,
    unexplained,
)
from rakelight.check.depth_shift import depth_shift
from rakelight.check.evidence import LIKELY, SURELY
from rakelight.check.measured import Measured
from rakelight.errors import CaptureError
from rakelight.model import RigidTransform
from tests.check.tiled_scene import ball, cloth, mask_shape, tiled_scene, with_depth_turned
from tests.check.wrong_captures import SOLIDS, noise_alone, one_lamp, sound, with_turned_photographs


@pytest.mark.parametrize("shape", SOLIDS)
def test_a_sound_capture_lies_right(shape):
    capture, _ = sound(shape)
    assert depth_orientation(Measured(capture)) == ()
    assert max(fit.evidence for fit in orientation_fits(capture)) < LIKELY


@pytest.mark.parametrize("shape", SOLIDS)
def test_turned_photographs_are_refused_with_the_turn_that_fits(shape):
    capture, _ = sound(shape)
    turned = replace(capture, photographs=np.ascontiguousarray(capture.photographs[:, ::-1, ::-1]))
    # The vase looks the same in a mirror: of what fits, the turn is named.
    with pytest.raises(CaptureError, match="turned by 180 degrees") as error:
        depth_orientation(Measured(turned))
    assert "give the depth" in error.value.remedy


def test_the_mask_may_be_turned_with_the_photographs():
    turned = with_turned_photographs(sound("head")[0], lambda image: image[::-1, ::-1])
    with pytest.raises(CaptureError, match="180 degrees"):
        depth_orientation(Measured(turned))


def test_mirrored_photographs_are_refused():
    capture, _ = sound("head")
    with pytest.raises(CaptureError, match="left to right"):
        depth_orientation(Measured(with_turned_photographs(capture, lambda image: image[:, ::-1])))


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
    assert depth_orientation(Measured(square)) == ()
    turned = with_turned_photographs(square, lambda image: np.rot90(image, -turn))
    with pytest.raises(CaptureError, match=words):
        # What turns the depth back is the turn that was given to the photographs.
        depth_orientation(Measured(turned))


@pytest.mark.parametrize("change", [one_lamp, noise_alone])
def test_photographs_without_information_say_nothing_of_it(change):
    capture, _ = sound("head")
    assert depth_orientation(Measured(change(capture))) == ()


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_photographs_say_nothing(count):
    capture, _ = sound("head")
    assert orientation_fits(capture.select(range(count))) == []


def test_an_explanation_of_unrelated_slopes_is_small():
    rng = np.random.default_rng(0)
    slopes, components = rng.normal(size=(2000, 2)), rng.normal(size=(3, 2000))
    assert unexplained(slopes, components).sum() > 0.99 * total(slopes)
    mostly = slopes + (3 * components[:1]).T
    assert unexplained(mostly, components).sum() == pytest.approx(0.1 * total(mostly), rel=0.2)


def test_what_one_corner_says_is_no_evidence():
    both = np.ones((60, 60), bool)
    better, everywhere = np.ones((2, 60, 60)) + 0.01 * np.random.default_rng(0).random((2, 60, 60))
    as_it_is = 1.5 * np.ones((60, 60))
    better[:10, :10] = 0.1
    corner = evidence(np.ones(3600), better.ravel(), both)
    assert 0 < corner < LIKELY
    assert evidence(as_it_is.ravel(), everywhere.ravel(), both) > SURELY


@pytest.mark.parametrize("relief", [cloth, mask_shape])
def test_half_a_turn_of_an_object_off_the_middle_is_no_shift(relief):
    """Its outline lies beside the mask, and turned back on it."""
    capture = with_depth_turned(tiled_scene(relief, off_px=8), lambda depth: depth[::-1, ::-1])
    with pytest.raises(CaptureError, match="turned by 180 degrees"):
        depth_orientation(Measured(capture))
    assert depth_shift(Measured(capture)) == ()


@pytest.mark.parametrize("refined", [refine, check_capture])
def test_a_mirrored_depth_is_not_registered_to_the_photographs(refined):
    capture = with_depth_turned(tiled_scene(mask_shape, off_px=8), lambda depth: depth[:, ::-1])
    capture = replace(capture, register=True)
    if refined is refine:
        with pytest.raises(CaptureError, match="mirrored left to right"):
            refine(capture)
    else:
        assert refined(capture).findings[0].code == "depth-turned"


@pytest.mark.parametrize("relief", [ball, mask_shape])
def test_what_over_exposure_leaves_is_not_explained_by_flat_parts(relief):
    capture = tiled_scene(relief, off_px=8, exposure=4.0)
    assert depth_orientation(Measured(capture)) == ()
    for fit in orientation_fits(capture):
        assert fit.evidence * fit.advantage >= 0 or abs(fit.evidence) < 1


def test_the_same_by_a_depth_camera_finer_than_the_photographs():
    turned = with_depth_turned(tiled_scene(mask_shape, off_px=8), lambda depth: depth[::-1, ::-1])
    finer = replace(
        turned,
        depth_m=turned.depth_m.repeat(3, axis=1).repeat(3, axis=2),
        depth_camera=turned.camera.resized(*(3 * n for n in turned.depth_m.shape[:0:-1])),
        depth_to_color=RigidTransform(np.eye(3), np.zeros(3)),
    )
    assert finer.depth_m.shape[1] > turned.camera.height
    with pytest.raises(CaptureError, match="turned by 180 degrees"):
        depth_orientation(Measured(finer))
