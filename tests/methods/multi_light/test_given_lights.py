"""Given lights: a start, or directions that stay."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight import GivenLights, MultiLight, refine
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light.energy import first_fit, light_system
from rakelight.methods.multi_light.initial_lights import lights_of_given
from rakelight.methods.multi_light.light_model import LightModel
from rakelight.methods.multi_light.model_selection import given_fit
from rakelight.metrics import evaluate_maps
from rakelight.prepare import prepare
from rakelight.synthetic import random_capture


@pytest.fixture(scope="module")
def coin():
    """A coin whose relief the sensor's noise hides (benchmarks/random_captures.py, seed 7)."""
    return random_capture(7, size=0.25)


@pytest.fixture(scope="module")
def sphere():
    """A sphere under 17 distant lights (seed 2)."""
    return random_capture(2, size=0.5)


def true_lights(truth, fixed):
    vector = truth.lights.direction.mean(axis=1)
    vector /= np.linalg.norm(vector, axis=1, keepdims=True)
    return GivenLights(vector, fixed=fixed)


def level_and_given(coin):
    capture, truth = coin
    level = finest_level(prepare(capture), cut=True, unbiased=True)
    return level, true_lights(truth, True)


def test_fixed_lights_stay_and_lower_the_error(sphere):
    capture, truth = sphere
    found = refine(capture, MultiLight(distance="distant"))
    given = true_lights(truth, True)
    fixed = refine(replace(capture, lights=given), MultiLight())
    inside = truth.mask & capture.mask & np.isfinite(fixed.prepared_depth)
    off = [evaluate_maps(each.depth, each.normals, truth, inside) for each in (found, fixed)]
    assert off[1].normals.mae_deg < min(0.8 * off[0].normals.mae_deg, 0.24)
    assert off[1].depth.rmse_mm < 0.04  # found ones, too: the sensor's depth is that good
    assert fixed.lights.direction[:, 0] == pytest.approx(given.directions, abs=1e-9)


def test_a_start_is_corrected(coin):
    capture, truth = coin
    given = true_lights(truth, False)
    options = MultiLight(max_iterations=3, distance="distant")
    result = refine(replace(capture, lights=given), options)
    assert np.abs(result.lights.direction.mean(axis=1) - given.directions).max() > 1e-3


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("channels", [1, 3])
def test_a_step_of_fixed_lights_changes_intensity_and_ambient_alone(coin, shared, channels):
    level, given = level_and_given(coin)
    fit = given_fit(level, given)
    model = replace(fit.model, shared_ambient=shared)
    lights = replace(
        fit.lights,
        vector=np.repeat(fit.lights.vector, channels, axis=1),
        ambient=0.1 + np.repeat(fit.lights.ambient, channels, axis=1),
        inverse_distance=np.repeat(fit.lights.inverse_distance, channels, axis=1),
    )
    count, jacobian = len(given) * channels, model.jacobian(lights)
    assert jacobian.shape == (4 * count, count + (1 if shared else count))
    step = np.random.default_rng(0).normal(0, 0.01, jacobian.shape[1])
    after = model.moved(lights, step)
    assert after.vector == pytest.approx(after.irradiance[..., None] * model.directions)
    assert np.abs(after.irradiance - lights.irradiance).max() > 1e-3
    assert np.array_equal(after.inverse_distance, lights.inverse_distance)


def test_the_slope_is_that_of_the_energy(coin):
    level, given = level_and_given(coin)
    start = given_fit(level, given)
    model = LightModel(directions=start.model.directions)
    fit = first_fit(level, level.prior, start.lights, model)
    hessian, slope, _ = light_system(level, fit, 1 << 30)
    assert hessian.shape == (len(slope), len(slope))
    kind = {"scale": fit.scales, "start": fit.linearization.albedo}
    for k in range(0, len(slope), 7):
        energies = []
        for size in (1e-4, -1e-4):
            lights = model.moved(fit.lights, size * np.eye(len(slope))[k])
            energies.append(level.photographs.linearize(fit.surface, lights, **kind).energy)
        numeric = (energies[0] - energies[1]) / (4e-4)
        assert slope[k] == pytest.approx(numeric, rel=0.02, abs=1e-3 * np.abs(slope).max())


def test_given_intensities_are_taken_and_those_of_positions_fall_off(coin):
    level, given = level_and_given(coin)
    count = len(given)
    colour = np.random.default_rng(0).uniform(1, 2, (count, 3))
    directions = np.tile([0.0, 0.0, -1.0], (count, 1))
    lights = lights_of_given(level, GivenLights(directions, intensities=colour))
    assert lights.irradiance == pytest.approx(colour / np.median(colour, axis=0))
    exposures = np.linspace(0.5, 2, count)  # which vectors of lights have in them
    exposed = replace(level, photographs=replace(level.photographs, exposures=exposures))
    assert lights_of_given(
        exposed, GivenLights(directions, intensities=colour)
    ).irradiance == pytest.approx(lights.irradiance * exposures[:, None])
    white = GivenLights(directions, intensities=np.repeat(colour[:, :1], 3, axis=1))
    assert lights_of_given(level, white).irradiance.shape == (count, 1)
    distance_m = np.linspace(0.1, 0.2, count)
    near = GivenLights(
        positions_m=level.middle_m + distance_m[:, None] * directions, intensities=np.ones(count)
    )
    lights = lights_of_given(level, near)
    assert lights.inverse_distance[:, 0] == pytest.approx(1 / distance_m)
    assert lights.irradiance[:, 0] * distance_m**2 == pytest.approx(
        np.median(1 / distance_m**2) ** -1
    )
