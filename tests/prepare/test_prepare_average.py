"""Robust average of depth maps and the noise that is read from one."""

import numpy as np
import pytest

from rakelight.model import SensorNoise
from rakelight.prepare.average import noise_sigma, robust_average, scatter

KINECT_NOISE = SensorNoise().sigma_m

SHAPE = (40, 50)


def maps(count, sigma_m=0.002, seed=0):
    """(K, h, w) independent measurements of a slanted surface, and that surface."""
    truth = 0.6 + 0.002 * np.mgrid[: SHAPE[0], : SHAPE[1]][1]
    noise = np.random.default_rng(seed).normal(0, sigma_m, (count, *SHAPE))
    return truth + noise, truth


def rms(error):
    return np.sqrt(np.mean(error**2))


@pytest.mark.parametrize("count", [1, 2, 3, 8, 25])
def test_clean_maps_are_averaged(count):
    # Few measurements lie beyond three noise widths, so that this is all but the plain mean.
    stack, truth = maps(count, 0.002)
    error = rms(robust_average(stack) - truth)
    assert error == pytest.approx(0.002 / np.sqrt(count), rel=0.05)


def test_equal_maps_stay_as_they_are():
    stack = np.repeat(maps(1)[0], 5, axis=0)
    np.testing.assert_allclose(robust_average(stack), stack[0], rtol=1e-15)


def test_one_map_is_not_touched():
    depth = maps(1)[0].astype(np.float32)
    depth[0, 3, 4] = np.nan
    average = robust_average(depth)
    np.testing.assert_array_equal(average, depth[0])
    average[0, 0] = 7.0
    assert depth[0, 0, 0] != 7.0


@pytest.mark.parametrize("wrong_by", [0.05, 1.0, -0.3, 30.0])
def test_outliers_leave_no_trace(wrong_by):
    stack, truth = maps(9)
    spoilt = stack.copy()
    spoilt[2, 5:9, 7:12] += wrong_by
    spoilt[6, 6:8, 9:30] += wrong_by
    assert rms(robust_average(spoilt) - robust_average(stack)) < 1e-3 * 0.002 + 2e-4
    assert np.abs(robust_average(spoilt) - truth).max() < 5 * 0.002
    # with the outliers simply averaged the largest error would be
    assert np.abs(spoilt.mean(axis=0) - truth).max() > abs(wrong_by) / 9


@pytest.mark.parametrize("count", [4, 9])
@pytest.mark.parametrize(("sigmas", "kept"), [(2.8, True), (3.2, False)])
def test_three_noise_widths_are_the_limit(count, sigmas, kept):
    stack, truth = maps(count)
    stack[:, 10, 10] = truth[10, 10]
    stack[1, 10, 10] += sigmas * 0.002
    off = robust_average(stack)[10, 10] - truth[10, 10]
    assert off == pytest.approx(kept * sigmas * 0.002 / count, abs=1e-12)


def test_the_order_of_the_maps_does_not_matter():
    stack, _ = maps(6)
    stack[1, 3, 3] = 4.0
    np.testing.assert_allclose(robust_average(stack[::-1]), robust_average(stack), rtol=1e-14)


def test_missing_measurements_are_left_out():
    stack, _ = maps(8)
    stack[:4, 10, 10] = np.nan
    assert robust_average(stack)[10, 10] == pytest.approx(np.mean(stack[4:, 10, 10]), abs=1e-12)


@pytest.mark.parametrize(("count", "seen", "kept"), [(8, 2, True), (8, 1, False), (3, 1, True)])
def test_a_quarter_of_the_maps_is_needed(count, seen, kept):
    stack, _ = maps(count)
    stack[seen:, 10, 10] = np.nan
    assert np.isfinite(robust_average(stack)[10, 10]) == kept


@pytest.mark.parametrize("count", [1, 4])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0, -0.8])
def test_what_is_no_depth_is_no_measurement(count, bad):
    stack, _ = maps(count)
    stack[:, 3, 4] = stack[0, 20, 20] = bad
    average = robust_average(stack)
    assert np.isnan(average[3, 4])
    assert (np.nan_to_num(average, nan=1.0) > 0.5).all()
    assert np.isfinite(average).sum() == average.size - (2 if count == 1 else 1)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_maps_without_any_measurement(count):
    assert np.isnan(robust_average(np.full((count, *SHAPE), np.nan))).all()


