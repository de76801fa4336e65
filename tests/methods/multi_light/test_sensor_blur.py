"""Depth that the sensor has smoothed: how wide, and that relief keeps its height."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rakelight import refine
from rakelight.geometry.averaging import Averaging
from rakelight.geometry.blur import blurred
from rakelight.geometry.grid import area_mean
from rakelight.methods.base import scatter
from rakelight.methods.levels import finest_level, sensor_error
from rakelight.methods.multi_light import MultiLight, sensor_blur
from rakelight.methods.multi_light.bas_relief import nearest_bas_relief
from rakelight.methods.multi_light.energy import first_fit
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.light_model import FREE
from rakelight.methods.multi_light.sensor_blur import (
    blurred_sensor,
    find_blur,
    lost_detail,
    sharpened,
    sharpened_measurements,
)
from rakelight.metrics import evaluate_maps
from rakelight.model import RigidTransform
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

NOISE = DepthNoise(rms_mm=0.5)
BLUR_PX = 2.5


def captured(blur_px, name="head", factor=2, size=0.4):
    """A capture whose depth a sensor smooths by so many of its pixels before its noise is added."""
    shape = make_shape(name)
    options = SceneOptions(
        camera=shape.camera.scaled(size), photographs=12, depth_factor=factor,
        depth_noise=DepthNoise(rms_mm=0.0),
    )  # fmt: skip
    capture, truth = render_scene(shape, make_albedo("pattern"), options)
    depth = capture.depth_m[0].astype(float)
    seen = np.isfinite(depth) & (area_mean(1.0 * capture.mask, factor) > 0)
    if blur_px:
        depth = np.where(seen, blurred(depth, blur_px, seen), np.nan)
    depth += 5e-4 * np.random.default_rng(0).standard_normal(depth.shape)
    return replace(capture, depth_m=depth[None].astype(np.float32)), truth


@cache
def known(blur_px, factor=2):
    """The true surface and its lights, and the finest level whose p_0 the sensor has smoothed."""
    capture, truth = captured(blur_px, factor=factor)
    prepared = prepare(capture)
    depth = truth.depth[prepared.rows, prepared.columns]
    exact = replace(prepared, depth_m=np.where(prepared.mask, depth, prepared.depth_m))
    level = finest_level(exact)
    error, _ = sensor_error(prepared, level.prior)
    own = level.prior + prepared.sensor.nearest_upsample(error, level.prior.shape)
    fit = first_fit(level, level.prior, lights_of_prior(level), FREE)
    return prepared, replace(level, unbiased_prior=np.where(level.mask, own, level.prior)), fit


@pytest.mark.parametrize("factor", [1, 2])
@pytest.mark.parametrize("blur_px", [1.5, 4.0])
def test_the_blur_is_found_beside_the_true_surface(blur_px, factor):
    _, level, fit = known(blur_px, factor)
    found, surface = find_blur(level, fit, 1e-2)
    assert found == pytest.approx(blur_px, rel=0.1)
    # The relief, which the sensor shows too low, is not made as low.
    lower = nearest_bas_relief(level, fit.log_depth, fit.lights)[0]
    off = [np.std((each - fit.log_depth)[level.mask]) for each in (surface, lower)]
    assert off[0] < 0.5 * off[1]


@pytest.mark.parametrize("factor", [1, 2])
def test_a_sharp_sensor_has_none(factor):
    _, level, fit = known(0.0, factor)
    found, surface = find_blur(level, fit, 1e-2)
    assert found == 0
    assert surface is fit.log_depth
    assert sharpened(level, fit.log_depth, 0.0) is level


@pytest.mark.parametrize("factor", [1, 2])
def test_what_the_blur_took_is_given_back(factor):
    _, level, fit = known(BLUR_PX, factor)
    back = sharpened(level, fit.log_depth, BLUR_PX)
    measured = level.measured[level.seen]
    off = [
        np.abs(each.sensed(each.unbiased_prior - fit.log_depth))[measured].mean()
        for each in (level, back)
    ]
    assert off[1] < 0.5 * off[0]
    assert off[1] == pytest.approx(5e-4 * np.sqrt(2 / np.pi) / level.middle_m[2], rel=0.2)


def test_what_a_blur_takes_away_is_the_surface_less_its_means():
    _, level, _ = known(0.0, 2)
    row, column = np.mgrid[: level.mask.shape[0], : level.mask.shape[1]]
    plane = np.where(level.mask, 1e-3 * column - 2e-3 * row, 0.0)
    wave = plane + 1e-2 * np.sin(2 * np.pi * column / 16)
    inner = ~blurred_rim(level)
    # A plane loses nothing, a wave of 8 sensor pixels keeps exp(-(2 pi s / 8)^2 / 2) of its height.
    assert np.abs(lost_detail(level, plane, 1.0)[inner]).max() < 1e-6
    kept = 1 - lost_detail(level, wave, 1.0)[inner].std() / level_std(level, wave - plane, inner)
    assert kept == pytest.approx(np.exp(-((2 * np.pi / 8) ** 2) / 2), abs=0.01)


def blurred_rim(level):
    """(hs, ws) the sensor's pixels within five of the object's outline, or outside."""
    from scipy.ndimage import binary_erosion

    return ~binary_erosion(level.averaging.total(np.ones(level.mask.shape)) > 3.99, iterations=5)


def level_std(level, image, where):
    return level.averaging.down(image)[where].std()


def test_measurements_are_sharpened_where_they_are():
    prepared, level, fit = known(BLUR_PX, 2)
    blur_px, after = sharpened_measurements(prepared, level, fit, 1e-2)
    assert blur_px == pytest.approx(BLUR_PX, rel=0.1)
    errors = [np.abs(sensor_error(each, fit.log_depth)[0]).mean() for each in (prepared, after)]
    assert errors[1] < 0.5 * errors[0]
    np.testing.assert_array_equal(after.sensor.measured, prepared.sensor.measured)
    assert isinstance(level.averaging, Averaging)
    sharp = known(0.0, 2)
    assert sharpened_measurements(*sharp, 1e-2)[1] is sharp[0]


def test_a_sensor_that_smooths_may_be_finer_than_the_photographs():
    fine, truth = captured(3.0, factor=1)
    height, width = (side // 2 * 2 for side in fine.mask.shape)
    part = slice(0, height), slice(0, width)
    halved = [area_mean(each[part].astype(float), 2) for each in fine.photographs]
    camera = fine.camera.cropped(*part)
    capture = replace(
        fine,
        photographs=np.rint(halved).astype(fine.photographs.dtype),
        mask=area_mean(1.0 * fine.mask[part], 2) == 1,
        camera=camera.scaled(0.5), depth_m=fine.depth_m[:, *part], depth_camera=camera,
        depth_to_color=RigidTransform(np.eye(3), np.zeros(3)),
    )  # fmt: skip
    result = refine(capture)
    assert "depth-smoothed" in {each.code for each in result.findings}
    depth = truth.depth[part][::2, ::2]
    off = [np.nanmedian(np.abs(each - depth)) for each in (result.depth, result.prepared_depth)]
    assert off[0] < 0.8 * off[1]


def test_smoothed_depth_does_not_flatten_the_surface(monkeypatch):
    capture, truth = captured(3.0)
    results = [refine(capture, MultiLight())]
    monkeypatch.setattr(sensor_blur, "LEAST_GAIN", np.inf)
    results.append(refine(capture, MultiLight()))
    errors = [evaluate_maps(each.depth, each.normals, truth) for each in results]
    assert errors[0].normals.mae_deg < 0.5 * errors[1].normals.mae_deg
    assert errors[0].depth.rmse_mm < 0.7 * errors[1].depth.rmse_mm
    said = [{each.code: each.message for each in result.findings} for result in results]
    assert "a Gaussian of" in said[0]["depth-smoothed"]
    assert "depth-smoothed" not in said[1]


def test_where_a_level_s_pixels_are_wider_the_blur_is_in_theirs():
    _, level, fit = known(0.0, 1)
    assert level.halved().sensor_pixel == level.sensor_pixel / 2
    coarse = replace(level, averaging=None, sensor_pixel=0.5)
    seen = scatter(fit.log_depth[level.seen], level.seen)
    expected = blurred(seen, 1.0, coarse.measured)[coarse.measured]
    found = scatter(blurred_sensor(coarse, fit.log_depth[level.seen], 2.0), level.seen)
    np.testing.assert_allclose(found[coarse.measured], expected)
