"""What the sensor's depth counts, and the lights' brightness beside it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light.energy import first_fit
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.noise import (
    block_variances,
    correlation_ratio,
    estimate_depth_weight,
    estimate_equal_intensity_weight,
    estimate_laplacian_weight,
    variances_by_scale,
)
from rakelight.metrics import evaluate_maps
from rakelight.photometry.images import LightParameters
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.synthetic import (
    DepthNoise,
    SceneOptions,
    make_albedo,
    make_shape,
    random_capture,
    render_scene,
)

NOISE = 0.003


@cache
def scene():
    shape = make_shape("vase")
    options = SceneOptions(camera=shape.camera.scaled(0.4), photographs=6)
    prepared = prepare(render_scene(shape, make_albedo("simple"), options)[0])
    level = finest_level(prepared)
    # A sensor without errors of its own.
    sensor = replace(prepared.sensor, depth_m=np.exp(level.prior))
    prepared = replace(prepared, sensor=sensor)
    return prepared, replace(level, prior_weight=np.where(level.mask, NOISE**-2, 0.0))


def equal_intensity_weight(error):
    """Where the sensor is off a surface by `error` (h, w), which its weight takes for white."""
    prepared, level = scene()
    return estimate_equal_intensity_weight(level, level.prior - error, prepared)


def white(shape, seed=0):
    return NOISE * np.random.default_rng(seed).normal(size=shape)


def test_beside_white_noise_lights_count_as_they_are():
    _, level = scene()
    assert 0.9 < equal_intensity_weight(white(level.mask.shape)) < 1.6


def test_beside_correlated_errors_they_count_by_the_area_of_those():
    _, level = scene()
    blur = 3.0
    error = gaussian_filter(white(level.mask.shape), blur)
    error *= NOISE / error.std()
    # Errors under a Gaussian of white noise share 4 pi sigma^2 pixels; blocks of 16 cut them off.
    area = 4 * np.pi * blur**2
    assert 0.4 * area < equal_intensity_weight(error) < 1.1 * area


def test_an_offset_is_no_error_and_a_jump_hardly_one():
    _, level = scene()
    error = white(level.mask.shape)
    jump = error.copy()
    jump[10:13, 40:44] += 1.0
    assert equal_intensity_weight(error + 0.1) == pytest.approx(equal_intensity_weight(error))
    assert equal_intensity_weight(jump) < 1.5 * equal_intensity_weight(error)


def test_a_sensor_that_saw_nothing_says_nothing():
    prepared, level = scene()
    sensor = replace(prepared.sensor, depth_m=np.full_like(prepared.sensor.depth_m, np.nan))
    assert (
        estimate_equal_intensity_weight(level, level.prior, replace(prepared, sensor=sensor)) == 0
    )


def correlation(smooth):
    """Of the true surface and lights; photographs are brighter by `smooth`, rms, over 12 pixels."""
    shape = make_shape("vase")
    options = SceneOptions(camera=shape.camera.scaled(0.4), photographs=6, image_noise=0.01)
    capture, truth = render_scene(shape, make_albedo("simple"), options)
    error = np.random.default_rng(0).normal(size=capture.photographs.shape[:3])
    error = gaussian_filter(error, (0, 12.0, 12.0))[..., None]
    spoiled = capture.photographs * (1 + smooth * error / error.std())
    spoiled = np.clip(spoiled, 0, 65535).astype(capture.photographs.dtype)
    prepared = prepare(replace(capture, photographs=spoiled))
    level, window = finest_level(prepared), (prepared.rows, prepared.columns)
    depth = np.where(prepared.mask, np.nan_to_num(truth.depth[window], nan=1.0), prepared.depth_m)
    lights = LightParameters.distant(truth.lights.vector, truth.lights.ambient)
    return correlation_ratio(level, first_fit(level, np.log(depth), lights))


def test_photographs_that_err_together_count_as_fewer():
    white, slightly, much = map(correlation, (0.0, 0.02, 0.1))
    # Differences of a depth map leave residuals at the vase's rim, without any such error, too.
    assert white < 2
    assert slightly > 1.3 * white
    assert much > 4 * slightly


def weight(error, tails, least=1.0):
    """Where the sensor is off a surface by `error` (h, w), and residuals have such tails."""
    prepared, level = scene()
    fit = first_fit(level, level.prior - error, lights_of_prior(level))
    linearization = replace(fit.linearization, noise_sigma=0.01, rms=0.01 * tails)
    return estimate_depth_weight(replace(fit, linearization=linearization), prepared, least)


def test_depth_counts_by_the_area_over_which_its_errors_are_correlated():
    _, level = scene()
    error = white(level.mask.shape)
    wide = gaussian_filter(error, 2.0)
    # Neighbours under a Gaussian of white noise differ by 2 (1 - exp(-1 / 4 sigma^2)) variances.
    area = 1 / (2 * (1 - np.exp(-1 / 16)))
    assert weight(error, 1.0) == pytest.approx(25 * 2, rel=0.1)
    assert weight(wide, 1.0) == pytest.approx(25 / area, rel=0.2)


@pytest.mark.parametrize("side", [2, 4])
def test_depth_of_repeated_pixels_counts_once_a_block(side):
    _, level = scene()
    rows, columns = level.mask.shape
    blocks = np.kron(white(level.mask.shape), np.ones((side, side)))[:rows, :columns]
    rounding = 1e-14 * np.random.default_rng(1).normal(size=level.mask.shape)
    assert weight(blocks + rounding, 1.0) == pytest.approx(25 * 2 / side**2, rel=0.4)


def test_a_sensor_found_to_be_more_precise_counts_by_its_own_variance():
    """As far as it was found to be: `scene`'s sensor is taken to have millimetres."""
    prepared, level = scene()
    deviations = prepared.sigma_m / prepared.depth_m / NOISE * white(level.mask.shape)
    as_stated = weight(deviations, 1.0)
    assert weight(deviations, 1.0, 0.01) == pytest.approx(as_stated, rel=0.05)
    assert weight(0.2 * deviations, 1.0) == pytest.approx(as_stated, rel=0.01)
    assert weight(0.2 * deviations, 1.0, 0.01) == pytest.approx(25 * as_stated, rel=0.05)
    assert weight(0.02 * deviations, 1.0, 0.01) == pytest.approx(100 * as_stated, rel=0.05)
    assert weight(3 * deviations, 1.0, 0.01) == pytest.approx(as_stated, rel=0.01)


