"""How far the refined depth and normals are expected to be off."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rakelight import MultiLight, refine
from rakelight.geometry.normals import normal_lengths, squared_normal_derivative
from rakelight.methods.base import UNDETERMINED_RAD
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light.bas_relief_variance import sensor_moment
from rakelight.methods.multi_light.confidence import (
    depth_sigma,
    mean_error_variance,
    photometric_variance,
    sensor_length,
)
from rakelight.methods.multi_light.energy import first_fit
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene
from tests.methods.multi_light.test_sensor_blur import known
from tests.methods.remembered import remembered

HEAD = remembered(make_shape("head"))


@cache
def make_scene(rms_mm=1.0, seed=0):
    options = SceneOptions(
        camera=HEAD.camera.scaled(0.25),
        photographs=8,
        seed=seed,
        depth_noise=DepthNoise(rms_mm=rms_mm, correlation_length_px=4.0, growth=0.0),
    )
    return render_scene(HEAD, make_albedo("simple"), options)


@cache
def make_fit():
    prepared = prepare(make_scene()[0])
    level = finest_level(prepared)
    return prepared, level, first_fit(level, level.prior, lights_of_prior(level))


def with_tensor(fit, uu, uv, vv):
    tensor = np.broadcast_to([uu, uv, vv], fit.linearization.jtwj.shape)
    return replace(fit, linearization=replace(fit.linearization, jtwj=tensor))


def test_noise_turns_a_normal_in_both_directions():
    _, level, fit = make_fit()
    gradient, camera = fit.surface.gradient, level.photographs.camera
    turn = squared_normal_derivative(
        normal_lengths(gradient[..., 0], gradient[..., 1], camera), camera
    )
    turns = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    (uu, uv), (_, vv) = turns @ np.diag([4e4, 1e4]) @ turns.T
    found = photometric_variance(level, with_tensor(fit, uu, uv, vv), np.full(turn.shape, 0.002))
    # d = M^-1 b with b of covariance sigma^2 M: variances sigma^2 / 4e4 and sigma^2 / 1e4.
    expected = np.minimum(turn * 0.002**2 * (1 / 4e4 + 1 / 1e4) / 2, UNDETERMINED_RAD**2)
    active = level.photographs.active
    np.testing.assert_allclose(found[active], expected[active], rtol=1e-9)
    assert (expected[active] < UNDETERMINED_RAD**2).mean() > 0.9


def test_what_photographs_do_not_tell_is_half_a_radian():
    _, level, fit = make_fit()
    noise = np.full(level.mask.shape, 0.002)
    found = photometric_variance(level, with_tensor(fit, 1e4, 0.0, 0.0), noise)
    np.testing.assert_array_equal(found, UNDETERMINED_RAD**2)


def test_the_sensor_takes_over_where_it_says_as_much():
    _, level, fit = make_fit()
    held = fit.noise**2 * float(np.median(level.prior_weight[level.photographs.active]))
    fit = with_tensor(fit, 64 * held, 0.0, 64 * held)
    assert sensor_length(level, fit) == pytest.approx(8.0)
    assert sensor_length(level.weighted(4.0), fit) == pytest.approx(4.0)
    assert sensor_length(level.weighted(1e9), fit) == 1.0
    assert sensor_length(level.weighted(1e-9), fit) == pytest.approx(np.sqrt(level.mask.sum()))


@pytest.mark.parametrize("width", [0.0, 2.0])
def test_the_mean_of_the_sensors_error_is_that_of_its_blocks(width):
    """White noise averages out over 4 x 4 pixels, correlated errors much less."""
    prepared, _, fit = make_fit()
    rng = np.random.default_rng(0)
    error = gaussian_filter(rng.normal(size=prepared.sensor.depth_m.shape), width)
    error *= 0.001 / error.std()
    averaging = prepared.sensor.averaging(prepared.mask)
    depth_m = np.exp(averaging.down(fit.log_depth) + error)
    sensor = replace(
        prepared.sensor,
        depth_m=np.where(prepared.sensor.measured, depth_m, prepared.sensor.depth_m),
    )
    found = mean_error_variance(
        replace(prepared, sensor=sensor), fit.log_depth, 4.5 * prepared.factor
    )
    rows, columns = (size // 4 * 4 for size in error.shape)
    whole = error[:rows, :columns].reshape(rows // 4, 4, columns // 4, 4).mean(axis=(1, 3))
    assert found == pytest.approx(float(np.mean(whole**2)), rel=0.2 if width else 0.1)
    assert (found > 0.2e-6) == (width > 0)


def test_each_part_of_the_depths_error_counts():
    prepared, level, fit = make_fit()
    still = np.zeros(level.mask.shape)
    moment = sensor_moment(level, fit.log_depth)
    least = depth_sigma(level, fit, prepared, still, moment, fit.log_depth)
    more = depth_sigma(level, fit, prepared, still + np.radians(5.0) ** 2, moment, fit.log_depth)
    pixel_m = np.exp(fit.log_depth) / level.photographs.camera.fx
    walk = np.radians(5.0) * np.sqrt(sensor_length(level, fit)) * pixel_m
    np.testing.assert_allclose(more**2 - least**2, walk**2, rtol=1e-6)
    off = replace(
        level, unbiased_prior=level.unbiased_prior + 0.01 * np.linspace(-1, 1, level.mask.shape[1])
    )
    loosest = sensor_moment(off, fit.log_depth)
    loose = depth_sigma(off, fit, prepared, still, loosest, fit.log_depth)
    assert (loose > 2 * least)[level.mask].mean() > 0.5
    bent = fit.log_depth + 0.01 * np.linspace(-1, 1, level.mask.shape[1])
    far = depth_sigma(level, fit, prepared, still, moment, bent)
    assert (far > 1.5 * least)[level.mask].all()


def test_expected_errors_of_a_result_are_about_its_errors():
    capture, truth = make_scene()
    result = refine(capture, MultiLight(distance="distant"))
    inside = truth.mask & result.mask
    angle_deg = np.degrees(np.arccos(np.clip(np.sum(result.normals * truth.normals, -1), -1, 1)))
    for error, sigma in (
        (angle_deg, result.normal_sigma),
        (np.abs(result.depth - truth.depth), result.depth_sigma),
    ):
        assert sigma.dtype == np.float32
        np.testing.assert_array_equal(np.isfinite(sigma), result.mask)
        assert (sigma[result.mask] > 0).all()
        times = np.median(sigma[inside]) / np.sqrt(np.mean(error[inside] ** 2))
        assert 0.4 < times < 2.5


def test_a_worse_sensor_makes_the_depth_less_certain():
    """Of four captures each the expected error is the true one to less than a factor of two."""
    sigmas, errors = np.zeros((2, 4)), np.zeros((2, 4))
    for row, rms_mm in enumerate((0.5, 6.0)):
        for seed in range(4):
            capture, truth = make_scene(rms_mm, seed)
            result = refine(capture, MultiLight(distance="distant"))
            inside = truth.mask & result.mask
            sigmas[row, seed] = np.median(result.depth_sigma[inside])
            errors[row, seed] = np.sqrt(np.mean((result.depth - truth.depth)[inside] ** 2))
    sigmas, errors = (np.sqrt(np.mean(each**2, axis=1)) for each in (sigmas, errors))
    times = sigmas / errors
    assert (times > 0.8).all()
    assert (times < 2).all()
    assert sigmas[1] > 2.5 * sigmas[0]


def test_the_error_of_the_whole_shape_is_in_metres():
    prepared, level, fit = make_fit()
    still, moment = np.zeros(level.mask.shape), np.zeros((4, 4))
    least = depth_sigma(level, fit, prepared, still, moment, fit.log_depth)
    moment[0, 0] = 0.01**2  # of a in 1/z' = a/z, by which z' changes by z da
    more = depth_sigma(level, fit, prepared, still, moment, fit.log_depth)
    expected = (0.01 * np.exp(fit.log_depth)) ** 2
    np.testing.assert_allclose(more**2 - least**2, expected, rtol=1e-6)


def test_means_over_blocks_are_of_the_sensors_pixels():
    prepared, _, fit = known(0.0, 2)
    sensor = prepared.sensor
    error = 0.001 * np.random.default_rng(0).normal(size=sensor.depth_m.shape)
    depth_m = np.exp(sensor.averaging(prepared.mask).down(fit.log_depth) + error)
    noisy = replace(sensor, depth_m=np.where(sensor.measured, depth_m, np.nan))
    found = mean_error_variance(replace(prepared, sensor=noisy), fit.log_depth, 9.0)
    assert found == pytest.approx(1e-6 / 16, rel=0.3)  # 4 x 4 of the sensor's pixels
