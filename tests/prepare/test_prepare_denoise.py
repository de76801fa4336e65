"""The bilateral filter: noise goes, jumps and planes stay, nothing leaks in from outside."""

import numpy as np
import pytest

from rakelight.prepare.denoise import RANGE_SIGMAS, SPATIAL_SIGMA_PX, bilateral

SHAPE = (60, 80)
ALL = np.ones(SHAPE, bool)
ROWS, COLUMNS = np.indices(SHAPE)
INNER = (slice(8, -8), slice(8, -8))
SIGMA_M = 0.002


def rms(error):
    return np.sqrt(np.mean(error**2))


def white(seed=0):
    return np.random.default_rng(seed).normal(0, SIGMA_M, SHAPE)


def gaussian_gain():
    """What the spatial weights alone leave of the rms of white noise: |k| for weights k."""
    weights = np.exp(-(np.arange(-4, 5) ** 2) / (2 * SPATIAL_SIGMA_PX**2))
    kernel = np.outer(weights, weights)
    y, x = np.mgrid[-4:5, -4:5]
    kernel[x**2 + y**2 > 16] = 0
    return np.linalg.norm(kernel) / kernel.sum()


@pytest.mark.parametrize("value", [0.4, 3.0])
def test_constant_stays(value):
    np.testing.assert_allclose(bilateral(np.full(SHAPE, value), ALL, SIGMA_M, 0.001), value)


def test_white_noise_within_a_wide_range_is_reduced_as_by_the_gaussian():
    # A range far above the noise leaves the spatial weights alone.
    smooth = bilateral(0.8 + white(), ALL, SIGMA_M, pixel_m=0.1)
    assert rms(smooth[INNER] - 0.8) == pytest.approx(gaussian_gain() * SIGMA_M, rel=0.06)


def test_white_noise_within_the_usual_range():
    # Weights exp(-d^2 / (2 (3 sigma)^2)) pull every pixel a little towards itself.
    smooth = bilateral(0.8 + white(), ALL, SIGMA_M, pixel_m=0.0)
    gain = rms(smooth[INNER] - 0.8) / SIGMA_M
    assert gaussian_gain() < gain < 1.3 * gaussian_gain()


@pytest.mark.parametrize("sigmas", [20, 100])
def test_a_jump_of_many_sigmas_stays(sigmas):
    jump = sigmas * SIGMA_M
    truth = 0.8 + jump * (COLUMNS >= 40)
    smooth = bilateral(truth + white(), ALL, SIGMA_M, pixel_m=0.0)
    beside = slice(36, 44)
    assert rms((smooth - truth)[8:-8, beside]) < 0.3 * SIGMA_M
    assert smooth[:, 40].min() - smooth[:, 39].max() > 0.9 * jump


def test_a_jump_within_the_noise_goes():
    truth = 0.8 + 2 * SIGMA_M * (COLUMNS >= 40)
    smooth = bilateral(truth, ALL, SIGMA_M, pixel_m=0.0)
    assert (smooth[:, 40] - smooth[:, 39]).max() < 0.7 * SIGMA_M


@pytest.mark.parametrize(("slope_u", "slope_v"), [(0.001, 0.0), (-0.002, 0.003), (0.01, 0.0)])
def test_a_plane_stays_a_plane_inside(slope_u, slope_v):
    plane = 0.8 + slope_u * COLUMNS + slope_v * ROWS
    smooth = bilateral(plane, ALL, SIGMA_M, pixel_m=0.001)
    assert np.abs(smooth - plane)[INNER].max() < 2e-6  # float32


@pytest.mark.parametrize("outside", [np.nan, 0.0, 0.8, 50.0])
def test_nothing_leaks_in_from_outside_the_mask(outside):
    mask = (ROWS - 30) ** 2 + (COLUMNS - 40) ** 2 < 20**2
    truth = 0.8 + white()
    expected = bilateral(truth, mask, SIGMA_M, 0.001)
    smooth = bilateral(np.where(mask, truth, outside), mask, SIGMA_M, 0.001)
    np.testing.assert_array_equal(smooth, expected)
    assert np.isnan(smooth[~mask]).all()
    # a mean of the pixels inside: beyond them nothing could bring it
    assert truth[mask].min() < smooth[mask].min()
    assert smooth[mask].max() < truth[mask].max()


def test_a_pixel_alone_keeps_its_depth():
    mask = np.zeros(SHAPE, bool)
    mask[10, 10] = mask[40, 60] = True
    depth = np.where(mask, 0.8 + 0.01 * COLUMNS, 5.0)
    np.testing.assert_allclose(bilateral(depth, mask, SIGMA_M, 0.001)[mask], depth[mask], atol=1e-6)


def test_shifted_depth_gives_shifted_depth():
    # float32 holds the difference to the nearest pixel, not the distance.
    near = bilateral(0.8 + white(), ALL, SIGMA_M, 0.001)
    far = bilateral(20.8 + white(), ALL, SIGMA_M, 0.001)
    np.testing.assert_allclose(far - 20, near, atol=1e-8)


@pytest.mark.parametrize("scale", [0.1, 7.0])
def test_scaled_depth_gives_scaled_depth(scale):
    depth = 0.8 + white() + 0.1 * (COLUMNS > 40)
    expected = scale * bilateral(depth, ALL, SIGMA_M, 0.001)
    got = bilateral(scale * depth, ALL, scale * SIGMA_M, scale * 0.001)
    np.testing.assert_allclose(got, expected, rtol=1e-6)


@pytest.mark.parametrize(("flip"), [np.s_[::-1], np.s_[:, ::-1]])
def test_no_side_is_preferred(flip):
    depth = 0.8 + white() + 0.001 * COLUMNS
    expected = bilateral(depth, ALL, SIGMA_M, 0.001)[flip]
    np.testing.assert_allclose(bilateral(depth[flip], ALL, SIGMA_M, 0.001), expected, atol=1e-7)


def test_range_is_stated_in_noise_widths():
    # One pixel off by d among many equal ones moves by (1 - w) d, w its share of the weights.
    weights = np.exp(-(np.arange(-4, 5) ** 2) / (2 * SPATIAL_SIGMA_PX**2))
    y, x = np.mgrid[-4:5, -4:5]
    others = (np.outer(weights, weights) * (x**2 + y**2 <= 16)).sum() - 1
    for off in (1.0, 4.0):
        depth = np.full(SHAPE, 0.8)
        depth[30, 40] += off * SIGMA_M
        kept = (bilateral(depth, ALL, SIGMA_M, 0.0)[30, 40] - 0.8) / (off * SIGMA_M)
        pull = others * np.exp(-((off / RANGE_SIGMAS) ** 2) / 2)
        assert kept == pytest.approx(1 / (1 + pull), rel=0.01)
