"""Normals finer than differences of the depth map, seen through the method that uses them."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.geometry.normals import surface_normals
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light import MultiLight
from rakelight.methods.multi_light.energy import first_fit, update_scale
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.joint_step import joint_step
from rakelight.methods.multi_light.normals import gradient_step
from rakelight.methods.multi_light.steps import depth_step
from rakelight.metrics import evaluate_maps
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene


def scene(name, scale, **changes):
    shape = make_shape(name)
    options = SceneOptions(
        camera=shape.camera.scaled(scale), photographs=10, depth_noise=DepthNoise(rms_mm=2.0)
    )
    return render_scene(shape, make_albedo("pattern"), replace(options, **changes))


def errors_deg(capture, truth):
    """Of the result's normals, and of those of its depth map."""
    result = refine(capture, MultiLight(distance="distant"))
    depth = np.where(result.mask, result.depth, 1.0).astype(np.float64)
    plain = surface_normals(depth, result.mask, capture.camera)
    return tuple(
        evaluate_maps(result.depth, normals, truth).normals.mae_deg
        for normals in (result.normals, plain)
    )


def test_where_creases_are_finer_than_pixels_the_normals_gain():
    fine, plain = errors_deg(*scene("vase", 0.5))
    assert fine < 0.85 * plain


@pytest.mark.parametrize("image_noise", [0.005, 0.03])
def test_where_the_surface_is_smooth_they_lose_nothing_to_noise(image_noise):
    fine, plain = errors_deg(*scene("cloth", 0.3, image_noise=image_noise))
    assert fine < 1.02 * plain


def test_where_photographs_do_not_align_a_normal_stays():
    capture, _ = scene("vase", 0.3)
    level = finest_level(prepare(capture))
    fit = first_fit(level, level.prior, lights_of_prior(level))
    for _ in range(8):
        fit = update_scale(level, joint_step(level, depth_step(level, fit), most_cells=4000))
    active, left = level.photographs.active, fit.linearization.mean_abs_residual
    before = replace(fit, linearization=replace(fit.linearization, mean_abs_residual=10 * left))
    edge = np.zeros_like(active)
    edge[:, 30:34] = True

    def step(times):
        after = replace(fit.linearization, mean_abs_residual=times * left)
        return gradient_step(level, before, lambda _: after)

    well, badly = step(0.1), step(np.where(edge, 9.0, 0.1))
    size = [np.linalg.norm(each[edge & active], axis=-1).mean() for each in (well, badly)]
    assert size[1] < 0.3 * size[0]
    worse = step(np.where(edge, 11.0, 0.1))
    assert not worse[edge].any()
    assert worse[active & ~edge].any()


def test_they_are_unit_vectors_of_the_object_alone():
    capture, truth = scene("head", 0.2)
    normals = refine(capture, MultiLight(distance="distant")).normals
    np.testing.assert_allclose(np.linalg.norm(normals[truth.mask], axis=-1), 1, atol=1e-6)
    assert np.isnan(normals[~truth.mask]).all()
