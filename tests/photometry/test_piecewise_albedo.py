"""Edge weights and images that are smooth between edges."""

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import spsolve

from rakelight.errors import InputError
from rakelight.photometry.piecewise_albedo import edge_weights, piecewise_smooth
from tests.solve.stalling import stalling_solver

SHAPE = (17, 22)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture
def mask(rng):
    return rng.random(SHAPE) < 0.8


def direct(target, data_weight, edges, strength, mask):
    """The same by a dense list of links and a direct solver."""
    number = np.cumsum(mask).reshape(SHAPE) - 1
    size = int(mask.sum())
    rows = []
    for (down, across), weight in (((0, 1), edges[0]), ((1, 0), edges[1])):
        for r in range(SHAPE[0] - down):
            for c in range(SHAPE[1] - across):
                if mask[r, c] and mask[r + down, c + across]:
                    rows.append((number[r, c], number[r + down, c + across], weight[r, c]))
    p, q, w = (np.array(column) for column in zip(*rows, strict=True))
    index = np.arange(len(p))
    difference = csr_array((np.ones(len(p)), (index, p)), shape=(len(p), size))
    difference -= csr_array((np.ones(len(p)), (index, q)), shape=(len(p), size))
    matrix = diags_array(data_weight[mask]) + strength * difference.T @ diags_array(w) @ difference
    return spsolve(matrix.tocsc(), (data_weight * target)[mask])


@pytest.mark.parametrize("strength", [0.1, 3.0, 100.0])
def test_it_is_the_least_squares_solution(rng, mask, strength):
    target, data_weight = rng.random(SHAPE), 0.1 + rng.random(SHAPE)
    color, depth = rng.random((*SHAPE, 3)), rng.random(SHAPE)
    edges = edge_weights(color, depth, mask, sigma_c=0.5, sigma_d=0.5)
    smooth = piecewise_smooth(target, data_weight, edges, strength, mask, tolerance=1e-9)
    expected = direct(target, data_weight, edges, strength, mask)
    np.testing.assert_allclose(smooth[mask], expected, atol=1e-6)


def test_a_pixel_without_data_takes_its_neighbours_value():
    mask, target = np.ones((3, 3), bool), np.full((3, 3), 0.4)
    target[1, 1] = 9.0
    data_weight = np.ones((3, 3))
    data_weight[1, 1] = 0.0
    edges = edge_weights(np.zeros((3, 3, 3)), np.ones((3, 3)), mask, sigma_c=1, sigma_d=1)
    smooth = piecewise_smooth(target, data_weight, edges, 1.0, mask, tolerance=1e-9)
    np.testing.assert_allclose(smooth, 0.4, atol=1e-4)


def test_a_pixel_that_nothing_determines_keeps_its_target():
    mask = np.zeros((3, 3), bool)
    mask[0, 0] = mask[2, 2] = True
    edges = edge_weights(np.zeros((3, 3, 3)), np.ones((3, 3)), mask, sigma_c=1, sigma_d=1)
    target = np.full((3, 3), 0.7)
    smooth = piecewise_smooth(target, np.zeros((3, 3)), edges, 1.0, mask)
    assert smooth[mask].tolist() == pytest.approx([0.7, 0.7])


def test_weights_fall_with_colour_and_with_depth():
    mask = np.ones((1, 4), bool)
    color = np.array([[[0.0], [0.1], [0.1], [0.1]]])
    depth = np.array([[1.0, 1.0, 1.002, 1.002]])
    right, down = edge_weights(color, depth, mask, sigma_c=0.1, sigma_d=0.001)
    assert right[0].tolist() == pytest.approx([np.exp(-0.5), np.exp(-2.0), 1.0, 0.0])
    assert not down.any()


def test_no_link_leaves_the_mask(mask):
    edges = edge_weights(np.zeros((*SHAPE, 3)), np.ones(SHAPE), mask, sigma_c=1, sigma_d=1)
    assert not edges[0][:, :-1][~(mask[:, :-1] & mask[:, 1:])].any()
    assert not edges[1][:-1][~(mask[:-1] & mask[1:])].any()


def test_an_area_without_data_behind_an_edge_keeps_its_target():
    # Two linked pixels that no data reaches: singular, were they not held.
    mask, target = np.ones((1, 4), bool), np.array([[0.2, 0.2, 0.6, 0.6]])
    edges = (np.array([[1.0, 0.0, 1.0, 0.0]]), np.zeros((1, 4)))
    smooth = piecewise_smooth(target, np.array([[1.0, 1.0, 0.0, 0.0]]), edges, 30.0, mask)
    np.testing.assert_allclose(smooth, target, atol=1e-4)


def test_channels_share_edges_and_nothing_else(rng, mask):
    target, data_weight = rng.random((*SHAPE, 3)), rng.random((*SHAPE, 3))
    edges = edge_weights(target, np.ones(SHAPE), mask, sigma_c=0.5, sigma_d=1)
    together = piecewise_smooth(target, data_weight, edges, 3.0, mask, tolerance=1e-9)
    for c in range(3):
        alone = direct(target[..., c], data_weight[..., c], edges, 3.0, mask)
        np.testing.assert_allclose(together[mask, c], alone, atol=1e-6)


@pytest.mark.parametrize("after", [0, 1, 2])
def test_a_solver_that_stalls_is_an_error(rng, mask, after):
    target, edges = rng.random((*SHAPE, 3)), (np.ones(SHAPE), np.ones(SHAPE))
    with stalling_solver(after), pytest.raises(InputError, match=r"smooth image.*stalled"):
        piecewise_smooth(target, np.ones(target.shape), edges, 1.0, mask)
