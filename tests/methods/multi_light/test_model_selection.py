"""What multi-light decides at its coarsest level: trust in the depth, lights, ambient light."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rakelight.methods.levels import finest_level, pyramid
from rakelight.methods.multi_light import FIRST_DEPTH_WEIGHT, MultiLight
from rakelight.methods.multi_light.energy import first_fit, lights_after, parameter_map
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.model_selection import penalised_noise, select_model
from rakelight.metrics import evaluate_maps
from rakelight.model import silent
from rakelight.photometry.images import LightParameters
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

TOGETHER = DepthNoise(rms_mm=3.3, correlation_length_px=14.0)


def scene(noise, name="coin", size=1.0, **settings):
    shape = make_shape(name)
    options = SceneOptions(camera=shape.camera.scaled(size), depth_noise=noise, **settings)
    return render_scene(shape, make_albedo("pattern"), options)


@cache
def coarsest(noise, size=1.0):
    finest = finest_level(prepare(scene(noise, size=size)[0]), cut=True, unbiased=True)
    return pyramid(finest.weighted(FIRST_DEPTH_WEIGHT), 4000)[-1]


@cache
def looked(noise, **options):
    return select_model(coarsest(noise), MultiLight(**options), silent, "look")


def test_depth_whose_errors_hang_together_is_trusted_less():
    shares = [looked(noise)[0] for noise in (DepthNoise(rms_mm=2.5), TOGETHER)]
    assert shares[0] == 1 > 50 * shares[1]


def test_lights_that_come_out_alike_speak_for_less_trust():
    """Of the coin, a flat surface explains photographs half as well; but its lights are unlike."""
    share, descent = looked(TOGETHER)
    _, believed = looked(TOGETHER, depth_weight=1.0)
    fits = [found.fit for found in (believed, descent)]
    residuals = [fit.linearization.noise_sigma for fit in fits]
    both = [penalised_noise(coarsest(TOGETHER), fit) for fit in fits]
    assert share < 0.02
    assert residuals[1] > 0.5 * residuals[0]
    assert both[1] < 0.5 * both[0]


def test_low_relief_under_near_lights_keeps_its_height():
    capture, truth = scene(TOGETHER, "cloth", 0.5, lamp_distance_m=0.5, ambient=0.1)
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


def test_lights_that_would_be_very_near_speak_for_less_trust():
    level = coarsest(TOGETHER)
    fit = looked(TOGETHER, distance="distant")[1].fit
    far, by_it = (
        penalised_noise(
            level, replace(fit, lights=replace(fit.lights, inverse_distance=np.full((12, 1), each)))
        )
        for each in (0.0, 1 / np.linalg.norm(level.points[level.mask], axis=-1).max())
    )
    assert by_it == pytest.approx(2 * far)


def test_strong_highlights_do_not_bend_the_surface():
    glossy = {"specular": 0.6, "lamp_distance_m": 0.6, "photographs": 16}
    capture, truth = scene(TOGETHER, "sphere", 0.4, **glossy)
    result = refine(capture, "multi-light")
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 3


def test_trust_that_was_asked_for_is_kept():
    share, _ = looked(TOGETHER, depth_weight=1.0)
    assert share == 1 > looked(TOGETHER)[0]


@pytest.mark.parametrize("near", [False, True])
def test_one_ambient_leaves_each_lamp_the_same_part(near):
    level = coarsest(TOGETHER, 0.25)
    vector = lights_of_prior(level).vector
    size = np.linalg.norm(vector, axis=-1)
    lights = LightParameters(vector, 0.2 * size, np.full_like(size, 0.5))
    fit = first_fit(level, level.prior, lights, near, shared_ambient=True)
    free = parameter_map(fit)
    step = 1e-6 * np.random.default_rng(0).normal(size=free.shape[1])
    after = lights_after(fit, step)
    part = after.ambient / np.linalg.norm(after.vector, axis=-1)
    assert np.ptp(part) < 1e-12
    alone = replace(fit, shared_ambient=False)
    linear = lights_after(alone, free @ step)
    np.testing.assert_allclose(linear.vector, after.vector, atol=1e-12)
    np.testing.assert_allclose(linear.ambient, after.ambient, atol=1e-10)