def test_quantised_maps():
    # Most deviations are zero: the noise width must not become zero and drop the rest.
    truth = np.full(SHAPE, 0.8003)
    noise = np.random.default_rng(5).normal(0, 0.0003, (20, *SHAPE))
    stack = np.rint((truth + noise) * 1000) / 1000
    assert np.median(np.abs(stack - np.median(stack, axis=0))) == 0
    np.testing.assert_allclose(robust_average(stack), stack.mean(axis=0), rtol=1e-14)


@pytest.mark.parametrize("sigma_m", [0.003, 0.02])
@pytest.mark.parametrize("slope", [0.0, 0.002])
def test_sigma_of_white_noise_is_recovered(sigma_m, slope):
    noise = np.random.default_rng(0).normal(0, sigma_m, (120, 160))
    plane = 0.9 + slope * np.mgrid[:120, :160][1]
    np.testing.assert_allclose(noise_sigma(plane + noise), sigma_m, rtol=0.03)


def test_sigma_survives_jumps_and_holes():
    depth = 0.8 + np.random.default_rng(0).normal(0, 0.004, (120, 160))
    depth[:, 80:] += 0.3
    depth[np.random.default_rng(1).random(depth.shape) < 0.1] = np.nan
    sigma = noise_sigma(depth)
    np.testing.assert_array_equal(np.isnan(sigma), np.isnan(depth))
    np.testing.assert_allclose(sigma[np.isfinite(sigma)], 0.004, rtol=0.04)


@pytest.mark.parametrize("slant_deg", [0, 30, 60, 75])
@pytest.mark.parametrize("noise_share", [0.0, 0.5])
def test_smooth_planes_have_the_sensors_noise(slant_deg, noise_share):
    # Neither the slope nor noise below the sensor's changes what the sensor model says.
    x = (np.arange(160) - 79.5) / 400
    plane = np.repeat(0.8 / (1 - x * np.tan(np.radians(slant_deg)))[None], 60, axis=0)
    assert (plane > 0).all()
    noise = np.random.default_rng(0).normal(0, 1, plane.shape)
    depth = plane + noise_share * KINECT_NOISE * np.min(plane) ** 2 * noise
    np.testing.assert_allclose(noise_sigma(depth), KINECT_NOISE * depth**2, rtol=1e-12)


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (2, 2), (3, 1)])
def test_sigma_of_tiny_maps(shape):
    np.testing.assert_allclose(noise_sigma(np.full(shape, 2.0)), 4 * KINECT_NOISE)


def test_sigma_of_nothing_is_nothing():
    assert np.isnan(noise_sigma(np.full((5, 5), np.nan))).all()


# ---- noise of several maps


def noisy_maps(count, share, seed=0, shape=(120, 160)):
    """(K, h, w) of a slanted plane with `share` times the sensor model's noise, and the plane."""
    plane = 0.6 + 0.008 * np.mgrid[: shape[0], : shape[1]][1]
    noise = np.random.default_rng(seed).normal(size=(count, *shape))
    return plane + share * SensorNoise().at(plane) * noise, plane


@pytest.mark.parametrize("count", [2, 3, 20])
@pytest.mark.parametrize("share", [0.3, 1.0, 2.5])
def test_scatter_of_the_maps_is_the_noise_of_one(count, share):
    maps, plane = noisy_maps(count, share)
    found = scatter(maps) / SensorNoise().at(plane)
    # what differs by more than three widths of the whole is left out where the noise is largest
    assert np.median(found) == pytest.approx(share, rel=0.05)
    assert np.quantile(np.abs(found - np.median(found)), 0.9) < 0.25 * share


