"""How alike the lights' brightness is."""

from functools import partial

import numpy as np
import pytest

from rakelight.methods.multi_light.equal_intensity import (
    equal_intensity_derivatives,
    equal_intensity_energy,
)
from rakelight.photometry.images import LightParameters


def lights(count=9, channels=1, spread=0.1, seed=0):
    rng = np.random.default_rng(seed)
    vector = rng.normal(size=(count, channels, 3))
    vector /= np.linalg.norm(vector.mean(axis=1), axis=-1)[:, None, None]
    vector *= np.exp(spread * rng.normal(size=count))[:, None, None]
    return LightParameters.distant(vector, rng.uniform(0.1, 0.2, (count, channels)))


EXPOSURES = np.geomspace(0.5, 4.0, 9)


@pytest.mark.parametrize("exposures", [None, EXPOSURES])
@pytest.mark.parametrize(("channels", "parameters"), [(1, 4), (3, 4), (1, 5)])
def test_the_slope_is_half_the_derivative(channels, parameters, exposures):
    here = lights(channels=channels)
    energy = partial(equal_intensity_energy, exposures=exposures)
    slope, _ = equal_intensity_derivatives(here, parameters, exposures)
    slope, step = slope.reshape(*here.ambient.shape, parameters), 1e-6
    assert not slope[..., 3:].any()
    for index in np.ndindex(here.vector.shape):
        ahead, back = here.vector.copy(), here.vector.copy()
        ahead[index] += step
        back[index] -= step
        difference = (energy(ahead) - energy(back)) / (4 * step)
        assert slope[index] == pytest.approx(difference, rel=1e-6, abs=1e-7)


def test_an_exposure_is_no_intensity():
    here = lights()
    shown = EXPOSURES[:, None, None] * here.vector
    assert equal_intensity_energy(shown) > equal_intensity_energy(here.vector) + 10
    expected = pytest.approx(equal_intensity_energy(here.vector))
    assert equal_intensity_energy(shown, EXPOSURES) == expected


def test_the_curvature_knows_of_no_common_brightness():
    here = lights(channels=3)
    _, curvature = equal_intensity_derivatives(here, 4)
    brighter = np.concatenate([here.vector, 0 * here.ambient[..., None]], axis=-1).ravel()
    assert np.linalg.eigvalsh(curvature).min() > -1e-9
    np.testing.assert_allclose(curvature @ brighter, 0, atol=1e-9)
    assert np.abs(curvature).max() > 1


def test_lights_nearly_alike_pull_harder_than_others():
    def pull(spread):
        return np.linalg.norm(equal_intensity_derivatives(lights(spread=spread), 4)[0])

    assert pull(0.01) > 5 * pull(0.1) > 10 * pull(1.0)


def test_four_lights_can_always_be_made_alike_and_tell_nothing():
    few = lights(4)
    assert equal_intensity_energy(few.vector) == 0
    assert not np.concatenate([each.ravel() for each in equal_intensity_derivatives(few, 4)]).any()


def test_a_lamp_that_does_not_reach_the_object_does_not_count():
    here = lights(9)
    black = np.concatenate([here.vector, 1e-4 * here.vector[:1]])
    assert equal_intensity_energy(black) == pytest.approx(equal_intensity_energy(here.vector))
    slope, _ = equal_intensity_derivatives(LightParameters.distant(black, np.zeros((10, 1))), 4)
    expected, _ = equal_intensity_derivatives(here, 4)
    np.testing.assert_allclose(slope, np.append(expected, np.zeros(4)))


def test_no_light_at_all_is_no_error():
    nothing = LightParameters.distant(np.zeros((6, 1, 3)), np.zeros((6, 1)))
    slope, curvature = equal_intensity_derivatives(nothing, 4)
    assert equal_intensity_energy(nothing.vector) == 0
    assert not slope.any()
    assert not curvature.any()
