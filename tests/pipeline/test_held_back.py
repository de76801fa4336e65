from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import normals_from_gradient, surface_normals
from rakelight.model import Camera
from rakelight.photometry.forward import shadings
from rakelight.pipeline import held_back
from rakelight.pipeline.held_back import (
    FEWEST,
    NO_BETTER,
    Sample,
    _gradient,
    _left_out,
    kept,
    predict,
    prepared_lights,
)
from rakelight.prepare import prepare
from rakelight.solve.robust import NOTABLE
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene
from tests.check.wrong_captures import sound


def sample(images, good=None):
    good = np.ones(images.shape, bool) if good is None else good
    return Sample(images, good, np.arange(images.shape[1]))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000), photographs=st.integers(4, 9))
def test_errors_are_those_of_really_leaving_a_photograph_out(seed, photographs):
    """Of a model that is linear in the slopes and has an albedo of 1 nothing is approximate."""
    rng = np.random.default_rng(seed)
    pixels = 5
    shading = rng.uniform(0.3, 1.0, (photographs, pixels, 3))
    albedo = rng.uniform(0.2, 1.0, (pixels, 3))
    images = albedo * shading + 0.01 * rng.normal(size=shading.shape)
    found = _left_out(sample(images), shading)
    for i in range(photographs):
        others = np.arange(photographs) != i
        left = (shading[others] * images[others]).sum(axis=0) / (shading[others] ** 2).sum(axis=0)
        np.testing.assert_allclose(found[i], np.abs(images[i] - left * shading[i]), atol=1e-6)


def ridge_prediction(images, shading, slopes, change, precision, left_out):
    """Residual of a photograph from a fit of albedo and slopes to the others: linearized, plainly.

    One pixel: images, shading (N, 3), slopes (N, 3, 2), change (2,), precision a number.
    """
    count = len(images)
    albedo = (shading * images).sum(axis=0) / (shading**2).sum(axis=0)
    J = np.zeros((count, 3, 5))
    for c in range(3):
        J[:, c, c] = shading[:, c]
        J[:, c, 3:] = albedo[c] * slopes[:, c]
    error = images - albedo * shading
    use = np.arange(count) != left_out
    A, r = J[use].reshape(-1, 5), error[use].ravel()
    hold = np.diag([0, 0, 0, precision, precision])
    step = np.linalg.solve(A.T @ A + hold, A.T @ r + hold @ [0, 0, 0, *change])
    return error[left_out] - J[left_out] @ step


def test_slopes_are_left_out_with_the_photograph():
    rng = np.random.default_rng(3)
    shading = rng.uniform(0.3, 1.0, (6, 40, 3))
    slopes = rng.normal(size=(6, 40, 3, 2))
    albedo, change = rng.uniform(0.2, 1.0, (40, 3)), 0.1 * rng.normal(size=(40, 2))
    images = albedo * shading + 0.02 * rng.normal(size=shading.shape)
    turn = np.full(40, 4.0)
    found = _left_out(sample(images), shading, slopes, change, turn)
    # The precision that the sample's own residuals give.
    fitted = (shading * images).sum(axis=0) / (shading**2).sum(axis=0)
    noise = 1.4826 * np.median(np.abs(images - fitted * shading)) + 1e-6
    noise *= np.sqrt(18 / 13)
    precision = noise**2 / (np.mean(4.0 * (change**2).sum(axis=1)) / 2) * 4.0
    for pixel in range(40):
        for i in range(6):
            plain = ridge_prediction(
                images[:, pixel], shading[:, pixel], slopes[:, pixel], change[pixel], precision, i
            )
            np.testing.assert_allclose(found[i, pixel], np.abs(plain), rtol=1e-3, atol=1e-5)


@pytest.fixture(scope="module")
def noisy():
    """A prepared capture with correlated depth noise, and its truth."""
    shape = make_shape("head")
    options = SceneOptions(
        camera=shape.camera.scaled(0.3),
        photographs=6,
        depth_noise=DepthNoise(rms_mm=3.3, correlation_length_px=5.0),
    )
    capture, truth = render_scene(shape, make_albedo("pattern"), options)
    return prepare(capture), truth


