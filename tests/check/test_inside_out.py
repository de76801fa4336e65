from dataclasses import replace

import numpy as np
import pytest

from rakelight.check.evidence import LIKELY, SURELY
from rakelight.check.inside_out import inside_out, outline_of
from rakelight.check.measured import Measured
from tests.check.wrong_captures import SOLIDS, disparity, flat_depth, sound, with_background


@pytest.mark.parametrize("shape", SOLIDS)
def test_disparity_before_a_background_is_suspicious_and_depth_is_not(shape):
    capture = with_background(sound(shape)[0], 0.3)
    assert inside_out(Measured(capture)) == ()
    (finding,) = inside_out(Measured(disparity(capture)))
    assert "what lies beyond is nearer" in finding.message
    assert "disparity" in finding.remedy
    outline = outline_of(disparity(capture))
    assert outline.falls_and_jumps
    assert outline.deeper_than_wide


@pytest.mark.parametrize("shape", SOLIDS)
def test_without_a_background_it_may_be_a_hollow(shape):
    capture, _ = sound(shape)
    assert inside_out(Measured(capture)) == ()
    (finding,) = inside_out(Measured(disparity(capture)))
    assert (finding.severity, finding.code) == ("warning", "depth-inside-out")
    assert "hollow" in finding.message
    assert "disparity" in finding.remedy


def test_a_background_that_is_nearer_here_and_farther_there_decides_nothing():
    capture = disparity(sound("head")[0])
    middle_m = float(np.nanmedian(capture.depth_m))
    columns = np.arange(capture.depth_m.shape[2])
    tilted = np.broadcast_to(middle_m + 0.004 * (columns - columns.mean()), capture.depth_m.shape)
    depth = np.where(np.isfinite(capture.depth_m), capture.depth_m, tilted).astype(np.float32)
    found = replace(capture, depth_m=depth)
    assert abs(outline_of(found).nearer) < LIKELY
    (finding,) = inside_out(Measured(found))
    assert "hollow" in finding.message


def test_a_hollow_before_a_background_is_sound():
    mould = disparity(sound("head")[0])
    assert inside_out(Measured(with_background(mould, 0.4))) == ()


def test_a_hollow_in_a_block_has_no_side_wall():
    # The block's surface begins where the hollow ends: nearer than the border inside, no jump.
    mould = disparity(sound("head")[0])
    depth = mould.depth_m
    nearest = np.nanquantile(depth, 0.02)
    block = np.where(np.isfinite(depth), np.maximum(depth, nearest), nearest).astype(np.float32)
    outline = outline_of(replace(mould, depth_m=block))
    assert outline.falls > SURELY
    assert outline.nearer > LIKELY
    assert not outline.falls_and_jumps
    (finding,) = inside_out(Measured(replace(mould, depth_m=block)))
    assert finding.severity == "warning"


def test_a_picture_in_a_frame_is_sound():
    flat = flat_depth(sound("head")[0])
    framed = with_background(flat, -0.05)
    assert outline_of(framed).nearer > SURELY
    assert inside_out(Measured(framed)) == ()


def test_low_relief_has_no_side():
    assert inside_out(Measured(sound("coin")[0])) == ()
    assert inside_out(Measured(disparity(sound("coin")[0]))) == ()


def test_a_shallow_hollow_is_doubted_only():
    capture, _ = sound("head")
    middle_m = np.nanmedian(capture.depth_m)
    shallow = middle_m + 0.4 * (middle_m - capture.depth_m)
    (finding,) = inside_out(Measured(replace(capture, depth_m=shallow.astype(np.float32))))
    assert finding.code == "depth-inside-out"


def test_an_object_that_fills_the_image_has_no_outline():
    capture, _ = sound("head")
    assert outline_of(replace(capture, mask=np.ones_like(capture.mask))) is None
