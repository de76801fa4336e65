"""Holes filled with the membrane that their rim carries."""

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.geometry.fill import nearest_fill
from rakelight.prepare.inpaint import inpaint
from tests.solve.stalling import stalling_solver

SHAPE = (40, 56)
ALL = np.ones(SHAPE, bool)
ROWS, COLUMNS = np.indices(SHAPE)
DISC = (ROWS - 18) ** 2 + (COLUMNS - 30) ** 2 < 9**2


def ramp(base=-0.3, slope_u=0.006, slope_v=-0.002):
    """Log depth linear in the pixel, which is harmonic: the membrane that its rim carries."""
    return base + slope_u * COLUMNS + slope_v * ROWS


def with_hole(depth, hole):
    return np.where(hole, np.nan, depth)


@pytest.mark.parametrize("value", [0.3, 1.0, 12.0])
def test_constant_depth_is_filled_with_itself(value):
    filled = inpaint(with_hole(np.full(SHAPE, value), DISC), ALL)
    np.testing.assert_allclose(filled, value, rtol=1e-12)


@pytest.mark.parametrize("base", [-1.5, 0.0, 2.0])
@pytest.mark.parametrize(
    "hole", [DISC, (ROWS == 20) & (COLUMNS == 9), (abs(ROWS - 18) < 10) & (abs(COLUMNS - 28) < 20)]
)
def test_a_ramp_in_log_depth_goes_on_in_a_hole(base, hole):
    # The nearest measured value would be off by the slope times the hole's radius.
    log_depth = ramp(base)
    filled = np.log(inpaint(with_hole(np.exp(log_depth), hole), ALL))
    assert np.abs(filled - log_depth).max() < 1e-6


def test_the_filling_is_harmonic_and_between_its_rim():
    depth = np.exp(ramp() + 0.05 * np.sin(COLUMNS / 3) * np.cos(ROWS / 4))
    filled = np.log(inpaint(with_hole(depth, DISC), ALL))
    mean = sum(np.roll(filled, s, axis) for s, axis in ((1, 0), (-1, 0), (1, 1), (-1, 1))) / 4
    assert np.abs(mean - filled)[DISC].max() < 1e-6
    rim = ~DISC & sum(np.roll(DISC, s, a) for s, a in ((1, 0), (-1, 0), (1, 1), (-1, 1)))
    assert filled[rim].min() <= filled[DISC].min()
    assert filled[DISC].max() <= filled[rim].max()


def test_measured_pixels_are_kept_bit_by_bit():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.5, 2.0, SHAPE)
    mask, hole = rng.random(SHAPE) < 0.9, rng.random(SHAPE) < 0.2
    filled = inpaint(with_hole(depth, hole), mask)
    np.testing.assert_array_equal(filled[mask & ~hole], depth[mask & ~hole])
    assert np.isfinite(filled[mask]).all()
    assert np.isnan(filled[~mask]).all()


def test_without_holes_nothing_changes():
    depth = np.exp(ramp())
    np.testing.assert_array_equal(inpaint(depth, DISC), np.where(DISC, depth, np.nan))


def test_what_lies_outside_the_mask_has_no_influence():
    depth = with_hole(np.exp(ramp()), (ROWS - 18) ** 2 + (COLUMNS - 36) ** 2 < 4**2)
    expected = inpaint(depth, DISC)
    for outside in (np.nan, 0.1, 100.0):
        np.testing.assert_allclose(inpaint(np.where(DISC, depth, outside), DISC), expected)


def test_a_hole_open_to_the_border_is_filled_from_its_other_sides():
    # Nothing is known beyond the border: no slope across it.
    hole = COLUMNS >= 40
    filled = np.log(inpaint(with_hole(np.exp(ramp(slope_v=0)), hole), ALL))
    np.testing.assert_allclose(filled[:, 40:], ramp(slope_v=0)[0, 39], atol=1e-6)


def test_a_part_without_measurement_takes_the_nearest_depth():
    mask = np.zeros(SHAPE, bool)
    mask[5:20, 5:20] = mask[25:35, 30:50] = True
    depth = np.full(SHAPE, np.nan)
    depth[5:20, 5:20] = 0.7
    filled = inpaint(depth, mask)
    np.testing.assert_allclose(filled[mask], 0.7, rtol=1e-9)


def test_a_part_without_measurement_stays_near_and_smooth():
    # Its nearest measurements differ; what is filled in lies between them.
    mask = np.zeros(SHAPE, bool)
    mask[5:20, 5:50] = mask[25:35, 5:50] = True
    depth = np.where(mask & (ROWS < 20), np.exp(ramp()), np.nan)
    part = inpaint(depth, mask)[25:35, 5:50]
    assert depth[19, 5:50].min() <= part.min()
    assert part.max() <= depth[19, 5:50].max()


def test_thin_and_single_pixels_without_measurement():
    mask = np.zeros(SHAPE, bool)
    mask[3:10, 3:30] = mask[20, 5:40] = mask[30, 30] = True
    depth = np.where(ROWS < 12, 0.9, np.nan)
    np.testing.assert_allclose(inpaint(depth, mask)[mask], 0.9, rtol=1e-9)


def test_one_measurement_fills_all():
    depth = np.full(SHAPE, np.nan)
    depth[7, 9] = 1.3
    np.testing.assert_allclose(inpaint(depth, ALL), 1.3, rtol=1e-9)


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (2, 2)])
def test_tiny_images(shape):
    depth = np.full(shape, 0.6)
    if depth.size > 1:
        depth[-1, -1] = np.nan
    np.testing.assert_allclose(inpaint(depth, np.ones(shape, bool)), 0.6, rtol=1e-9)


def test_nearest_fill_takes_the_nearest():
    rng = np.random.default_rng(3)
    known = rng.random((12, 15)) < 0.1
    values = rng.random(known.shape)
    filled = nearest_fill(values, known)
    places = np.argwhere(known)
    for pixel in np.ndindex(known.shape):
        squared = ((places - pixel) ** 2).sum(axis=1)
        nearest = places[squared == squared.min()]
        assert filled[pixel] in values[tuple(nearest.T)]


def test_a_solver_that_stalls_is_an_error():
    with stalling_solver(), pytest.raises(InputError, match=r"holes of the depth.*stalled"):
        inpaint(with_hole(np.exp(ramp()), DISC), ALL)
