"""The ratio equations against their formula, pixel by pixel."""

import numpy as np
import pytest

from rakelight.geometry.normals import gradient_directions
from rakelight.methods.rgb_ratio.ratios import Ratios
from rakelight.model import Camera

CAMERA = Camera(7, 5, fx=50.0, fy=60.0, cx=2.0, cy=3.0)
NOISE = 0.02


@pytest.fixture(scope="module")
def given():
    """Ratios of random numbers, and normals with their lengths."""
    rng = np.random.default_rng(0)
    shape = CAMERA.shape
    light = np.concatenate([rng.normal(size=(3, 3)) - [0, 0, 2], np.full((3, 1), 0.1)], axis=1)
    usable = rng.random((*shape, 3)) < 0.8
    light = light + 0.1 * rng.normal(size=(*shape, 3, 4))
    ratios = Ratios(rng.random((*shape, 3)), usable, NOISE, 0.1 + rng.random((*shape, 3)), light)
    normals = rng.normal(size=(*shape, 3)) - [0, 0, 2]
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return ratios, normals, 1 + rng.random(shape)


def equations(ratios, normals):
    """q (h, w, 3) and variance (h, w) of every pair, NaN where a channel says nothing."""
    image, rho, light = ratios.image, ratios.albedo, ratios.light
    shade = np.einsum("hwk,hwck->hwc", normals, light[..., :3])
    says = ratios.usable & (shade > 0.05 * np.linalg.norm(light[..., :3], axis=-1))
    for c, d in ((0, 1), (0, 2), (1, 2)):
        own, other = (image[..., k] - rho[..., k] * light[..., k, 3] for k in (c, d))
        q = (own * rho[..., d])[..., None] * light[..., d, :3]
        q -= (other * rho[..., c])[..., None] * light[..., c, :3]
        variance = (rho[..., d] * shade[..., d]) ** 2 + (rho[..., c] * shade[..., c]) ** 2
        variance = np.maximum(variance, 1e-4) * NOISE**2
        yield q, np.where(says[..., c] & says[..., d], variance, np.nan)


def test_misfit_is_that_of_the_equations(given):
    ratios, normals, _ = given
    expected = [(q * normals).sum(axis=-1) ** 2 / v for q, v in equations(ratios, normals)]
    np.testing.assert_allclose(ratios.squares(normals), np.stack(expected, axis=-1), rtol=1e-9)
    assert 0.2 < np.isnan(ratios.squares(normals)).mean() < 0.8


def test_terms_are_the_weighted_sum_of_squares(given):
    ratios, normals, length = given
    tensor, rhs = ratios.terms(normals, length, CAMERA, robust=False)
    u, v = gradient_directions(CAMERA)
    rng = np.random.default_rng(1)
    for slope in rng.normal(scale=0.01, size=(3, 2)):
        m = slope[0] * u + slope[1] * v - [0, 0, 1]
        direct = sum(
            np.nan_to_num(2 / 3 * ((q * m).sum(axis=-1) ** 2 - q[..., 2] ** 2) / variance)
            for q, variance in equations(ratios, normals)
        )
        quadratic = tensor @ [slope[0] ** 2, 2 * slope[0] * slope[1], slope[1] ** 2]
        np.testing.assert_allclose(quadratic - 2 * rhs @ slope, direct / length**2, rtol=1e-6)


def test_robust_terms_weaken_what_the_surface_does_not_meet(given):
    ratios, normals, length = given
    least_squares, robust_terms = (
        ratios.terms(normals, length, CAMERA, robust)[0] for robust in (False, True)
    )
    says = least_squares[..., 0] > 0
    assert (robust_terms[says, 0] < 0.5 * least_squares[says, 0]).all()
