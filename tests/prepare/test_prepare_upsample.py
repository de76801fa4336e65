"""Depth on a finer grid that covers the same field of view."""

import numpy as np
import pytest

from rakelight.geometry.grid import Links, area_mean, surface_links
from rakelight.model import Camera
from rakelight.prepare.upsample import upsample as upsample_to

SHAPE = (30, 40)
FACTORS = [2, 4]


def centres(shape, factor):
    """Rows and columns of the fine pixels' centres, in pixels of the coarse grid."""
    v, u = np.indices((shape[0] * factor, shape[1] * factor))
    return (v + 0.5) / factor - 0.5, (u + 0.5) / factor - 0.5


def upsample(depth, factor, links=None):
    links = links or Links.of(np.isfinite(depth))
    return upsample_to(depth, (depth.shape[0] * factor, depth.shape[1] * factor), links)


def upsample_cut(depth, factor):
    camera = Camera(SHAPE[1], SHAPE[0], 50.0, 50.0, 19.5, 14.5)
    return upsample(depth, factor, surface_links(depth, np.isfinite(depth), camera))


def inner(factor, pixels=8):
    edge = pixels * factor
    return slice(edge, -edge), slice(edge, -edge)


def log_surface(kind, v, u):
    if kind == "plane":
        return -0.2 + 0.01 * u - 0.004 * v
    return -0.2 + 0.02 * np.sin(u / 5 + 1) * np.cos(v / 6)


@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_planes_in_log_depth_are_exact_inside(factor):
    # A shift of half a fine pixel would be an error of 0.01 / (2 factor).
    coarse = log_surface("plane", *np.indices(SHAPE))
    fine = np.log(upsample(np.exp(coarse), factor))
    assert fine.shape == (SHAPE[0] * factor, SHAPE[1] * factor)
    exact = log_surface("plane", *centres(SHAPE, factor))
    assert np.abs(fine - exact)[inner(factor)].max() < 1e-6


@pytest.mark.parametrize("factor", FACTORS)
def test_a_smooth_surface_is_met_without_a_shift(factor):
    coarse = log_surface("waves", *np.indices(SHAPE))
    fine = np.log(upsample(np.exp(coarse), factor))[inner(factor)]
    v, u = centres(SHAPE, factor)
    here = np.abs(fine - log_surface("waves", v, u)[inner(factor)]).max()
    assert here < 1e-5
    for dv, du in ((0, 0.1), (0.1, 0), (0, -0.1), (-0.1, 0)):
        shifted = log_surface("waves", v + dv, u + du)[inner(factor)]
        assert np.abs(fine - shifted).max() > 20 * here


@pytest.mark.parametrize("factor", FACTORS)
def test_blocks_average_to_about_what_the_sensor_saw(factor):
    coarse = np.exp(log_surface("waves", *np.indices(SHAPE)))
    back = area_mean(upsample(coarse, factor), factor)
    # what remains is the curvature within a block
    assert np.abs(back - coarse)[inner(1)].max() < 2e-4


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("flip", [np.s_[::-1], np.s_[:, ::-1]])
def test_no_side_is_preferred(factor, flip):
    depth = np.exp(0.1 * np.random.default_rng(0).normal(size=SHAPE))
    depth[:10, :20] = np.nan
    whole = np.where(np.isfinite(depth), depth, 1.0)
    np.testing.assert_allclose(
        upsample(whole[flip], factor), upsample(whole, factor)[flip], rtol=1e-12
    )


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_a_constant_object_is_constant_everywhere(factor):
    depth = np.full(SHAPE, np.nan)
    depth[10:20, 12:25] = 0.9
    np.testing.assert_allclose(upsample(depth, factor), 0.9, rtol=1e-12)


def test_scaled_depth_gives_scaled_depth():
    depth = np.exp(0.1 * np.random.default_rng(0).normal(size=SHAPE))
    np.testing.assert_allclose(upsample(3 * depth, 2), 3 * upsample(depth, 2), rtol=1e-12)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (2, 1)])
@pytest.mark.parametrize("factor", FACTORS)
def test_tiny_maps(shape, factor):
    np.testing.assert_allclose(upsample(np.full(shape, 0.7), factor), 0.7, rtol=1e-12)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("axis", [0, 1])
def test_surfaces_go_on_to_a_jump_and_end_there(factor, axis):
    v, u = np.indices(SHAPE)
    far = [v, u][axis] > 12
    coarse = log_surface("plane", v, u) + 0.6 * far
    fine = np.log(upsample_cut(np.exp(coarse), factor))
    v, u = centres(SHAPE, factor)
    exact = log_surface("plane", v, u) + 0.6 * ([v, u][axis] > 12.5)
    inside = inner(factor, 2)
    assert np.abs(fine - exact)[inside].max() < 0.005
    ringing = np.log(upsample(np.exp(coarse), factor))
    assert np.abs(ringing - exact)[inside].max() > 0.1


def test_round_a_corner_the_surface_is_whole():
    # A cut that ends inside the map: around its end the same surface is on both sides.
    v, u = np.indices(SHAPE)
    coarse = np.exp(log_surface("plane", v, u))
    right = (u < SHAPE[1] - 1) & ~((u == 20) & (v < 12))
    links = Links(np.ones(SHAPE, bool), right, v < SHAPE[0] - 1)
    v, u = centres(SHAPE, 3)
    error = np.log(upsample(coarse, 3, links)) - log_surface("plane", v, u)
    assert np.abs(error)[inner(3, 4)].max() < 1e-4


def test_what_a_jump_changes_stays_beside_it():
    rng = np.random.default_rng(0)
    coarse = np.exp(0.01 * rng.normal(size=SHAPE))
    cut = coarse.copy()
    cut[:, 20:] *= 2
    apart = (upsample_cut(cut, 2) / upsample(coarse, 2))[:, : 2 * 20 - 2 * 6]
    np.testing.assert_allclose(apart, 1, atol=1e-3)


@pytest.mark.parametrize("shape", [SHAPE, (75, 100)])
def test_a_window_is_a_part_of_the_whole(shape):
    step = np.exp(log_surface("waves", *np.indices(SHAPE)) + 0.6 * (np.indices(SHAPE)[1] > 12))
    camera = Camera(SHAPE[1], SHAPE[0], 50.0, 50.0, 19.5, 14.5)
    links = surface_links(step, np.ones(SHAPE, bool), camera)
    window = slice(3, 28), slice(20, 39)
    part = upsample_to(step, shape, links, window)
    np.testing.assert_array_equal(part, upsample_to(step, shape, links)[window])


TURNS = {
    "left to right": lambda image: image[:, ::-1],
    "top to bottom": lambda image: image[::-1],
    "transposed": lambda image: image.T,
}


@pytest.mark.parametrize("name", TURNS)
def test_no_side_is_preferred_beside_a_jump(name):
    v, u = np.mgrid[:32, :32].astype(float)
    depth = np.exp(0.02 * np.sin(u / 4 + 1) * np.cos(v / 5))
    depth[(u > 15) & (v < 20)] *= 1.3
    depth[12:14, 14:] *= 0.7
    camera = Camera(32, 32, fx=50.0, fy=50.0, cx=15.5, cy=15.5)

    def finer(depth):
        return upsample(depth, 4, surface_links(depth, np.ones((32, 32), bool), camera))

    turned = finer(np.ascontiguousarray(TURNS[name](depth)))
    np.testing.assert_allclose(turned, TURNS[name](finer(depth)), rtol=1e-6)
