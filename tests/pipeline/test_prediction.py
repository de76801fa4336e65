"""Each photograph predicted from the others' albedo."""

import numpy as np
import pytest

from rakelight.geometry.normals import surface_normals
from rakelight.pipeline import refine
from rakelight.pipeline.prediction import prediction_errors
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene


def scene(**changes):
    sphere = make_shape("sphere")  # no relief finer than a pixel
    settings = {
        "camera": sphere.camera.scaled(0.2),
        "photographs": 6,
        "image_noise": 0.0,
        **changes,
    }
    return render_scene(sphere, make_albedo("pattern"), SceneOptions(**settings))


def errors_of(capture, truth, depth, normals):
    prepared = prepare(capture)
    window = prepared.rows, prepared.columns
    inside = np.nan_to_num(depth[window], nan=1.0), np.nan_to_num(normals[window])
    return np.array(prediction_errors(prepared, *inside, truth.lights))


@pytest.mark.parametrize("distance_m", [None, 0.6])
def test_the_truth_predicts_every_photograph(distance_m):
    capture, truth = scene(lamp_distance_m=distance_m)
    assert errors_of(capture, truth, truth.depth, truth.normals).max() < 0.01


def test_a_wrong_relief_does_not():
    capture, truth = scene()
    smooth = truth.depth + 0.004 * np.sin(np.arange(truth.depth.shape[1]) / 3)
    normals = surface_normals(smooth, truth.mask, capture.camera)
    assert errors_of(capture, truth, smooth, normals).min() > 0.02


def test_refine_reports_them_and_needs_three_photographs():
    capture, _ = scene(depth_noise=DepthNoise(rms_mm=2.0))
    errors = refine(capture).prediction_errors
    assert len(errors) == 6
    assert 0 < max(errors) < 0.1
    two = refine(capture.select([0]))
    assert two.prediction_errors == ()
