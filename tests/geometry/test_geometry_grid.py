"""The masked pixel grid: differences and their adjoint, borders, averages, windows."""

import numpy as np
import pytest

from rakelight.geometry.grid import (
    area_mean,
    bounding_window,
    differences,
    gradient_matrices,
    has_gradient,
    mean_gradient,
    mean_gradient_transposed,
    neighbours,
)

MASKS = {
    "all": np.ones((7, 9), bool),
    "row": np.ones((1, 9), bool),
    "column": np.ones((7, 1), bool),
    "pixel": np.ones((1, 1), bool),
    "ragged": np.random.default_rng(4).random((7, 9)) < 0.6,
    "none": np.zeros((7, 9), bool),
}


@pytest.fixture(params=MASKS)
def mask(request):
    return MASKS[request.param]


def values_on(mask, seed=0):
    return np.random.default_rng(seed).normal(size=mask.shape)


def matrix(mask, axis, which):
    """The difference as a dense matrix, column by column."""
    units = np.eye(mask.size).reshape(-1, *mask.shape)
    return np.stack([differences(unit, mask, axis)[which].ravel() for unit in units], axis=1)


def inside(mask, row, column):
    height, width = mask.shape
    return 0 <= row < height and 0 <= column < width and mask[row, column]


@pytest.mark.parametrize("axis", [0, 1])
def test_differences_pixel_by_pixel(mask, axis):
    values, step = values_on(mask), np.array([1, 0]) if axis == 0 else np.array([0, 1])
    forward, backward = differences(values, mask, axis)
    for pixel in np.ndindex(mask.shape):
        after, before = tuple(pixel + step), tuple(pixel - step)
        ahead = mask[pixel] and inside(mask, *after)
        behind = mask[pixel] and inside(mask, *before)
        assert forward[pixel] == (values[after] - values[pixel] if ahead else 0)
        assert backward[pixel] == (values[pixel] - values[before] if behind else 0)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("which", [0, 1])
def test_adjoint(mask, axis, which):
    # <D x, y> = <x, D^T y>, and D^T is minus a divergence: it takes from a pixel what the next
    # one gets, so every difference sums to zero.
    D = matrix(mask, axis, which)
    x, y = values_on(mask, 1), values_on(mask, 2)
    left = (differences(x, mask, axis)[which] * y).sum()
    assert left == pytest.approx(x.ravel() @ (D.T @ y.ravel()), abs=1e-12)
    np.testing.assert_array_equal(D @ np.ones(mask.size), 0)
    assert np.count_nonzero(D) == 2 * np.count_nonzero(neighbours(mask, axis)[which])


@pytest.mark.parametrize("axis", [0, 1])
def test_values_outside_the_mask_are_not_read(mask, axis):
    values = values_on(mask)
    for got, expected in zip(
        differences(np.where(mask, values, np.nan), mask, axis),
        differences(values, mask, axis),
        strict=True,
    ):
        np.testing.assert_array_equal(got, expected)


def test_forward_and_backward_are_the_same_edges(mask):
    for axis in (0, 1):
        forward, backward = neighbours(mask, axis)
        np.testing.assert_array_equal(np.roll(forward, 1, axis), backward)


@pytest.mark.parametrize(("slope_u", "slope_v"), [(1.0, 0.0), (0.25, -3.0), (0.0, 0.0)])
def test_mean_gradient_is_exact_on_planes(mask, slope_u, slope_v):
    rows, columns = np.indices(mask.shape)
    u, v = mean_gradient(slope_u * columns + slope_v * rows + 5.0, mask)
    for gradient, slope, axis in ((u, slope_u, 1), (v, slope_v, 0)):
        exists = np.logical_or(*neighbours(mask, axis))
        np.testing.assert_array_equal(gradient, np.where(exists, slope, 0))


def test_mean_gradient_is_central_inside_and_exact_on_parabolas_there():
    rows, columns = np.indices((6, 8)).astype(float)
    u, v = mean_gradient(columns**2 + rows * columns, np.ones((6, 8), bool))
    np.testing.assert_allclose(u[:, 1:-1], (2 * columns + rows)[:, 1:-1])
    np.testing.assert_allclose(v, columns)
    np.testing.assert_allclose(u[:, 0], 1 + rows[:, 0])  # one-sided at the border


def test_has_gradient_where_both_axes_have_a_neighbour(mask):
    expected = np.array(
        [
            mask[r, c]
            and (inside(mask, r, c - 1) or inside(mask, r, c + 1))
            and (inside(mask, r - 1, c) or inside(mask, r + 1, c))
            for r, c in np.ndindex(mask.shape)
        ]
    ).reshape(mask.shape)
    np.testing.assert_array_equal(has_gradient(mask), expected)


def test_the_transposed_mean_gradient_is_its_transpose(mask):
    rng = np.random.default_rng(1)
    values, along_u, along_v = rng.normal(size=(3, *mask.shape))
    u, v = mean_gradient(np.where(mask, values, 0.0), mask)
    back = mean_gradient_transposed(along_u, along_v, mask)
    assert (u * along_u + v * along_v).sum() == pytest.approx(
        (back * values)[mask].sum(), rel=1e-12
    )
    assert (back[~mask] == 0).all()


def test_gradient_matrices_are_the_mean_gradient(mask):
    values, active = values_on(mask), has_gradient(mask)
    for found, image in zip(gradient_matrices(mask), mean_gradient(values, mask), strict=True):
        assert found.shape == (mask.sum(), mask.sum())
        dense = found @ values[mask]
        np.testing.assert_allclose(dense[active[mask]], image[active], atol=1e-14)
        # pixels without a normal have no gradient, though one of their differences may exist
        np.testing.assert_array_equal(dense[~active[mask]], 0)
        np.testing.assert_allclose(found @ np.ones(mask.sum()), 0, atol=1e-15)


def test_thin_parts_have_no_gradient():
    mask = np.zeros((9, 9), bool)
    mask[1, 1] = mask[4, 2:7] = mask[6:9, 8] = True
    assert not has_gradient(mask).any()


@pytest.mark.parametrize("factor", [1, 2, 3])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_area_mean_is_the_mean_of_each_block(factor, channels):
    image = np.random.default_rng(0).random((6, 12, *channels))
    small = area_mean(image, factor)
    assert small.shape == (6 // factor, 12 // factor, *channels)
    for r, c in np.ndindex(small.shape[:2]):
        block = image[r * factor : (r + 1) * factor, c * factor : (c + 1) * factor]
        np.testing.assert_allclose(small[r, c], block.mean(axis=(0, 1)), rtol=1e-14)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, bool])
def test_area_mean_does_not_overflow(dtype):
    image = np.full((4, 4), np.iinfo(dtype).max if np.dtype(dtype).kind == "u" else 1, dtype)
    np.testing.assert_array_equal(area_mean(image, 2), float(image[0, 0]))


def test_bounding_window_is_the_smallest(mask):
    if not mask.any():
        return
    rows, columns = bounding_window(mask)
    window = mask[rows, columns]
    assert window.sum() == mask.sum()
    for edge in (window[0], window[-1], window[:, 0], window[:, -1]):
        assert edge.any()


def test_bounding_window_margin_stops_at_the_frame():
    mask = np.zeros((10, 20), bool)
    mask[0:3, 7] = True
    assert bounding_window(mask, margin=2) == (slice(0, 5), slice(5, 10))
    assert bounding_window(mask, margin=50) == (slice(0, 10), slice(0, 20))