def test_a_precise_sensor_keeps_its_shape():
    """Errors of 0.05 mm, where structured light has 1 mm and more, under shadows and highlights.

    With weights up to ten times that of such a sensor it is 0.9 mm off.
    """
    capture, truth = random_capture(
        1837, size=0.35, shape="vase", depth_factor=1,
        depth_rms_mm=0.05, depth_white_mm=0.02,
        **dict.fromkeys(("depth_step_mm", "depth_bend_mm", "flying", "hole_fraction"), 0.0),
        **dict.fromkeys(("shift_x", "shift_y"), 0.0), mask_px=0,
    )  # fmt: skip
    result = refine(capture, "multi-light")
    assert evaluate_maps(result.depth, result.normals, truth).depth.rmse_mm < 0.25


def test_white_noise_is_alike_at_all_scales_and_smooth_errors_are_large_at_coarse_ones():
    seen = np.ones((128, 96), bool)
    error = np.random.default_rng(1).standard_normal(seen.shape)
    sides, modes, variances = np.transpose(variances_by_scale(error, seen))
    assert sides.tolist() == [1, 2, 4, 8, 16, 32, 64]
    assert modes.sum() == seen.size - 1
    np.testing.assert_allclose(variances[:4], 1, atol=0.2)
    wide = gaussian_filter(error, 6.0)
    _, _, smooth_variances = np.transpose(variances_by_scale(wide / wide.std(), seen))
    assert 50 * smooth_variances[0] < 1 < smooth_variances[3] / 10
    assert variances_by_scale(error[:1, :1], seen[:1, :1]) == []


