"""LDR-PS on Lambertian truth: what it recovers, up to what, and what it does not look at."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.errors import InputError, MethodError
from rakelight.geometry.normals import normals_from_depth, surface_normals
from rakelight.methods.ldr_ps import (
    Factors,
    LdrPs,
    bas_relief,
    factorise,
    grey_photographs,
    integrable_basis,
    integrated,
    ldr_ps,
    upright,
)
from rakelight.metrics import normal_errors
from rakelight.model import Camera, silent
from rakelight.paper.bas_relief import bas_relief_aligned
from rakelight.prepare import prepare
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene
from tests.solve.stalling import stalling_solver

CAMERA = Camera(60, 48, fx=600.0, fy=560.0, cx=29.5, cy=23.5)
MASK = np.ones(CAMERA.shape, dtype=bool)
BAS_RELIEF = np.array([[1, 0, 0], [0, 1, 0], [0.3, -0.2, 1.7]])


@pytest.fixture(scope="module")
def scene():
    """A grey bust under twelve distant lights without ambient light, 320 x 240."""
    bust = make_shape("head")
    options = SceneOptions(camera=bust.camera.scaled(2 / 3), ambient=0.0, supersampling=1)
    capture, truth = render_scene(bust, make_albedo("grey"), options)
    return prepare(capture), truth


@pytest.fixture(scope="module")
def prepared(scene):
    return scene[0]


@pytest.fixture(scope="module")
def estimate(prepared):
    return ldr_ps(prepared, LdrPs(), silent)


def relief():
    """Log depth of a smooth surface and its normals."""
    row, column = np.mgrid[: CAMERA.height, : CAMERA.width] / 10.0
    log_depth = 0.012 * np.sin(1.3 * column + 0.4 * row) - 0.01 * np.cos(1.1 * row - 0.3 * column)
    log_depth += 0.002 * (row - 2.4) * (column - 3) + 0.001 * (column - 3) ** 2
    return log_depth, normals_from_depth(np.exp(log_depth), MASK, CAMERA)


def errors(normals, truth, prepared):
    """Normal errors over the prepared window."""
    window = truth.normals[prepared.rows, prepared.columns]
    return normal_errors(normals, window, prepared.mask)


# ---- the whole


def test_a_lambertian_bust_within_a_few_degrees(estimate, scene):
    """5.8 degrees as it comes, median 3.3, 5.5 after the best bas-relief: the rest is jumps."""
    prepared, truth = scene
    normals = surface_normals(np.exp(estimate.log_depth), prepared.mask, prepared.camera)
    raw = errors(normals, truth, prepared)
    assert raw.mae_deg < 6.5
    assert raw.median_deg < 4
    window = truth.normals[prepared.rows, prepared.columns]
    aligned = bas_relief_aligned(normals, window, prepared.mask)
    assert errors(aligned, truth, prepared).mae_deg < 5.7


def test_lights_within_a_few_degrees(estimate, scene):
    cosine = np.sum(estimate.lights.direction * scene[1].lights.direction, axis=-1)
    assert np.degrees(np.arccos(cosine)).max() < 4


def test_albedo_and_lights_explain_the_photographs(estimate, scene):
    prepared, truth = scene
    albedo = estimate.albedo[prepared.mask]
    assert np.percentile(albedo, 99) == pytest.approx(1, abs=1e-9)
    assert np.std(albedo, axis=0).max() < 0.05  # the bust is grey
    lights = truth.lights.intensity[:, 0] * 0.5
    np.testing.assert_allclose(estimate.lights.intensity[:, 0], lights, rtol=0.06)
    assert (estimate.lights.ambient == 0).all()


def test_only_the_distance_is_the_depth_sensors(estimate, prepared):
    bent = prepared.depth_m * (1 + 0.3 * np.linspace(-1, 1, prepared.mask.shape[1]) ** 2)
    again = ldr_ps(replace(prepared, depth_m=bent), LdrPs(), silent)
    moved = (again.log_depth - estimate.log_depth)[prepared.mask]
    assert np.ptp(moved) < 1e-12
    assert np.median(np.log(bent) - again.log_depth, axis=None) == pytest.approx(0, abs=0.1)


def test_it_says_that_the_depth_is_not_used(estimate):
    (finding,) = estimate.findings
    assert (finding.severity, finding.code) == ("warning", "depth-not-used")
    assert estimate.converged
    assert 0.5 < estimate.confidence.max() <= 1


def test_the_last_round_that_is_allowed_may_be_the_one_that_settles(estimate, prepared):
    rounds = len(estimate.energy)
    again = ldr_ps(prepared, LdrPs(max_iterations=rounds), silent)
    assert (again.energy, again.converged) == (estimate.energy, True)
    assert not ldr_ps(prepared, LdrPs(max_iterations=rounds - 1), silent).converged


def test_a_surface_that_faces_nowhere_is_refused(prepared, monkeypatch):
    monkeypatch.setattr("rakelight.methods.ldr_ps.GRAZING", 2.0)
    with pytest.raises(MethodError, match="lit often enough"):
        ldr_ps(prepared, LdrPs(), silent)


def test_few_photographs_and_dark_ones_are_refused(prepared):
    with pytest.raises(MethodError, match="too few photographs"):
        ldr_ps(replace(prepared, photographs=prepared.photographs[:3]), LdrPs(), silent)
    dark = prepared.photographs.copy()
    dark[2:] = 0
    with pytest.raises(MethodError, match="lit often enough"):
        ldr_ps(replace(prepared, photographs=dark), LdrPs(), silent)


@pytest.mark.parametrize(
    "wrong", [{"max_iterations": 0}, {"tolerance": -1.0}, {"shadow": 1.0}, {"min_photographs": 3}]
)
def test_impossible_options_are_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        LdrPs(**wrong)


# ---- its steps


def test_shadows_and_clipped_values_are_missing(prepared):
    values = np.full(prepared.photographs.shape, 30_000, np.uint16)
    values[0] = 5_900
    values[1, ..., 2] = 65_535
    _, lit = grey_photographs(replace(prepared, photographs=values), shadow=0.2)
    assert lit[2:].all()
    assert not lit[:2].any()


def test_factors_explain_the_values_that_are_missing():
    rng = np.random.default_rng(1)
    lights, normals = rng.normal(size=(9, 3)), rng.normal(size=(400, 3))
    values = lights @ normals.T
    lit = rng.random(values.shape) > 0.3
    lit[:, 0] = [True] * 2 + [False] * 7
    options = LdrPs(max_iterations=500, tolerance=1e-12)
    found = factorise(np.where(lit, values, 0.0), lit, options)
    whole = lit.sum(axis=0) > 3
    np.testing.assert_allclose(
        (found.lights @ found.normals.T)[:, whole], values[:, whole], atol=1e-4
    )
    assert (found.normals[0] == 0).all()
    assert (np.diff(found.energy) <= 0).all()


def test_integrability_leaves_nothing_but_bas_relief():
    _, normals = relief()
    mixed = normals[MASK] @ np.random.default_rng(2).normal(size=(3, 3))
    A = integrable_basis(mixed, MASK, MASK, CAMERA)
    found = (mixed @ A.T).reshape(normals.shape)
    aligned = bas_relief_aligned(found, normals, MASK)
    aligned *= np.sign(np.sum(aligned * normals, axis=-1, keepdims=True))
    assert normal_errors(aligned, normals, MASK).mae_deg < 0.5


def test_maxima_give_the_bas_relief_though_most_are_paint():
    rng = np.random.default_rng(3)
    lights = rng.normal(size=(30, 3)) * [0.4, 0.4, 0.1] - [0, 0, 1]
    normals = lights / np.linalg.norm(lights, axis=1, keepdims=True)
    normals[12:] = rng.normal(size=(18, 3)) * [0.5, 0.5, 0.1] - [0, 0, 1]
    mixed = normals @ np.linalg.inv(BAS_RELIEF)
    G, agreeing = bas_relief(mixed, lights @ BAS_RELIEF.T, np.arange(30))
    assert agreeing[:12].all()
    assert agreeing[12:].sum() <= 3
    np.testing.assert_allclose(G, BAS_RELIEF, atol=0.1)


def test_a_bas_relief_that_draws_everything_together_is_not_agreement():
    rng = np.random.default_rng(4)
    lights = rng.normal(size=(12, 3)) * [0.4, 0.4, 0.1] - [0, 0, 1]
    lamp = rng.integers(12, size=300)
    normals = lights[lamp] / np.linalg.norm(lights[lamp], axis=1, keepdims=True)
    normals[20:] = rng.normal(size=(280, 3)) * [0.5, 0.5, 0.1] - [0, 0, 1]
    mixed = normals @ np.linalg.inv(BAS_RELIEF)
    G, agreeing = bas_relief(mixed, lights @ BAS_RELIEF.T, lamp)
    assert agreeing[:20].all()
    np.testing.assert_allclose(G, BAS_RELIEF, atol=0.1)


def test_without_maxima_nothing_is_changed():
    G, agreeing = bas_relief(np.ones((1, 3)), np.ones((1, 3)), np.zeros(1, int))
    assert (np.eye(3) == G).all()
    assert agreeing.tolist() == [False]


@pytest.mark.parametrize("signs", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_a_ball_is_not_taken_for_a_bowl(signs):
    x, y = np.meshgrid(np.linspace(-0.8, 0.8, CAMERA.width), np.linspace(-0.5, 0.5, CAMERA.height))
    ball = np.stack([x, y, -np.sqrt(1 - x**2 - y**2)], axis=-1)[MASK]
    lean, facing = signs
    given = Factors(np.eye(3), ball).changed(facing * np.diag([lean, lean, 1.0]))
    np.testing.assert_allclose(upright(given, MASK, CAMERA).normals, ball, atol=1e-12)


def test_normals_are_integrated_in_perspective():
    log_depth, normals = relief()
    found = integrated(normals, MASK, MASK, CAMERA)
    assert np.ptp(found - log_depth) < 0.01 * np.ptp(log_depth)


def test_normals_that_fit_ill_are_outvoted():
    log_depth, normals = relief()
    spoiled = normals.copy()
    spoiled[18:30, 28:33] += [0.8, 0.0, 0.0]
    spoiled /= np.linalg.norm(spoiled, axis=-1, keepdims=True)
    off = integrated(spoiled, MASK, MASK, CAMERA) - log_depth
    beside = np.s_[15:33, 25:36]
    elsewhere = MASK.copy()
    elsewhere[beside] = False
    assert np.ptp(off[elsewhere]) < 0.01 * np.ptp(log_depth)  # 0.065 by plain least squares


def test_a_solver_that_stalls_is_an_error(prepared):
    with stalling_solver(after=2), pytest.raises(InputError, match=r"the surface: .*stalled"):
        ldr_ps(prepared, LdrPs(), silent)
