from dataclasses import replace

import numpy as np
import pytest

from rakelight.check.inside_out import inside_out, outline_of
from rakelight.errors import CaptureError
from tests.check.wrong_captures import SOLIDS, disparity, sound


def with_background(capture, behind_m):
    """The capture with a wall, so far behind the object's median depth, wherever there was none."""
    wall = float(np.nanmedian(capture.depth_m)) + behind_m
    return replace(capture, depth_m=np.nan_to_num(capture.depth_m, nan=wall).astype(np.float32))


@pytest.mark.parametrize("shape", SOLIDS)
@pytest.mark.parametrize("behind_m", [None, 0.3])
def test_disparity_is_refused_and_depth_is_not(shape, behind_m):
    capture, _ = sound(shape)
    if behind_m is not None:
        capture = with_background(capture, behind_m)
    assert inside_out(capture) == ()
    with pytest.raises(CaptureError, match="inside out") as error:
        inside_out(disparity(capture))
    assert "disparity" in error.value.remedy


def test_a_hollow_before_a_background_is_sound():
    mould = disparity(sound("head")[0])
    assert inside_out(with_background(mould, 0.4)) == ()
    with pytest.raises(CaptureError):
        inside_out(mould)


def test_low_relief_has_no_side():
    assert inside_out(sound("coin")[0]) == ()
    assert inside_out(disparity(sound("coin")[0])) == ()


def test_a_shallow_hollow_is_doubted_only():
    capture, _ = sound("head")
    middle_m = np.nanmedian(capture.depth_m)
    shallow = middle_m + 0.4 * (middle_m - capture.depth_m)
    (finding,) = inside_out(replace(capture, depth_m=shallow.astype(np.float32)))
    assert finding.code == "depth-inside-out"


def test_an_object_that_fills_the_image_has_no_outline():
    capture, _ = sound("head")
    assert outline_of(replace(capture, mask=np.ones_like(capture.mask))) is None
