"""Shifts with which pictures explain one another best."""

import cv2
import numpy as np
import pytest

from rakelight.check.alignment import (
    FEWEST_PIXELS,
    SHARE,
    aligned,
    details,
    moved_back,
    shifts_among,
    steps,
)
from rakelight.check.others import combination, combinations

SHAPE = (120, 150)
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def lit(count, seed=0):
    """Pictures of one painted relief, combinations of three images, with a little noise."""
    rng = np.random.default_rng(seed)
    paint, *slopes = (cv2.GaussianBlur(rng.random(SHAPE), (0, 0), 4.0) for _ in range(3))
    images = [paint, *(paint * 10 * (each - each.mean()) for each in slopes)]
    weights = np.column_stack([np.ones(count), rng.uniform(-0.3, 0.3, (count, 2))])
    noise = 1e-5 * rng.standard_normal((count, *SHAPE))
    return [each.astype(np.float32) for each in np.tensordot(weights, images, 1) + noise]


@pytest.mark.parametrize(("count", "which"), [(8, [4]), (10, [2, 3, 7]), (12, [0])])
def test_known_shifts_come_back(count, which):
    shifts = np.zeros((count, 2))
    shifts[which] = np.random.default_rng(1).uniform(-4, 4, (len(which), 2))
    pictures = moved_back(lit(count), -shifts)
    found = shifts_among(pictures, EVERYWHERE)
    found -= np.median(found, axis=0)
    np.testing.assert_allclose(found, shifts, atol=0.1)


def test_what_is_at_rest_stays_where_it_is():
    shifts = np.zeros((6, 2))
    shifts[2] = 1.5, -0.7
    which = np.arange(6)[:, None] == 2
    found = aligned(details(moved_back(lit(6), -shifts)), EVERYWHERE, np.zeros((6, 2)), which)
    assert not found[~which[:, 0]].any()
    np.testing.assert_allclose(found[2], shifts[2], atol=0.05)


@pytest.mark.parametrize("start", [0.6, -0.6])
def test_a_step_leads_to_the_least_that_others_leave(start):
    pictures = lit(6)
    there = np.zeros(SHAPE, dtype=bool)
    there[8:-8, 8:-8] = True

    def moved(right):
        return moved_back(pictures, np.array([[right * (i == 3), 0.0] for i in range(6)]))

    def left(right):
        images = np.stack([each[there] for each in moved(right)]).astype(np.float64)
        weights = combination(images @ images.T, 3)
        return float(((images[3] - weights @ images) ** 2).sum())

    step = steps(moved(start), there, 4)[3] / SHARE
    assert left(start + step[0]) < 0.01 * left(start)
    assert step[1] == pytest.approx(0, abs=0.01)


def test_too_few_pixels_or_pictures_tell_nothing():
    few = np.zeros(SHAPE, dtype=bool)
    few.ravel()[: FEWEST_PIXELS + 100] = True  # the first rows, which a border takes away
    assert shifts_among(lit(6), few) is None
    assert shifts_among(lit(2), EVERYWHERE) is None


def test_weights_are_those_of_the_least_squares():
    images = np.random.default_rng(0).standard_normal((5, 40))
    wanted = np.random.default_rng(1).standard_normal((3, 40))
    found = combinations(images @ images.T, images @ wanted.T, which=2)
    others = np.delete(images, 2, axis=0)
    expected = np.linalg.lstsq(others.T, wanted.T, rcond=None)[0]
    np.testing.assert_allclose(np.delete(found, 2, axis=0), expected)
    assert not found[2].any()
