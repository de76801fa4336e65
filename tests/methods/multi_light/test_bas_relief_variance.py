from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light.bas_relief import nearest_bas_relief
from rakelight.methods.multi_light.bas_relief_variance import (
    lights_moment,
    quadratic_form,
    sensor_moment,
    shape_errors,
)
from rakelight.photometry.images import LightParameters
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise
from tests.check.wrong_captures import sound

NOISE = DepthNoise(rms_mm=2.0, correlation_length_px=4.0, growth=0.0)


def true_level(noise):
    """The finest level of a capture, its true log depth (h, w) and lights."""
    capture, truth = sound("head", noise=noise)
    prepared = prepare(capture)
    level = finest_level(prepared)
    true = truth.depth[prepared.rows, prepared.columns]
    log_depth = np.where(np.isfinite(true), np.log(np.nan_to_num(true, nan=1.0)), level.prior)
    return level, log_depth, LightParameters.distant(truth.lights.vector, truth.lights.ambient)


def fitted_relief(level, log_depth, lights):
    """The true relief, its bas-relief transform read off the sensor: what the variance is of."""
    return nearest_bas_relief(level, log_depth, lights)[0]


def normals_of(level, log_depth):
    gradient = level.surface(log_depth).gradient
    return normals_from_gradient(gradient[..., 0], gradient[..., 1], level.photographs.camera)[0]


def test_the_variance_is_that_of_reading_the_transform_off_the_sensor():
    """Over sensors with errors of their own the mean squared angle is about what is expected."""
    squares, expected = [], []
    level, log_depth, lights = true_level(NOISE)
    active = level.photographs.active
    true = normals_of(level, log_depth)
    for seed in range(30):
        rng = np.random.default_rng(seed)
        error = gaussian_filter(rng.normal(size=log_depth.shape), 2.0)
        error *= 0.002 / error.std()
        level = replace(level, unbiased_prior=np.log(np.exp(log_depth) + error))
        fitted = fitted_relief(level, log_depth, lights)
        cosine = np.sum(normals_of(level, fitted) * true, axis=-1)
        squares.append(np.mean(np.arccos(np.clip(cosine, -1, 1))[active] ** 2))
        _, variance = shape_errors(level, fitted, lights)
        expected.append(np.mean(variance[active]))
    # Blocks of the size that gives the largest variance: more than the truth, not less.
    assert 0.8 < np.mean(expected) / np.mean(squares) < 2.5


def test_it_grows_with_the_sensors_noise():
    level, log_depth, lights = true_level(NOISE)
    error = gaussian_filter(np.random.default_rng(0).normal(size=log_depth.shape), 2.0)
    quiet, loud = (
        shape_errors(replace(level, unbiased_prior=log_depth + size * error), log_depth, lights)[1]
        for size in (0.001, 0.008)
    )
    np.testing.assert_allclose(loud.max() / quiet.max(), 64, rtol=0.1)


def test_lights_that_are_alike_contradict_nothing():
    level, _, lights = true_level(NOISE)
    assert np.abs(lights_moment(level, lights)).max() < 1e-12


def test_lights_of_a_flattened_surface_contradict_it():
    level, _, lights = true_level(NOISE)
    g = np.array([0.0, 0.0, 0.5])
    transform = np.linalg.inv(np.eye(3) + np.outer(level.middle_m, g))
    flattened = replace(lights, vector=lights.vector @ transform.T)
    found = np.sqrt(np.diag(lights_moment(level, flattened)))
    assert 0.33 < found[2] < 0.5
    assert found[:2].max() < 0.3 * found[2]


def test_lights_that_differ_by_chance_contradict_little():
    level, _, lights = true_level(NOISE)
    rng = np.random.default_rng(0)
    gains = np.exp(0.3 * rng.normal(size=(200, len(lights.vector), 1, 1)))
    found = [lights_moment(level, replace(lights, vector=gain * lights.vector)) for gain in gains]
    assert np.mean([not moment.any() for moment in found]) > 0.8


def test_lights_at_one_tilt_say_nothing_along_the_view():
    """No g along the view changes how their intensities differ, but all of them alike."""
    level, _, _ = true_level(NOISE)
    rng = np.random.default_rng(0)
    turn, tilt = 2 * np.pi * np.arange(8) / 8, np.radians(40) + 0.001 * rng.normal(size=8)
    sides = np.sin(tilt)[:, None] * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=-1)
    ring = sides - np.cos(tilt)[:, None] * [0.0, 0.0, 1.0]
    view = level.middle_m / np.linalg.norm(level.middle_m)
    turned, _ = Rotation.align_vectors(view[None], [[0.0, 0.0, 1.0]])
    gains = np.exp(0.002 * rng.normal(size=(30, 8, 1)))
    for vector in gains * turned.apply(ring):
        found = lights_moment(level, LightParameters.distant(vector[:, None], np.zeros((8, 1))))
        assert view @ found @ view < 1e-4


def test_few_lights_say_nothing():
    level, _, lights = true_level(NOISE)
    few = LightParameters(lights.vector[:5] * 2, lights.ambient[:5], lights.inverse_distance[:5])
    assert not lights_moment(level, few).any()


def test_a_sensor_that_contradicts_the_surface_counts():
    level, log_depth, _ = true_level(NOISE)
    flat = replace(
        level, unbiased_prior=np.full_like(level.unbiased_prior, np.median(log_depth[level.mask]))
    )
    contradicted, agreed = (
        np.trace(sensor_moment(each, log_depth)[1:, 1:]) for each in (flat, level)
    )
    assert contradicted > 20 * agreed


def test_no_variance_is_below_zero_where_the_sensor_hardly_determines_the_transform():
    """On a surface that is nearly a plane, a and g along its normal can hardly be told apart."""
    level, log_depth, _ = true_level(NOISE)
    rng = np.random.default_rng(0)
    level = replace(level, unbiased_prior=log_depth + 0.001 * rng.normal(size=log_depth.shape))
    moment = sensor_moment(level, np.log(0.5) + 1e-6 * rng.normal(size=log_depth.shape))
    assert moment.max() > 1e5
    np.testing.assert_array_equal(moment, moment.T)
    assert np.linalg.eigvalsh(moment).min() > -1e-12 * moment.max()


def test_rounding_leaves_no_variance_below_zero():
    rng = np.random.default_rng(3)
    g, derivative = rng.normal(size=(2, 3))
    derivative -= g * (derivative @ g) / (g @ g)
    moment = 1e12 * np.outer(g, g)
    assert derivative @ moment @ derivative < 0
    assert quadratic_form(derivative[None, None, None], moment).tolist() == [[0.0]]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_moment_is_that_of_the_transform_of_the_lights(axis):
    level, _, lights = true_level(NOISE)
    g = 0.2 * np.eye(3)[axis]
    transform = np.linalg.inv(np.eye(3) + np.outer(level.middle_m, g))
    moment = lights_moment(level, replace(lights, vector=lights.vector @ transform.T))
    assert moment @ g / 0.2 == pytest.approx(0.2 * g, abs=0.4 * 0.04)
