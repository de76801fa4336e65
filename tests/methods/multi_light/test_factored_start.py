"""The start from the photographs' factors: its cost, its derivative, and what it finds."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rakelight.geometry.averaging import Averaging
from rakelight.methods.ldr_ps import Factors
from rakelight.methods.levels import finest_level, pyramid
from rakelight.methods.multi_light.equal_intensity import LEAST_LOG_SIGMA
from rakelight.methods.multi_light.factored_start import (
    Problem,
    best_surface,
    comparable_cost,
    descended,
    factored_start,
    reweighted,
    without_repeats,
)
from rakelight.prepare import prepare
from rakelight.synthetic import random_capture


@cache
def level(seed=5, **settings):
    """The coarsest level of a random capture, and its lights (N, 3)."""
    settings = {"easy": True, "shape": "ring", "depth_factor": 2, "photographs": 9} | settings
    capture, truth = random_capture(seed, 0.5, **settings)
    finest = finest_level(prepare(capture), cut=True, unbiased=True)
    return pyramid(finest, 2000)[-1], truth.lights.vector.mean(axis=1)


@cache
def problem():
    """Directions at random near the viewing direction, on a level's pixels."""
    base, _ = level()
    active = base.photographs.active
    rng = np.random.default_rng(0)
    normals = np.array([0.0, 0.0, -1.0]) + 0.3 * rng.normal(size=(np.count_nonzero(active), 3))
    return Problem.of(base, Factors(similar_lights(), normals), active)


def similar_lights(log_sigma=0.05):
    """(9, 3) lights at random around the viewing direction, of about the same intensity."""
    rng = np.random.default_rng(2)
    toward = np.array([0.0, 0.0, -1.0]) + 0.5 * rng.normal(size=(9, 3))
    intensity = np.exp(log_sigma * rng.normal(size=(9, 1)))
    return intensity * toward / np.linalg.norm(toward, axis=1, keepdims=True)


@pytest.mark.parametrize("exposures", [None, np.linspace(1, 2, 9)], ids=["alike", "known"])
def test_the_costs_derivative_is_its_slope(exposures):
    given = replace(problem(), exposures=exposures)
    rng = np.random.default_rng(1)
    A = np.eye(3) + 0.1 * rng.normal(size=(3, 3))
    first = replace(given, slope_weight=given.determined / 0.01, sensor_weight=0.1)
    weighted = reweighted(first, A)
    _, derivative = weighted.cost(A.ravel())
    for axis in range(9):
        step = 1e-6 * np.eye(9)[axis]
        ahead, behind = (weighted.cost(A.ravel() + sign * step)[0] for sign in (1, -1))
        slope = (ahead - behind) / 2e-6
        assert derivative[axis] == pytest.approx(slope, rel=1e-4, abs=1e-4 * abs(derivative).max())


def test_a_matrix_and_its_multiples_cost_the_same():
    given = problem()
    A = np.eye(3) + 0.1 * np.random.default_rng(1).normal(size=(3, 3))
    weighted = replace(given, slope_weight=given.determined / 0.01, sensor_weight=0.1)
    one, other = (weighted.cost(scale * A.ravel())[0] for scale in (1.0, 7.0))
    assert other == pytest.approx(one, rel=1e-9)


@pytest.mark.parametrize("exposures", [None, np.linspace(1, 2, 9)], ids=["alike", "known"])
def test_lights_of_equal_intensity_cost_least_but_for_a_rotation(exposures):
    lights = similar_lights(0.0) if exposures is None else exposures[:, None] * similar_lights(0.0)
    given = replace(problem(), lights=lights, exposures=exposures)
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    right, turned, sheared = (
        given.intensity_cost(A)[0] for A in (np.eye(3), turn, np.diag([1.0, 1.0, 1.5]))
    )
    assert turned == pytest.approx(right)
    assert sheared > right + 10


def test_matrices_are_compared_by_the_intensities_too():
    given, A = problem(), np.diag([1.0, 1.0, 1.5])
    log_depth, residual = given.surface(given.slopes(A)[0])
    equal, few = (
        comparable_cost(replace(given, lights=lights), A, log_depth, residual)
        for lights in (similar_lights(0.0) @ A, similar_lights(0.0)[:4])
    )
    # Four lights say nothing; nine, equal under A, are as likely as their variance can be.
    assert equal - few == pytest.approx((9 - 4) * np.log(LEAST_LOG_SIGMA**2))


def test_a_flatter_surface_does_not_fit_better_by_being_flat():
    """Without the change of variables it would, where neither sensor nor lights say anything."""
    given = replace(problem(), lights=similar_lights()[:4])
    A = np.eye(3)
    flat = np.diag([0.3, 0.3, 1.0])
    costs = [best_surface(given, [each])[0] for each in (A, flat)]
    assert costs[1] == pytest.approx(costs[0], rel=0.02)


def test_begins_that_come_to_the_same_minimum_go_on_as_one():
    base, _ = level()
    active = base.photographs.active
    given = Problem.of(base, Factors(similar_lights(), base.normals(base.prior)[0][active]), active)
    A = np.eye(3)
    near = A + 0.05 * np.random.default_rng(1).normal(size=(3, 3))
    fits = [descended(given, each / np.cbrt(np.linalg.det(each))) for each in (A, near)]
    assert np.abs(A - near).max() > 0.01
    assert without_repeats(fits) == fits[:1]
    mirrored = fits[0][0], np.diag([-1.0, -1.0, 1.0]) @ fits[0][1]
    assert without_repeats([*fits, mirrored]) == [fits[0], mirrored]
    alone, together = (best_surface(given, each) for each in ([A], [A, near]))
    assert together[0] == alone[0]


def test_pixels_that_no_photograph_determines_may_be_the_most():
    given = problem()
    determined = given.determined & (np.arange(len(given.determined)) % 3 == 0)
    mostly_dark = replace(
        given, determined=determined, directions=given.directions * determined[:, None]
    )
    slopes, toward = mostly_dark.slopes(np.eye(3))
    assert np.isfinite(slopes).all()
    assert toward.min() > 0
    np.testing.assert_allclose(toward[determined], given.slopes(np.eye(3))[1][determined])


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_lights_are_found_beneath_the_sensors_noise(seed):
    base, true = level(seed, depth_rms_mm=2.0, pixel_mm=0.3, depth_length_px=12.0)
    log_depth, lights = factored_start(base)
    toward = lights.vector[:, 0] / np.linalg.norm(lights.vector[:, 0], axis=-1, keepdims=True)
    cosine = (toward * true / np.linalg.norm(true, axis=-1, keepdims=True)).sum(axis=-1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean() < 5
    assert np.isfinite(log_depth).all()


def test_the_matrix_of_means_is_the_operator():
    mask = np.random.default_rng(0).random((8, 9)) > 0.2
    averaging = Averaging.on(mask, np.arange(0, 9.5, 1.5), np.arange(0, 10, 3.0))
    image = np.random.default_rng(1).normal(size=mask.shape)
    expected = averaging.down(image)[averaging.covered]
    np.testing.assert_allclose(averaging.matrix(mask) @ image[mask], expected, atol=1e-12)