def test_noise_is_that_of_the_maps_where_there_are_several():
    maps, plane = noisy_maps(9, 0.4)
    sigma = noise_sigma(robust_average(maps), maps_m=maps)
    assert np.median(sigma / SensorNoise().at(plane)) == pytest.approx(0.4, rel=0.05)
    # deeper is noisier, as the maps say
    assert np.median(sigma[:, -20:]) > 4 * np.median(sigma[:, :20])
    single = noise_sigma(maps[0], maps_m=maps[:1])
    np.testing.assert_allclose(np.median(single / SensorNoise().at(plane)), 1, rtol=0.05)


def test_noisy_places_are_noisy():
    maps, plane = noisy_maps(9, 0.5)
    maps[:, 40:80, 40:80] += (
        1.0
        * SensorNoise().at(plane[40:80, 40:80])
        * np.random.default_rng(3).normal(size=(9, 40, 40))
    )
    sigma = noise_sigma(robust_average(maps), maps_m=maps) / SensorNoise().at(plane)
    assert np.median(sigma[45:75, 45:75]) == pytest.approx(np.hypot(0.5, 1.0), rel=0.08)
    assert np.median(sigma[:30]) == pytest.approx(0.5, rel=0.08)


def test_maps_that_repeat_each_other_say_nothing():
    # A fixed pattern of smooth errors: what the maps have in common is not known from them.
    one, plane = noisy_maps(1, 1.0)
    maps = np.repeat(one, 5, axis=0)
    assert (scatter(maps) == 0).all()
    sigma = noise_sigma(plane, maps_m=maps)
    np.testing.assert_allclose(sigma, SensorNoise().at(plane), rtol=1e-12)


def test_coarse_steps_are_not_free_of_noise():
    maps, plane = noisy_maps(12, 0.4)
    maps = np.rint(maps * 500) / 500  # 2 mm: where it is near, few maps differ at all
    sigma = noise_sigma(robust_average(maps), maps_m=maps) / SensorNoise().at(plane)
    assert (scatter(maps) < 0.02e-3).any()
    assert sigma.min() > 0.15


def test_scatter_where_little_was_measured():
    maps, _ = noisy_maps(4, 1.0)
    maps[:, :60] = np.nan
    maps[1:, 60:, :80] = np.nan  # measured once
    found = scatter(maps)
    assert np.isnan(found[:50]).all()
    assert np.isnan(found[70:, :70]).all()
    assert np.isfinite(found[70:, 90:]).all()
    average = np.where(np.isfinite(maps[0]), maps[0], 1.0)
    assert np.isfinite(noise_sigma(average, maps_m=maps)).all()


@pytest.mark.parametrize("growth", [0.0, 1.0, 2.0])
def test_a_given_noise_model_is_used(growth):
    maps, plane = noisy_maps(5, 3.0)
    noise = SensorNoise(sigma_m=0.002, at_m=0.8, growth=growth)
    sigma = noise_sigma(plane, noise, maps)
    np.testing.assert_allclose(sigma, 0.002 * (plane / 0.8) ** growth, rtol=1e-12)


def test_noise_that_counts_is_that_of_the_object():
    depth = np.full((60, 80), 0.8)
    depth[:, 40:] += np.random.default_rng(0).normal(0, 0.03, (60, 40))
    on_object = np.arange(80) < 35
    sigma = noise_sigma(depth, on_object=np.broadcast_to(on_object, depth.shape))
    np.testing.assert_allclose(sigma[:, :35], SensorNoise().at(depth[:, :35]), rtol=1e-12)


def test_the_noise_of_the_surroundings_is_not_the_objects():
    depth, on_object = np.ones((40, 40)), np.zeros((40, 40), bool)
    on_object[:, :12] = True
    depth[~on_object] += 0.05 * np.random.default_rng(0).standard_normal((~on_object).sum())
    found = noise_sigma(depth, on_object=on_object)[on_object]
    np.testing.assert_allclose(found, SensorNoise().at(depth)[on_object])


def test_pixels_where_all_maps_agree_are_not_free_of_noise():
    flat = np.ones((40, 60))
    noise = 0.01 * np.random.default_rng(0).standard_normal((6, 40, 60))
    sigma = noise_sigma(flat, maps_m=flat + noise * (np.arange(60) >= 20))
    assert sigma[:, :10].min() > 0.3 * np.median(sigma[:, 30:])
