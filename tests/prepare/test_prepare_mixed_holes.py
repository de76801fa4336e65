"""Measurements on ramps from the object down to holes that were stored as 0."""

import cv2
import numpy as np
import pytest

from rakelight.prepare.mixed_holes import mixed_with_holes


def with_holes(seed=0):
    """(60, 80) depth of a wavy surface, metres, and where small holes are."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[:60, :80]
    depth = 0.8 + 0.002 * column + 0.01 * np.sin(row / 5)
    hole = np.zeros(depth.shape, bool)
    for _ in range(12):
        i, j = rng.integers(3, 55), rng.integers(3, 75)
        hole[i : i + rng.integers(1, 4), j : j + rng.integers(1, 4)] = True
    return depth, hole


def enlarged(depth, factor, how):
    return cv2.resize(depth, None, fx=factor, fy=factor, interpolation=how)


@pytest.mark.parametrize("how", [cv2.INTER_LINEAR, cv2.INTER_CUBIC])
@pytest.mark.parametrize("factor", [2, 3, 4, 8])
def test_no_measurement_that_is_mixed_with_a_hole_is_left(factor, how):
    depth, hole = with_holes()
    found, true = (enlarged(each, factor, how) for each in (np.where(hole, 0.0, depth), depth))
    found = np.where(found > 0, found, np.nan)
    off = np.abs(found - true)
    mixed = mixed_with_holes(found, np.ones(found.shape, bool))
    assert np.nanmax(off) > 0.3
    # Cubic interpolation of a hole beside another swings by a twentieth of the depth, once more.
    assert np.nanmax(np.where(mixed, 0, off)) < (0.001 if how == cv2.INTER_LINEAR else 0.045)
    assert mixed.mean() < 0.2


@pytest.mark.parametrize("factor", [2, 4])
def test_holes_without_ramps_stay_as_they_are(factor):
    depth, hole = with_holes()
    found = enlarged(np.where(hole, 0.0, depth), factor, cv2.INTER_NEAREST)
    found = np.where(found > 0, found, np.nan)
    assert not mixed_with_holes(found, np.ones(found.shape, bool)).any()


def test_a_part_of_its_own_depth_is_none():
    depth = np.full((60, 80), 1.4)
    depth[15:45, 10:40] = 0.6
    depth[15:45, 40] = np.nan
    assert not mixed_with_holes(depth, np.ones(depth.shape, bool)).any()


def test_only_the_object_counts():
    depth, hole = with_holes()
    found = enlarged(np.where(hole, 0.0, depth), 4, cv2.INTER_LINEAR)
    found = np.where(found > 0, found, np.nan)
    left = np.zeros(found.shape, bool)
    left[:, :160] = True
    mixed = mixed_with_holes(found, left)
    assert mixed.any()
    assert not mixed[~left].any()
    assert not mixed_with_holes(found, np.zeros(found.shape, bool)).any()
