"""How bright the pixels of a photograph are, and which paint they are of."""

import numpy as np
import pytest

from rakelight.methods.single_image.reflectance_regions import brightness, reflectance_regions

SHAPE = (60, 80)
ALL = np.ones(SHAPE, bool)
ROW, COLUMN = np.mgrid[: SHAPE[0], : SHAPE[1]]
RNG = np.random.default_rng(0)
LOOPS = 1 + 0.1 * np.sin(ROW * 2 * np.pi / 5) * np.cos(COLUMN * 2 * np.pi / 5)
RED, WHITE = np.array([0.7, 0.0, 0.05]), np.array([0.6, 0.6, 0.6])


def photograph(colour, noise=0.02):
    """Loops in one colour, noise the same in every channel, clipped to black and white."""
    return np.clip(LOOPS[..., None] * colour + noise * RNG.normal(size=(*SHAPE, 3)), 0.0, 1.0)


def usable(colour):
    return (colour > 0.004) & (colour < 0.98)


@pytest.mark.parametrize("colour", [RED, WHITE, [1.2, 1.1, 0.6]])
def test_brightness_is_told_by_the_channels_that_show_it(colour):
    shown = photograph(np.array(colour), noise=0.01)
    found = brightness(shown, usable(shown), ALL)
    assert np.corrcoef(found.ravel(), LOOPS.ravel())[0, 1] > 0.9


def test_dark_channels_count_less_than_their_noise():
    shown = photograph(RED)
    found = brightness(shown, usable(shown), ALL)
    np.testing.assert_allclose(found * np.median(shown[..., 0]), shown[..., 0], atol=0.02)


def test_median_brightness_is_one_whatever_the_exposure():
    shown = photograph(WHITE)
    full, half = (brightness(gain * shown, usable(shown), ALL) for gain in (1.0, 0.5))
    assert np.median(full) == pytest.approx(1.0)
    np.testing.assert_allclose(full, half)


def test_clipped_values_count_where_there_are_no_others():
    shown = np.where((COLUMN < 40)[..., None], WHITE, 1.0)
    found = brightness(shown, usable(shown), ALL)
    np.testing.assert_allclose(found[:, 50:] / found[:, 20:50:30], 1 / 0.6)


def test_two_paints_are_told_apart_and_their_border_is_of_neither():
    shown = np.where((COLUMN < 40)[..., None], photograph(RED), photograph(WHITE))
    shown[:, 40] = (RED + WHITE) / 2
    left, right = sorted(reflectance_regions(shown, ALL), key=lambda area: COLUMN[area].mean())
    assert left[:, :37].mean() > 0.99
    assert right[:, 44:].mean() > 0.99
    assert not left[:, 41:].any()
    assert not right[:, :38].any()


def test_a_lining_that_shows_through_is_of_no_paint():
    shown = np.where((COLUMN < 60)[..., None], photograph(RED), photograph(WHITE))
    gaps = (ROW % 8 == 0) & (COLUMN % 8 == 0) & (COLUMN < 50)
    shown[gaps] = WHITE
    areas = np.logical_or.reduce(reflectance_regions(shown, ALL))
    assert not areas[gaps].any()
    assert areas[~gaps & (COLUMN < 50)].mean() > 0.99


def test_a_dark_fold_has_no_colour_of_its_own():
    shown = np.where((COLUMN < 40)[..., None], photograph(RED), photograph(WHITE))
    shown[30, 10], shown[30, 70] = 0.001, [0.0, 0.001, 0.0]
    areas = np.logical_or.reduce(reflectance_regions(shown, ALL))
    assert areas[30, [10, 70]].all()


def test_nothing_has_no_paint():
    assert reflectance_regions(np.zeros((3, 4, 3)), np.zeros((3, 4), bool)) == []
    assert brightness(np.zeros((3, 4, 3)), np.zeros((3, 4, 3), bool), ALL[:3, :4]).max() == 0
