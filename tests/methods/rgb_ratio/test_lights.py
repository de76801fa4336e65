"""The three lamps of rgb-ratio: what they send to each point, and how far away they are."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rakelight.geometry.normals import surface_normals
from rakelight.methods.levels import first_photograph
from rakelight.methods.rgb_ratio import RgbRatio, rgb_ratio
from rakelight.methods.rgb_ratio.lights import (
    arriving_lights,
    as_lights,
    distance_step,
    effective_normals,
    lights_step,
    shading_by,
)
from rakelight.metrics import evaluate_maps
from rakelight.model import silent
from rakelight.photometry.forward import shadings
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

LIGHT = np.array([[0.5, 0.0, -0.8, 0.1], [-0.2, 0.4, -0.7, 0.0], [-0.2, -0.4, -0.6, 0.05]])


@cache
def scene(shape, size, noise_mm, **settings):
    solid = make_shape(shape)
    options = SceneOptions(
        lighting="rgb-leds",
        camera=solid.camera.scaled(size),
        depth_noise=DepthNoise(rms_mm=noise_mm, correlation_length_px=4.0 if noise_mm else 0.0),
        **settings,
    )
    return render_scene(solid, make_albedo("white"), options)


@cache
def level():
    return first_photograph(prepare(scene("vase", 0.2, 0.0)[0]))


@pytest.mark.parametrize("inverse_distance", [0.0, 4.0])
def test_what_arrives_is_what_a_result_states(inverse_distance):
    base = level()
    normals, _ = base.normals(base.prior)
    inside = base.mask
    lights = as_lights(base, LIGHT, inverse_distance)
    expected = shadings(normals[inside], (base.points + base.middle_m)[inside], lights)[0]
    found = shading_by(arriving_lights(base, LIGHT, inverse_distance), normals)[inside]
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert (lights.position_m is None) == (inverse_distance == 0)
    for c, light in enumerate(LIGHT):
        own = effective_normals(normals[inside], base.points[inside], light, inverse_distance)
        shading = np.maximum(own @ light[:3], 0) + light[3]
        np.testing.assert_allclose(shading, expected[:, c], rtol=1e-9)


def test_lights_and_their_distance_are_found_together():
    """Of values without errors, lamps at 0.4 m, begun as distant ones."""
    base = replace(level())  # with a picture of its own
    normals, _ = base.normals(base.prior)
    albedo = np.ones((*base.mask.shape, 3))
    values = shading_by(arriving_lights(base, LIGHT, 2.5), normals)
    base.__dict__["image"] = np.where(base.mask[..., None], 0.5 * values, 0.0)
    light, inverse_distance = np.tile([0.0, 0.0, -1.0, 0.0], (3, 1)), 0.0
    for _ in range(60):
        light = lights_step(base, normals, albedo, light, inverse_distance)
        inverse_distance = distance_step(base, normals, albedo, light, inverse_distance)
    assert inverse_distance == pytest.approx(2.5, rel=0.02)
    np.testing.assert_allclose(light, 0.5 * LIGHT, atol=0.02)


def errors(depth_m, prepared, truth):
    normals = surface_normals(depth_m, prepared.mask, prepared.camera)
    found = evaluate_maps(prepared.embed(depth_m, np.nan), prepared.embed(normals, np.nan), truth)
    return np.array([found.depth.rmse_mm, found.normals.mae_deg])


def test_near_lamps_do_not_bend_the_surface():
    """Taken for distant ones they did: 2.0 mm and 12.8 degrees, of 1.1 and 11.4."""
    capture, truth = scene("cloth", 0.3, 1.0, lamp_distance_m=0.4)
    prepared = prepare(capture)
    estimate = rgb_ratio(prepared, RgbRatio(), silent)
    before = errors(prepared.depth_m, prepared, truth)
    after = errors(np.exp(estimate.log_depth), prepared, truth)
    assert (after < [1.2, 0.7] * before).all(), (before, after)
    assert np.median(estimate.lights.distance_m) == pytest.approx(0.4, rel=0.3)


def test_distant_lamps_stay_distant():
    capture, _ = scene("cloth", 0.3, 1.0)
    assert rgb_ratio(prepare(capture), RgbRatio(), silent).lights.position_m is None
