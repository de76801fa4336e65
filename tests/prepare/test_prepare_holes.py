"""Holes in the depth: carried where they are small, left out where nobody saw."""

import numpy as np
import pytest

from rakelight.check.depth_quality import depth_quality
from rakelight.prepare import prepare
from rakelight.prepare.holes import REACH_PX, unseen, within_reach
from tests.prepare.test_prepare_capture import CAMERA, COLUMNS, DISC, ROWS, make_capture, plane

EVERYWHERE = np.ones(CAMERA.shape, bool)


def codes(prepared):
    return [finding.code for finding in prepared.findings]


def test_reach_goes_through_the_object():
    mask = np.zeros((9, 60), bool)
    mask[4] = True
    mask[4, 30] = False  # a gap
    mask[0, 10] = True  # a part of its own, near by
    measured = np.zeros_like(mask)
    measured[4, 20] = True
    near = within_reach(measured, mask)
    assert np.flatnonzero(near[4]).tolist() == list(range(20 - REACH_PX, 30))
    assert near.sum() == near[4].sum()


def test_a_small_hole_is_carried_and_marked():
    depth = plane(CAMERA)[None].astype(np.float32)
    depth[0, 18:26, 28:36] = np.nan
    prepared = prepare(make_capture(1, depth_m=depth, mask=EVERYWHERE))
    assert prepared.mask.all()
    hole = ~prepared.measured
    assert hole.sum() == 64
    np.testing.assert_allclose(prepared.depth_m[hole], plane(prepared.camera)[hole], atol=1e-3)
    marked = prepared.marked(np.full(CAMERA.shape, 0.8))
    np.testing.assert_array_equal(marked, np.where(hole, 0.4, 0.8))
    (note,) = prepared.findings
    assert (note.severity, note.code) == ("note", "holes-carried")
    assert f"{64 / EVERYWHERE.size:.1%} of the result" in note.message


@pytest.mark.parametrize(("every", "severity"), [(2, "note"), (3, "warning"), (20, "warning")])
def test_depth_that_is_mostly_holes_is_a_warning(every, severity):
    depth = plane(CAMERA)[None].astype(np.float32)
    depth[0, np.arange(depth[0].size).reshape(depth[0].shape) % every > 0] = np.nan
    capture = make_capture(1, depth_m=depth, mask=EVERYWHERE)
    for findings in (prepare(capture).findings, depth_quality(capture)[1]):
        (finding,) = (each for each in findings if each.code == "holes-carried")
        assert (finding.severity, bool(finding.remedy)) == (severity, severity == "warning")


def test_a_large_hole_leaves_the_mask():
    depth = plane(CAMERA)[None].astype(np.float32)
    depth[0, :, 20:] = np.nan
    prepared = prepare(make_capture(1, depth_m=depth, mask=EVERYWHERE))
    inside = prepared.embed(prepared.mask, 0) > 0
    np.testing.assert_array_equal(inside, COLUMNS < 20 + REACH_PX)
    assert codes(prepared) == ["holes-left-out", "holes-carried"]
    warning = prepared.findings[0]
    share = 1 - (20 + REACH_PX) / CAMERA.width
    assert f"{share:.1%} of the object left out" in warning.message
    assert warning.remedy


@pytest.mark.parametrize("value", [0, 65535])
def test_what_neither_camera_saw_is_left_out(value):
    depth = plane(CAMERA)[None].astype(np.float32)
    depth[0, 15:29, 25:41] = np.nan
    photographs = make_capture(1).photographs.copy()
    photographs[:, 18:26, 20:36] = value  # half of it beyond the hole
    prepared = prepare(make_capture(1, depth_m=depth, photographs=photographs, mask=EVERYWHERE))
    dark = (ROWS >= 18) & (ROWS < 26) & (COLUMNS >= 25) & (COLUMNS < 36)
    # a pixel beside what was seen is still told by it
    inner = (ROWS >= 19) & (ROWS < 25) & (COLUMNS >= 26) & (COLUMNS < 35)
    assert not prepared.mask[inner].any()
    assert prepared.mask[~dark].all()
    assert codes(prepared) == ["holes-left-out", "holes-carried"]


def test_one_photograph_that_shows_it_is_enough():
    photographs = np.zeros((3, 4, 5, 3), np.uint8)
    photographs[1, 2, 3, 0] = 100
    photographs[:, :, 0] = 100
    unmeasured = np.ones((4, 5), bool)
    dark = unseen(photographs, unmeasured, 1)
    assert np.argwhere(dark).tolist() == [[0, 2], [0, 3], [0, 4]]
    assert not unseen(photographs, np.zeros((4, 5), bool), 1).any()


def test_nothing_is_said_of_whole_depth():
    assert codes(prepare(make_capture(1, mask=DISC))) == []