def in_window(prepared, image):
    return np.nan_to_num(image[prepared.rows, prepared.columns], nan=1.0).astype(float)


def test_the_true_surface_predicts_better_than_the_prepared_one(noisy):
    prepared, truth = noisy
    found = predict(
        prepared, in_window(prepared, truth.depth), in_window(prepared, truth.normals), truth.lights
    )
    assert found.gain < 0.5
    assert (found.refined < found.prepared).all()


def test_the_prepared_surface_predicts_like_itself(noisy):
    prepared, _ = noisy
    depth = np.where(prepared.mask, prepared.depth_m, 1.0)
    normals = surface_normals(depth, prepared.mask, prepared.camera)
    found = predict(prepared, depth, normals, prepared_lights(prepared))
    assert found.gain > 1 - NOTABLE


@pytest.mark.parametrize("count", [1, FEWEST - 1])
def test_too_few_photographs_predict_nothing(noisy, count):
    prepared, truth = noisy
    few = prepared.select(range(count))
    lights = replace(
        truth.lights, vector=truth.lights.vector[:count], ambient=truth.lights.ambient[:count]
    )
    depth, normals = in_window(prepared, truth.depth), in_window(prepared, truth.normals)
    assert predict(few, depth, normals, lights) is None


def test_the_kept_depth_is_the_prepared_one(noisy):
    prepared, truth = noisy
    estimate = kept(prepared, NO_BETTER)
    np.testing.assert_array_equal(np.exp(estimate.log_depth), np.exp(np.log(prepared.depth_m)))
    assert estimate.confidence.max() == 0
    assert [finding.code for finding in estimate.findings] == ["photographs-say-nothing"]
    inside = estimate.albedo[prepared.mask]
    assert np.percentile(inside, 99) == pytest.approx(1.0)
    # As bright as the photographs: albedo and lights belong together.
    true = truth.albedo[prepared.rows, prepared.columns][prepared.mask]
    assert np.corrcoef(inside[:, 0], true[:, 0])[0, 1] > 0.8


def test_the_gradient_of_normals_where_focal_lengths_differ():
    camera = Camera(5, 4, fx=10.0, fy=20.0, cx=1.0, cy=3.0)
    slopes = np.random.default_rng(0).normal(0, 0.05, (2, 4, 5))
    normals, _ = normals_from_gradient(*slopes, camera)
    sample = Sample(np.zeros((1, 20, 3)), np.ones((1, 20, 3), bool), np.arange(20))
    np.testing.assert_allclose(_gradient(normals, camera, sample), slopes.reshape(2, -1).T)


def test_the_change_leads_to_the_prepared_depth_and_shadows_say_nothing_of_it(monkeypatch):
    capture, truth = sound("head")
    prepared, calls, plain = prepare(capture), [], held_back._left_out
    monkeypatch.setattr(held_back, "_left_out", lambda *given: calls.append(given) or plain(*given))
    before = surface_normals(prepared.depth_m, prepared.mask, prepared.camera)
    normals = before + np.array([0.3, 0.0, 0.0])  # a slope along u that is too large
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    held_back.predict(prepared, prepared.depth_m, normals, truth.lights)
    _, shading, slopes, change, _ = calls[0]
    assert (change[:, 0] < 0).mean() > 0.95
    shadow = shading <= truth.lights.ambient[:, None] + 1e-12
    assert shadow.any()
    assert not slopes[shadow[..., 0]].any()


def test_lights_of_a_kept_depth_are_scaled_whole():
    prepared = prepare(sound("head")[0])
    prepared = replace(prepared, photographs=prepared.photographs // 3 + 3000)
    found, lights = kept(prepared, NO_BETTER), prepared_lights(prepared)
    normals = surface_normals(prepared.depth_m, prepared.mask, prepared.camera)[prepared.mask]
    points = back_project(prepared.depth_m, prepared.camera)[prepared.mask]
    assert lights.ambient.max() > 0.01
    shading, before = (shadings(normals, points, each) for each in (found.lights, lights))
    ratio = shading / np.maximum(before, 1e-9)
    np.testing.assert_allclose(ratio, np.median(ratio), rtol=1e-6)
