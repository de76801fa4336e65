"""Object and background exchanged in the mask, and masks that only look like it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rakelight.check.findings import FINDINGS, checks
from rakelight.check.inverted_mask import mask_inverted
from rakelight.check.measured import Measured
from tests.check.tiled_scene import ball, cloth, mask_shape, tiled_scene


def inverted(capture):
    return replace(capture, mask=~capture.mask)


@pytest.mark.parametrize("relief", [ball, cloth, mask_shape])
def test_an_inverted_mask_is_asked_for(relief):
    capture = tiled_scene(relief)
    assert mask_inverted(Measured(capture)) == ()
    (found,) = mask_inverted(Measured(inverted(capture)))
    assert (found.severity, found.code) == ("warning", "mask-inverted")


def test_it_is_said_before_all_else():
    assert FINDINGS[0].codes == ("mask-inverted",)
    assert mask_inverted in checks(in_refine="prepare")


def test_an_object_that_stands_on_the_images_border_may_be_left_out():
    capture = tiled_scene(ball)
    bust = capture.mask.copy()
    bust[85:, 80:140] = True
    depth = capture.depth_m.copy()
    depth[:, 42:, 40:70] = 0.55
    standing = replace(capture, mask=bust, depth_m=depth)
    assert mask_inverted(Measured(standing)) == ()
    assert mask_inverted(Measured(inverted(standing)))


def test_an_object_that_fills_the_picture_leaves_out_what_is_behind():
    capture = tiled_scene(cloth)
    depth = np.where(inverted(capture).mask[::2, ::2], 0.6, 0.8)[None].astype(np.float32)
    holed = replace(inverted(capture), depth_m=depth)
    assert mask_inverted(Measured(holed)) == ()
    cut = np.ones_like(capture.mask)
    cut[:60, :60] = False
    assert mask_inverted(Measured(replace(capture, mask=cut))) == ()
    whole = np.ones_like(capture.mask)
    assert mask_inverted(Measured(replace(capture, mask=whole))) == ()


def test_without_depth_around_it_a_mask_that_holds_the_frame_is_not_doubted():
    capture = tiled_scene(ball)
    narrow = cv2.erode(capture.mask[::2, ::2].astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    alone = replace(capture, depth_m=np.where(narrow, capture.depth_m, np.nan))
    assert mask_inverted(Measured(inverted(alone))) == ()
