"""What multi-light decides at its coarsest level: the depth weight, lights, ambient light."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rakelight.methods.levels import finest_level, pyramid
from rakelight.methods.multi_light import FIRST_DEPTH_WEIGHT, MultiLight
from rakelight.methods.multi_light.energy import first_fit, lights_after, parameter_map
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.model_selection import (
    penalised_noise,
    search_depth_weight,
    select_model,
    with_near_lights,
)
from rakelight.methods.multi_light.steps import Descent
from rakelight.metrics import evaluate_maps
from rakelight.model import silent
from rakelight.photometry.images import LightParameters
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

CORRELATED = DepthNoise(rms_mm=3.3, correlation_length_px=14.0)


def scene(noise, name="coin", size=1.0, **settings):
    shape = make_shape(name)
    options = SceneOptions(camera=shape.camera.scaled(size), depth_noise=noise, **settings)
    return render_scene(shape, make_albedo("pattern"), options)


@cache
def coarsest(noise, size=1.0, **settings):
    captured, _ = scene(noise, size=size, **settings)
    finest = finest_level(prepare(captured), cut=True, unbiased=True)
    return pyramid(finest.weighted(FIRST_DEPTH_WEIGHT), 4000)[-1]


@cache
def selected(noise, **options):
    return select_model(coarsest(noise), MultiLight(**options), silent, "look")


def test_depth_whose_errors_are_correlated_has_less_weight():
    factors = [selected(noise)[0] for noise in (DepthNoise(rms_mm=2.5), CORRELATED)]
    assert factors[0] == 1 > 50 * factors[1]


def test_lights_of_equal_intensity_speak_for_less_weight():
    """Of the coin, a flat surface explains photographs half as well; but its lights are unlike."""
    factor, descent = selected(CORRELATED)
    _, weighed = selected(CORRELATED, depth_weight=1.0)
    fits = [found.fit for found in (weighed, descent)]
    residuals = [fit.linearization.noise_sigma for fit in fits]
    both = [penalised_noise(coarsest(CORRELATED), fit) for fit in fits]
    assert factor < 0.02
    assert residuals[1] > 0.5 * residuals[0]
    assert both[1] < 0.5 * both[0]


def test_low_relief_under_near_lights_keeps_its_height():
    capture, truth = scene(CORRELATED, "cloth", 0.5, lamp_distance_m=0.5, ambient=0.1)
    result = refine(capture, "multi-light")
    slopes = [n[truth.mask][:, 0] / n[truth.mask][:, 2] for n in (result.normals, truth.normals)]
    assert np.polyfit(slopes[1], slopes[0], 1)[0] == pytest.approx(1, abs=0.2)
    assert np.median(result.lights.distance_m) == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize("seed", [0, 1])
def test_near_lights_are_found_over_a_coin(seed):
    """What fall-off makes of a flat object, bent surfaces and lights at random explain as well."""
    noise = DepthNoise(rms_mm=2.5, correlation_length_px=14.0)
    capture, truth = scene(noise, "coin", 0.6, lamp_distance_m=0.6, photographs=16, seed=seed)
    result = refine(capture, "multi-light")
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 5
    assert np.median(result.lights.distance_m) == pytest.approx(0.6, rel=0.1)


def test_lights_that_would_be_very_near_are_penalised():
    level = coarsest(CORRELATED)
    fit = selected(CORRELATED, distance="distant")[1].fit
    far, by_it = (
        penalised_noise(
            level, replace(fit, lights=replace(fit.lights, inverse_distance=np.full((12, 1), each)))
        )
        for each in (0.0, 1 / np.linalg.norm(level.points[level.mask], axis=-1).max())
    )
    assert by_it == pytest.approx(2 * far)


def test_strong_highlights_do_not_bend_the_surface():
    glossy = {"specular": 0.6, "lamp_distance_m": 0.6, "photographs": 16}
    capture, truth = scene(CORRELATED, "sphere", 0.4, **glossy)
    result = refine(capture, "multi-light")
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 3


def test_near_lights_too_begin_where_the_residuals_are_smallest():
    """One step from the sensor's depth explains less than one from another start, the truth."""
    near = {"size": 0.4, "name": "vase", "lamp_distance_m": 0.5}
    level, exact = coarsest(CORRELATED, **near), coarsest(DepthNoise(), **near)
    there = first_fit(level, exact.prior, lights_of_prior(exact))
    start = with_near_lights(level, first_fit(level, level.prior, lights_of_prior(level)))
    descent = Descent((start,), converged=True, steps=0)
    residuals = [
        search_depth_weight(level, descent, MultiLight(max_iterations=1), silent, starts)[
            1
        ].fit.linearization
        for starts in ((), (there,))
    ]
    assert residuals[1].noise_sigma < 0.95 * residuals[0].noise_sigma


def test_a_weight_that_was_asked_for_is_kept():
    factor, _ = selected(CORRELATED, depth_weight=1.0)
    assert factor == 1 > selected(CORRELATED)[0]


@pytest.mark.parametrize("near", [False, True])
def test_a_shared_ambient_ratio_is_kept_by_a_step(near):
    level = coarsest(CORRELATED, 0.25)
    vector = lights_of_prior(level).vector
    size = np.linalg.norm(vector, axis=-1)
    lights = LightParameters(vector, 0.2 * size, np.full_like(size, 0.5))
    fit = first_fit(level, level.prior, lights, near, shared_ambient=True)
    free = parameter_map(fit)
    step = 1e-6 * np.random.default_rng(0).normal(size=free.shape[1])
    after = lights_after(fit, step)
    ratio = after.ambient / np.linalg.norm(after.vector, axis=-1)
    assert np.ptp(ratio) < 1e-12
    alone = replace(fit, shared_ambient=False)
    linear = lights_after(alone, free @ step)
    np.testing.assert_allclose(linear.vector, after.vector, atol=1e-12)
    np.testing.assert_allclose(linear.ambient, after.ambient, atol=1e-10)
