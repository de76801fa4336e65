"""How high highlights are, from values whose albedo and normals are not known."""

import numpy as np
import pytest

from rakelight.photometry.specular import EXPONENTS, lobe_coefficients, lobes

PIXELS, LAMPS = 400, 12


def make_values(true, noise=0.0, bent=0.0, seed=0):
    """Values (N, P, 3) of random paint under highlights of the `true` heights, and what is known.

    bent : radians by which the known normals are off
    """
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(PIXELS, 3)) * 0.3 - [0.0, 0.0, 1.0]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    known = normals + bent * rng.normal(size=normals.shape)
    known /= np.linalg.norm(known, axis=1, keepdims=True)
    points = rng.uniform(-0.05, 0.05, size=(PIXELS, 3))
    points[:, 2] += 0.6
    around = 2.4 * np.arange(LAMPS)
    slant = np.linspace(0.2, 0.7, LAMPS)
    lights = np.stack(
        [np.sin(slant) * np.cos(around), np.sin(slant) * np.sin(around), -np.cos(slant)], axis=-1
    )
    arriving = np.broadcast_to(0.7 * lights[:, None, None], (LAMPS, PIXELS, 1, 3))
    ambient = np.full((LAMPS, 1), 0.05)
    paint = rng.uniform(0.2, 0.9, size=(PIXELS, 3))
    shading = np.maximum(np.einsum("npck,pk->npc", arriving, normals), 0) + 0.05
    values = paint * shading + np.tensordot(true, lobes(normals, points, arriving), 1)
    values += noise * rng.normal(size=values.shape)
    return values, known, arriving, ambient[:, None], lobes(known, points, arriving)


def test_lobes_are_half_as_high_where_their_exponent_says():
    for k, exponent in enumerate(EXPONENTS):
        half = np.arccos(0.5 ** (1 / exponent))
        lamp = np.array([np.sin(2 * half), 0.0, -np.cos(2 * half)]).reshape(1, 1, 1, 3)
        front = np.array([[0.0, 0.0, -1.0]])
        assert lobes(front, -front, lamp)[k].item() == pytest.approx(0.5)


def test_a_lamp_behind_the_surface_makes_none():
    behind = np.array([0.99, 0.0, 0.141]).reshape(1, 1, 1, 3)
    front = np.array([[0.0, 0.0, -1.0]])
    assert not lobes(front, -front, behind).any()


@pytest.mark.parametrize("true", [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.05, 0.1, 0.3]])
def test_heights_are_found_without_knowing_the_paint(true):
    found, share = lobe_coefficients(*make_values(true))
    assert found == pytest.approx(true, abs=0.01)
    assert share > 0.9


def test_heights_are_found_where_normals_are_off():
    found, share = lobe_coefficients(*make_values([0.0, 0.2, 0.0], noise=0.01, bent=0.03))
    assert found.sum() == pytest.approx(0.2, rel=0.15)
    assert share > 0.3


def test_matte_paint_has_none():
    found, share = lobe_coefficients(*make_values([0.0, 0.0, 0.0], noise=0.01, bent=0.03))
    assert found.sum() < 0.01
    assert share < 0.003


def test_values_that_do_not_count_say_nothing():
    values, *known = make_values([0.0, 0.2, 0.0])
    hidden = np.random.default_rng(1).random(values.shape) < 0.2
    found, _ = lobe_coefficients(np.where(hidden, -1.0, values), *known)
    assert found == pytest.approx([0.0, 0.2, 0.0], abs=0.01)
    assert lobe_coefficients(np.full_like(values, -1.0), *known) == (
        pytest.approx([0.0, 0.0, 0.0]),
        0.0,
    )
