"""Jumps that the sensor's depth shows are found; slopes, curves, noise and rounding are none."""

import numpy as np
import pytest

from rakelight.geometry.grid import Links
from rakelight.model import Camera
from rakelight.prepare.jumps import rounding, without_measured_jumps

CAMERA = Camera(60, 50, fx=500.0, fy=500.0, cx=29.5, cy=24.5)
ROW, COLUMN = np.mgrid[:50, :60].astype(float)
PIXEL_M = 1 / 500.0  # at one metre
NOISE_M = 0.1 * PIXEL_M


def cut(depth_m):
    """The links of a whole window that jumps cut: (50, 59) to the right and (49, 60) down."""
    whole = Links.of(np.ones(depth_m.shape, bool))
    links = without_measured_jumps(whole, depth_m, CAMERA)
    return ~links.right[:, :-1], ~links.down[:-1]


def noisy(depth_m, seed=0):
    return depth_m + NOISE_M * np.random.default_rng(seed).standard_normal(depth_m.shape)


@pytest.mark.parametrize("height_px", [5.0, -5.0, 9.0])
def test_a_step_is_cut_along_its_whole_length_and_nothing_else(height_px):
    slope = 1 + PIXEL_M * (0.5 * COLUMN - 0.3 * ROW)
    right, down = cut(noisy(slope + height_px * PIXEL_M * (COLUMN > 30)))
    assert right[:, 30].all()
    assert np.count_nonzero(right) == 50
    assert not down.any()
    right, down = cut(noisy(slope + height_px * PIXEL_M * (ROW > 20)))
    assert down[20].all()
    assert np.count_nonzero(down) == 60
    assert not right.any()


def test_a_step_that_is_blurred_over_three_pixels_is_cut_once():
    ramp = np.interp(COLUMN, [29, 30, 31, 32], [0.0, 5.0, 13.0, 17.0])
    right, down = cut(noisy(1 + PIXEL_M * ramp))
    assert right[:, 30].all()
    assert np.count_nonzero(right) == 50
    assert not down.any()


@pytest.mark.parametrize(
    "relief_px",
    [
        0 * COLUMN,
        5 * COLUMN,  # 79 degrees
        np.sqrt(np.maximum(24.0**2 - (COLUMN - 30) ** 2 - (ROW - 25) ** 2, 0)),
        1.5 * np.abs(COLUMN - 30),  # a crease between two sides of 56 degrees
        3 * (COLUMN > 30),  # lower than four pixel sizes
    ],
    ids=["flat", "steep", "sphere", "crease", "low"],
)
def test_a_surface_has_no_jumps(relief_px):
    seen = np.hypot(COLUMN - 30, ROW - 25) < 22
    right, down = cut(np.where(seen, noisy(1 + PIXEL_M * relief_px), np.nan))
    assert not right.any()
    assert not down.any()


def test_the_outline_of_a_round_surface_has_no_jumps():
    # The last difference along a row is more than four pixel sizes above those before.
    differences_px = np.append(np.zeros(49), [0.7, 1.1, 1.8, 2.5, 7.5])
    depth_m = np.full(ROW.shape, np.nan)
    depth_m[:, :55] = 1 + PIXEL_M * np.append(0, np.cumsum(differences_px))
    right, down = cut(noisy(depth_m))
    assert not right.any()
    assert not down.any()
    depth_m[:, 55:] = depth_m[:, 54:55]  # where the surface goes on it is one
    right, _ = cut(noisy(depth_m))
    assert right[:, 53].all()


def test_noise_of_many_pixel_sizes_has_no_jumps():
    noise = np.random.default_rng(1).standard_normal(ROW.shape)
    right, down = cut(1 + 5 * PIXEL_M * noise)
    assert not right.any()
    assert not down.any()


def test_the_steps_of_a_rounding_sensor_are_no_jumps():
    step_m = 3 * PIXEL_M
    smooth = 1 + PIXEL_M * (0.4 * COLUMN + 0.3 * ROW)
    rounded = step_m * np.round(smooth / step_m)
    assert rounding(rounded) == pytest.approx(step_m)
    assert rounding(noisy(smooth)) == 0
    right, down = cut(rounded)
    assert not right.any()
    assert not down.any()
    right, _ = cut(rounded + 4 * step_m * (COLUMN > 30))
    assert right[:, 30].all()


@pytest.mark.parametrize("gap", [1, 2])
def test_a_step_is_cut_once_where_the_pixels_between_are_left_out(gap):
    # In the lower half no pixel is left out, and those in question belong to the left.
    edge = np.where(ROW < 20, 30, 30 + gap)
    depth_m = noisy(1 + PIXEL_M * (0.3 * COLUMN + 6 * (edge < COLUMN)))
    depth_m[:20, 31 : 31 + gap] = np.nan
    right, down = cut(depth_m)
    np.testing.assert_array_equal(np.count_nonzero(right, axis=1), np.ones(50))
    assert right[20:, 30 + gap].all()
    assert_closed(right, down)


def assert_closed(right, down):
    """The cuts part the window's left from its right."""
    left = np.zeros(ROW.shape, bool)
    left[:, 0] = True
    for _ in range(ROW.size):
        before = left.sum()
        left[:, 1:] |= left[:, :-1] & ~right
        left[:, :-1] |= left[:, 1:] & ~right
        left[1:] |= left[:-1] & ~down
        left[:-1] |= left[1:] & ~down
        if left.sum() == before:
            break
    assert not left[:, -1].any()


def test_a_step_that_grows_lower_is_followed_to_half_the_height():
    height_px = np.interp(ROW, [10, 40], [8.0, 0.0])
    right, down = cut(noisy(1 + PIXEL_M * (0.5 * COLUMN + height_px * (COLUMN > 30))))
    np.testing.assert_array_equal(np.flatnonzero(right[:, 30]), np.flatnonzero(height_px[:, 0] > 2))
    assert not down.any()
    # Where it is nowhere higher than that nothing is cut.
    right, down = cut(noisy(1 + PIXEL_M * (0.5 * COLUMN + 0.45 * height_px * (COLUMN > 30))))
    assert not right.any()
    assert not down.any()


def test_missing_measurements_cut_nothing_and_a_step_beside_them_is_found():
    depth_m = noisy(1 + PIXEL_M * (0.5 * COLUMN + 6 * (COLUMN > 30)))
    depth_m[10:20, 25:40] = np.nan
    right, down = cut(depth_m)
    expected = np.ones(50, bool)
    expected[10:20] = False
    np.testing.assert_array_equal(right[:, 30], expected)
    assert np.count_nonzero(right) == 40
    assert not down.any()


def test_without_measurements_nothing_is_cut():
    right, down = cut(np.full(ROW.shape, np.nan))
    assert not right.any()
    assert not down.any()


def test_the_steps_of_a_coarse_sensor_are_no_jumps():
    right, down = cut(0.01 * np.round((1 + 0.0008 * COLUMN) / 0.01))
    assert not right.any()
    assert not down.any()


@pytest.mark.parametrize("turned", [False, True])
def test_a_jump_that_grows_lower_is_cut_to_its_end(turned):
    column = np.mgrid[:50, :50][1]
    camera = Camera(50, 50, fx=500.0, fy=500.0, cx=24.5, cy=24.5)
    depth = 1 + np.linspace(8, 2.5, 50)[:, None] * (column > 25) / 500
    depth += 1e-5 * np.random.default_rng(0).standard_normal((50, 50))
    depth = depth.T if turned else depth
    links = without_measured_jumps(Links.of(np.ones((50, 50), bool)), depth, camera)
    assert not (links.down[25] if turned else links.right[:, 25]).any()
