"""The compiled differences are the plain ones."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.geometry.derivatives import fourth_differences, gradient_image
from rakelight.geometry.grid import Links, gradient_matrices, mean_gradient

WHOLE = np.ones((9, 12), bool)


def ragged(seed):
    """Links with holes in the mask, and cuts."""
    rng = np.random.default_rng(seed)
    links = Links.of(rng.random((13, 17)) < 0.93)
    right, down = (side & (rng.random(side.shape) < 0.95) for side in (links.right, links.down))
    return replace(links, right=right, down=down)


@pytest.mark.parametrize(
    "grid",
    [WHOLE, ragged(0), ragged(1), np.ones((1, 7), bool), np.ones((7, 1), bool), ~WHOLE],
    ids=["whole", "ragged", "another", "a row", "a column", "nothing"],
)
def test_the_gradient_image_is_the_mean_gradient(grid):
    values = np.random.default_rng(2).normal(size=Links.of(grid).mask.shape)
    np.testing.assert_array_equal(
        gradient_image(values, grid), np.stack(mean_gradient(values, grid), axis=-1)
    )


def test_the_sparse_gradient_has_u_and_v_of_each_pixel_in_turn():
    links = ragged(3)
    values = np.random.default_rng(2).normal(size=links.mask.sum())
    along = np.stack([side @ values for side in gradient_matrices(links)], axis=-1)
    np.testing.assert_allclose(links.gradient @ values, along.ravel(), rtol=0, atol=1e-15)


@pytest.mark.parametrize("seed", [0, 1])
def test_fourth_differences_are_differences_of_differences(seed):
    links, values = ragged(seed), np.random.default_rng(2).normal(size=(13, 17))
    seen = 0
    images = fourth_differences(values, links)
    for axis, found, exists in zip((1, 0), images, links.fives, strict=True):
        plain = np.zeros(values.shape)
        inner = [slice(None)] * 2
        inner[axis] = slice(2, -2)
        plain[tuple(inner)] = np.diff(values, 4, axis=axis)
        np.testing.assert_allclose(found, np.where(exists, plain, 0), rtol=0, atol=1e-14)
        seen += exists.sum()
    assert seen > 100


def test_no_fourth_difference_reaches_across_a_cut_or_over_a_pixel_without_a_normal():
    links = Links.of(WHOLE)
    along_u, along_v = links.fives
    assert along_u[:, 2:-2].all()
    assert along_u.sum() == 9 * 8
    assert along_v[2:-2].all()
    assert along_v.sum() == 5 * 12
    right = links.right.copy()
    right[4, 5] = False
    cut = replace(links, right=right).fives[0]
    # The four with either pixel beside the cut, or two away, in that row alone.
    assert np.flatnonzero(along_u[4] & ~cut[4]).tolist() == [4, 5, 6, 7]
    lone = WHOLE.copy()
    lone[[3, 5], 6] = False  # the pixel between them has no neighbour along v
    assert not Links.of(lone).fives[0][4, 5:8].any()
