"""The bas-relief transform that a surface and its lights need."""

from functools import cache

import numpy as np
import pytest

from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light.bas_relief import (
    intensity_energy_after,
    nearest_bas_relief,
    relief_scaling,
)
from rakelight.photometry.images import LightParameters
from rakelight.prepare import prepare
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

TURN = np.linalg.inv(0.9 * np.eye(3) + np.outer([0.0, 0.0, 1.0], [0.1, -0.05, 0.15]))


@cache
def make_level():
    shape = make_shape("head")
    options = SceneOptions(camera=shape.camera.scaled(0.15), photographs=6)
    return finest_level(prepare(render_scene(shape, make_albedo("simple"), options)[0]))


def alike(count=8):
    """Distant lights of one brightness, at different slants."""
    around, slant = 2.4 * np.arange(count), np.radians(np.linspace(10, 45, count))
    level = np.sin(slant)
    vector = np.stack([level * np.cos(around), level * np.sin(around), -np.cos(slant)], axis=-1)
    return LightParameters.distant(vector[:, None], np.zeros((count, 1)))


def spread(lights, turn):
    return np.log(np.linalg.norm(lights.vector @ turn.T, axis=-1)).std()


def test_lights_that_can_be_alike_set_what_a_vague_sensor_leaves_open():
    level, lights = make_level().weighted(1e-8), alike()
    turned = LightParameters.distant(lights.vector @ TURN.T, lights.ambient)
    assert spread(turned, np.eye(3)) > 0.02
    _, found = nearest_bas_relief(level, level.prior, turned, equal_intensity_weight=1.0)
    assert spread(turned, found) < 2e-3
    # Back where they were, but for the brightness of all, which nothing tells.
    back = turned.vector[:, 0] @ found.T
    cosine = (back * lights.vector[:, 0]).sum(axis=1) / np.linalg.norm(back, axis=1)
    assert np.degrees(np.arccos(cosine)).max() < 1


def test_a_precise_sensor_decides():
    level, turned = (
        make_level().weighted(1e8),
        LightParameters.distant(alike().vector @ TURN.T, alike().ambient),
    )
    log_depth, found = nearest_bas_relief(level, level.prior, turned, equal_intensity_weight=1.0)
    np.testing.assert_allclose(found, np.eye(3), atol=1e-4)
    np.testing.assert_allclose(log_depth, level.prior, atol=1e-5)


def test_lights_of_any_brightness_hardly_move_the_surface():
    level, rng = make_level(), np.random.default_rng(0)
    gain = np.exp(0.4 * rng.normal(size=8))[:, None, None]
    differing = LightParameters.distant(alike().vector * gain, alike().ambient)
    moved, _ = nearest_bas_relief(level, level.prior, differing, equal_intensity_weight=100.0)
    turned = LightParameters.distant(alike().vector @ TURN.T, alike().ambient)
    pulled, _ = nearest_bas_relief(level, level.prior, turned, equal_intensity_weight=100.0)
    size = [np.std((each - level.prior)[level.mask]) for each in (moved, pulled)]
    assert size[0] < 0.3 * size[1]


def test_derivatives_of_the_intensities_energy_are_its_differences():
    level, lights = make_level(), alike()
    transform, step = np.array([0.8, 0.1, -0.05, 0.2]), 1e-6
    _, slope = intensity_energy_after(level, lights, transform)
    for index, along in enumerate(step * np.eye(4)):
        ahead, behind = (
            intensity_energy_after(level, lights, transform + each)[0] for each in (along, -along)
        )
        assert slope[index] == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


@pytest.mark.parametrize("equal_intensity_weight", [0.0, 1.0])
def test_photographs_are_as_they_were_but_for_the_albedo(equal_intensity_weight):
    level = make_level().weighted(1e-8 if equal_intensity_weight else 1.0)
    turned = LightParameters.distant(alike().vector @ TURN.T, alike().ambient)
    log_depth, turn = nearest_bas_relief(level, level.prior + 0.01, turned, equal_intensity_weight)
    shadings = []
    for depth, vector in ((level.prior + 0.01, turned.vector), (log_depth, turned.vector @ turn.T)):
        gradient = level.surface(depth).gradient
        normals, _ = normals_from_gradient(
            gradient[..., 0], gradient[..., 1], level.photographs.camera
        )
        shadings.append(normals[level.photographs.active] @ vector[:, 0].T)
    lit = (np.stack(shadings) > 0.2).all(axis=(0, 2))
    ratio = shadings[1][lit] / shadings[0][lit]
    off = ratio / ratio.mean(axis=1, keepdims=True) - 1
    assert lit.mean() > 0.2
    assert np.abs(off).mean() < 0.01


def test_a_flat_surface_is_no_error():
    level = make_level()
    flat = np.full_like(level.prior, level.prior[level.mask].mean())
    log_depth, turn = nearest_bas_relief(level, flat, alike(), equal_intensity_weight=1.0)
    # A plane becomes a plane, inverse depth being linear in the pixel, and no farther from the
    # sensor's shape.
    row, column = np.nonzero(level.mask)
    plane = np.stack([np.ones(row.size), row, column], axis=1)
    inverse = np.exp(-log_depth[level.mask])
    fitted = plane @ np.linalg.lstsq(plane, inverse, rcond=None)[0]
    np.testing.assert_allclose(inverse, fitted, rtol=1e-9)
    assert (log_depth - level.prior)[level.mask].std() < (flat - level.prior)[level.mask].std()
    assert np.linalg.det(turn) > 0


def test_deepening_is_the_slope_of_a_relief_that_grows_above_its_plane():
    level = make_level()
    inverse = np.exp(-level.prior)
    rays = back_project(np.ones(level.mask.shape), level.photographs.camera)
    seen = level.mask
    plane = rays @ np.linalg.lstsq(rays[seen], inverse[seen], rcond=None)[0]
    step = 1e-6
    deeper, flatter = (-np.log(plane + by * (inverse - plane)) for by in (1 + step, 1 - step))
    found = relief_scaling(level, level.prior)
    np.testing.assert_allclose(found[seen], ((deeper - flatter) / (2 * step))[seen], atol=1e-8)
    assert np.ptp(found[seen]) > 0.05
    assert not found[~seen].any()


def hollow_of(level):
    """The level's depth with dents for bumps."""
    inverse = np.exp(-level.unbiased_prior)
    middle = inverse[level.mask].mean()
    return np.where(level.mask, -np.log(2 * middle - inverse), level.unbiased_prior)


def test_a_hollow_that_the_sensor_sees_as_a_bump_becomes_one():
    level = make_level()
    found, turn = nearest_bas_relief(level, hollow_of(level), alike())
    np.testing.assert_allclose(found[level.mask], level.unbiased_prior[level.mask], atol=1e-9)
    # Lights from the other side, as far from the optical axis.
    np.testing.assert_allclose(turn @ [0.3, 0.2, -1.0], [-0.3, -0.2, -1.0], atol=0.05)


def test_a_hollow_stays_where_the_sensor_may_err_about_it():
    level = make_level().weighted(1e-8)
    hollow = hollow_of(level)
    found, turn = nearest_bas_relief(level, hollow, alike())
    assert found is hollow
    assert (turn == np.eye(3)).all()
