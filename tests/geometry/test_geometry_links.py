"""Links: where a surface hangs together, and that differences stop where it does not."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.geometry.grid import (
    STEEPEST,
    Links,
    differences,
    gradient_matrices,
    has_gradient,
    mean_gradient,
    neighbours,
    surface_links,
)
from rakelight.model import Camera
from rakelight.solve import assemble

CAMERA = Camera(12, 9, fx=300.0, fy=200.0, cx=5.5, cy=4.0)
ROW, COLUMN = np.indices(CAMERA.shape)
RAGGED = np.random.default_rng(4).random(CAMERA.shape) < 0.8
MASKS = {"all": np.ones(CAMERA.shape, bool), "ragged": RAGGED}
# A slanted border between two surfaces, with steps along both axes.
LEFT = COLUMN + ROW // 2 < 7
SLOPES = ((0.5, -0.25), (-1.0, 2.0))


@pytest.fixture(params=MASKS)
def mask(request):
    return MASKS[request.param]


def within(mask, *regions):
    """The links of a mask's pixels that lie in the same region."""
    parts = [Links.of(mask & region) for region in regions]
    right, down = (
        np.logical_or.reduce([getattr(p, side) for p in parts]) for side in ("right", "down")
    )
    return Links(mask, right, down)


def two_planes(jump=100.0):
    """A different plane on each side of the border, `jump` apart, and its slopes."""
    planes = [u * COLUMN + v * ROW + jump * k for k, (u, v) in enumerate(SLOPES)]
    slopes = np.where(LEFT[..., None], *SLOPES)
    return np.where(LEFT, *planes), slopes


def random_links(shape, seed=0, linked=0.9):
    rng = np.random.default_rng(seed)
    whole = Links.of(rng.random(shape) < 0.95)
    right, down = (side & (rng.random(shape) < linked) for side in (whole.right, whole.down))
    return Links(whole.mask, right, down)


# ---- which neighbours are linked


def test_a_mask_links_all_its_neighbours(mask):
    links = Links.of(mask)
    height, width = mask.shape
    for r, c in np.ndindex(mask.shape):
        assert links.right[r, c] == (mask[r, c] and c + 1 < width and mask[r, c + 1])
        assert links.down[r, c] == (mask[r, c] and r + 1 < height and mask[r + 1, c])
    assert not links.cut
    assert Links.of(links) is links


@pytest.mark.parametrize("side", ["right", "down"])
def test_one_missing_link_is_a_cut(mask, side):
    links = Links.of(mask)
    linked = getattr(links, side).copy()
    linked[tuple(np.argwhere(linked)[5])] = False
    assert replace(links, **{side: linked}).cut


def test_links_without_a_cut_are_the_mask(mask):
    links, values = Links.of(mask), np.random.default_rng(0).normal(size=mask.shape)
    for axis in (0, 1):
        np.testing.assert_array_equal(neighbours(links, axis), neighbours(mask, axis))
        found, expected = (differences(values, grid, axis) for grid in (links, mask))
        np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(mean_gradient(values, links), mean_gradient(values, mask))
    np.testing.assert_array_equal(has_gradient(links), has_gradient(mask))
    for one, two in zip(gradient_matrices(links), gradient_matrices(mask), strict=True):
        np.testing.assert_array_equal(one.toarray(), two.toarray())


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [1, -1])
def test_surface_links_are_cut_above_the_steepest(mask, axis, side):
    # The lateral distance is that of the nearer of both.
    near, focal = 0.7, (CAMERA.fy, CAMERA.fx)[axis]
    for share, linked in ((0.999, True), (1.001, False)):
        far = near + share * STEEPEST * near / focal
        upper = np.indices(mask.shape)[axis] < 5
        depth = np.where(upper, *((near, far) if side > 0 else (far, near)))
        found = surface_links(depth, mask, CAMERA)
        expected = Links.of(mask) if linked else within(mask, upper, ~upper)
        np.testing.assert_array_equal(found.right, expected.right)
        np.testing.assert_array_equal(found.down, expected.down)
        assert found.cut is not linked


def test_surface_links_do_not_depend_on_the_unit_or_on_what_lies_outside():
    rng = np.random.default_rng(1)
    depth = 0.7 + 0.04 * rng.random(RAGGED.shape)
    found = surface_links(depth, RAGGED, CAMERA)
    assert found.cut
    assert found.right.any()
    for other in (1000 * depth, np.where(RAGGED, depth, np.nan)):
        again = surface_links(other, RAGGED, CAMERA)
        np.testing.assert_array_equal(again.right, found.right)
        np.testing.assert_array_equal(again.down, found.down)


# ---- halving