def test_scales_of_a_part_are_those_of_its_own_pixels():
    seen = np.random.default_rng(2).random((64, 64)) < 0.7
    error = np.where(seen, np.random.default_rng(3).standard_normal(seen.shape), 0.0)
    _, modes, variances = np.transpose(variances_by_scale(error, seen))
    assert modes.sum() == np.count_nonzero(seen) - 1
    mean = error.sum() / np.count_nonzero(seen)
    total = np.sum((error - mean)[seen] ** 2)
    assert modes @ variances == pytest.approx(total)


def test_the_weight_has_no_bounds():
    wide = gaussian_filter(white(scene()[1].mask.shape), 14.0)
    assert 0 < weight(wide, 1.0) < 0.3
    # White noise is correlated over half a pixel; heavy tails count as the photographs' errors.
    assert weight(white(wide.shape), 1e3) == pytest.approx(1e3 * 25 / 0.5, rel=0.01)


def test_noisy_photographs_do_not_hand_the_surface_to_the_sensor():
    cloth = make_shape("cloth")
    options = SceneOptions(
        camera=cloth.camera.scaled(0.4),
        lamp_distance_m=0.6,
        image_noise=0.03,
        depth_noise=DepthNoise(rms_mm=3.3, correlation_length_px=11.0),
    )
    capture, truth = render_scene(cloth, make_albedo("pattern"), options)
    result = refine(capture, "multi-light")
    scores = evaluate_maps(result.depth, result.normals, truth)
    assert scores.normals.mae_deg < 3
    assert scores.depth.rmse_mm < 1.8


# ---- the weight of the Laplacian of the change


def laplacian_weight(change, across_deg=0.0):
    """Of a surface that differs from the prepared one by `change` (h, w).

    Under lights from left to right, and `across_deg` above and below.
    """
    _, level = scene()
    tilt, across = np.radians([-40.0, -25, -10, 10, 25, 40]), np.radians(across_deg)
    off = np.tan(across) * np.array([1.0, -1, 1, -1, 1, -1])
    vector = np.stack([np.sin(tilt), off, -np.cos(tilt)], axis=-1)
    lights = LightParameters.distant(vector[:, None], np.full((6, 1), 0.1))
    fit = first_fit(level, level.prior, lights)
    return estimate_laplacian_weight(level, replace(fit, log_depth=level.prior + change))


def smooth(seed=0):
    return gaussian_filter(white(scene()[1].mask.shape, seed), 2.0)


def test_the_laplacians_weight_is_one_over_the_variance_of_curvature_along_the_lights_plane():
    _, level = scene()
    once = laplacian_weight(smooth())
    assert laplacian_weight(2 * smooth()) == pytest.approx(once / 4)
    # Curvature is correlated over a few pixels, which count as one.
    curvature = np.gradient(np.gradient(smooth(), axis=1), axis=1)[level.links.inner]
    assert 0.1 / curvature.var() < once < 0.3 / curvature.var()


def test_rows_that_have_parted_do_not_make_it_count_less():
    rows = 20 * white((len(scene()[1].mask), 1), seed=1)
    assert laplacian_weight(smooth() + rows) == pytest.approx(laplacian_weight(smooth()), rel=0.2)


def test_lights_off_the_plane_need_no_laplacian():
    assert laplacian_weight(smooth(), across_deg=10) == 0


def test_a_surface_that_has_not_moved_says_nothing_of_how_far_it_may():
    assert laplacian_weight(np.zeros(scene()[1].mask.shape)) == 0
    assert laplacian_weight(1e-6 * smooth()) == 0


def test_a_surface_that_is_exactly_the_sensors_has_a_finite_weight():
    prepared, level = scene()
    fit = first_fit(level, level.prior, lights_of_prior(level))
    depth_m = np.full_like(prepared.sensor.depth_m, 0.5)
    flat = replace(prepared, sensor=replace(prepared.sensor, depth_m=depth_m))
    fit = replace(fit, log_depth=np.full(level.mask.shape, np.log(0.5)))
    assert estimate_depth_weight(fit, flat) == 25.0


def test_errors_that_most_pixels_do_not_have_are_seen():
    error = np.zeros((32, 32))
    error[:, :12] = 1.0
    found = block_variances(error, np.ones(error.shape, bool))
    assert found[4] == pytest.approx(16 * 12 / 32)
    assert block_variances(error, np.zeros(error.shape, bool)) == {1: 0.0}