@pytest.mark.parametrize("shape", [(10, 12), (9, 13), (2, 2), (1, 6)])
def test_a_halved_link_has_nothing_cut_on_the_way(shape):
    for seed in range(5):
        fine = random_links(shape, seed)
        coarse = fine.halved()
        height, width = coarse.mask.shape
        assert (height, width) == tuple(-(-side // 2) for side in shape)
        for r, c in np.ndindex(height, width):
            rows, columns = slice(2 * r, 2 * r + 2), slice(2 * c, 2 * c + 2)
            cell = fine.mask[rows, columns]
            assert coarse.mask[r, c] == (cell.size == 4 and cell.all())
            # Through the cell, across, and through the next one, along both of its lines.
            across = fine.right[rows, 2 * c : 2 * c + 3]
            below = fine.down[2 * r : 2 * r + 3, columns]
            both = c + 1 < width and coarse.mask[r, c] and coarse.mask[r, c + 1]
            assert coarse.right[r, c] == (both and across.all())
            both = r + 1 < height and coarse.mask[r, c] and coarse.mask[r + 1, c]
            assert coarse.down[r, c] == (both and below.all())


def test_halving_cuts_nothing_that_is_whole(mask):
    assert not Links.of(mask).halved().cut


def test_halving_keeps_a_border_closed():
    coarse = within(MASKS["all"], LEFT, ~LEFT).halved()
    padded = np.pad(LEFT, ((0, 1), (0, 0)))
    corner = [padded[r::2, c::2] for r in (0, 1) for c in (0, 1)]
    left, right = np.logical_and.reduce(corner), ~np.logical_or.reduce(corner)
    assert not (coarse.right[:, :-1] & left[:, :-1] & right[:, 1:]).any()
    assert not (coarse.down[:-1] & (left[:-1] & right[1:] | right[:-1] & left[1:])).any()
    assert coarse.cut


# ---- differences stop at a cut


@pytest.mark.parametrize("axis", [0, 1])
def test_neighbours_and_differences_are_those_of_each_side(mask, axis):
    links, values = within(mask, LEFT, ~LEFT), two_planes()[0]
    parts = (mask & LEFT, mask & ~LEFT)
    for found, *each in zip(
        (*neighbours(links, axis), *differences(values, links, axis)),
        *((*neighbours(part, axis), *differences(values, part, axis)) for part in parts),
        strict=True,
    ):
        np.testing.assert_array_equal(found, np.where(LEFT, *each))


def test_gradients_are_exact_on_both_sides_of_a_jump(mask):
    links = within(mask, LEFT, ~LEFT)
    values, slopes = two_planes()
    active = has_gradient(links)
    np.testing.assert_array_equal(active, has_gradient(mask & LEFT) | has_gradient(mask & ~LEFT))
    across = np.stack(mean_gradient(values, mask), axis=-1)
    assert np.abs(across - slopes)[active].max() > 10
    images, matrices = mean_gradient(values, links), gradient_matrices(links)
    for k, (image, found) in enumerate(zip(images, matrices, strict=True)):
        np.testing.assert_array_equal(image[active], slopes[active, k])
        expected = np.where(active, slopes[..., k], 0.0)[mask]
        np.testing.assert_allclose(found @ values[mask], expected, atol=1e-13)


# ---- weights of the difference pairs


def pairs_of(links):
    """(H, W, 4) which of the pairs (+u,+v), (+u,-v), (-u,+v), (-u,-v) exist."""
    (right, left), (down, up) = neighbours(links, 1), neighbours(links, 0)
    return np.stack([right & down, right & up, left & down, left & up], axis=-1)


def test_pair_weights_are_one_without_a_cut(mask):
    links = Links.of(mask)
    np.testing.assert_array_equal(links.pair_weights, pairs_of(links))


def test_pair_weights_average_over_linked_pairs_only():
    links = random_links((20, 30), linked=0.7)
    inside, linked = pairs_of(Links.of(links.mask)), pairs_of(links)
    values = np.random.default_rng(2).normal(size=linked.shape)
    weights = links.pair_weights
    assert (weights[~linked] == 0).all()
    for pixel in np.ndindex(links.mask.shape):
        if linked[pixel].any():
            found = (weights[pixel] * values[pixel])[inside[pixel]].mean()
            assert found == pytest.approx(values[pixel][linked[pixel]].mean(), abs=1e-14)
    assert (linked.any(axis=-1) & (linked != inside).any(axis=-1)).sum() > 100


def test_pair_weights_find_two_separate_planes():
    mask = MASKS["all"]
    values, slopes = two_planes()
    tensor = np.broadcast_to([2.0, 0.5, 1.0], (*mask.shape, 3))
    vector = np.stack([slopes @ [2.0, 0.5], slopes @ [0.5, 1.0]], axis=-1)
    anchors = np.zeros(mask.shape)
    anchors[0, 0] = anchors[-1, -1] = 1.0  # one pixel on each side
    links = within(mask, LEFT, ~LEFT)
    errors = []
    for pairs in (links.pair_weights, None):
        system = assemble(mask, tensor, vector, anchors, values, pairs)
        found = np.linalg.solve(system.to_sparse().toarray(), system.rhs[mask])
        errors.append(np.abs(found - values[mask]).max())
    assert errors[0] < 1e-11
    assert errors[1] > 1  # the jump is no slope of either plane
