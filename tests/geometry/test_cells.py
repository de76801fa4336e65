"""Sums over cells, and fields that are linear between the centres of cells."""

import numpy as np
import pytest

from rakelight.geometry.cells import Cells, cell_sums, interpolate

ROW, COLUMN = np.mgrid[:11, :14]
MASKS = {
    "all": np.ones((11, 14), bool),
    "disc": np.hypot(ROW - 5, COLUMN - 7) < 5,
    "ragged": np.random.default_rng(0).random((11, 14)) < 0.4,
    "islands": (np.hypot(ROW - 1, COLUMN - 2) < 2) | (np.hypot(ROW - 9, COLUMN - 12) < 2),
    "row": np.ones((1, 14), bool),
    "pixel": np.ones((1, 1), bool),
}
CELLS = [1, 2, 3, 5, 20]


@pytest.fixture(params=MASKS)
def mask(request):
    return MASKS[request.param]


def normal(shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape)


def plane(row, column):
    return 2.0 + 0.5 * row - 0.25 * column


def centred_plane(cell, shape):
    """A plane at the centres of cells, the last one's being where it would be were it whole."""
    height, width = (-(-side // cell) for side in shape)
    row, column = np.mgrid[:height, :width] * cell + (cell - 1) / 2
    return plane(row, column)


def between_centres(cell, shape):
    """Pixels between the outermost centres along both axes."""
    sides = []
    for size in shape:
        pixel = np.arange(size)
        last = (-(-size // cell) - 1) * cell + (cell - 1) / 2
        sides.append((pixel >= (cell - 1) / 2) & (pixel <= last))
    return np.logical_and.outer(*sides)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("channels", [(), (3,), (2, 4)])
def test_cell_sums_cell_by_cell(cell, channels):
    image = normal((11, 14, *channels))
    sums = cell_sums(image, cell)
    assert sums.shape == (-(-11 // cell), -(-14 // cell), *channels)
    for r, c in np.ndindex(sums.shape[:2]):
        block = image[r * cell : (r + 1) * cell, c * cell : (c + 1) * cell]
        np.testing.assert_allclose(sums[r, c], block.sum(axis=(0, 1)), atol=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_spread_keeps_constants_and_planes(mask, cell):
    shape = mask.shape
    size = tuple(-(-side // cell) for side in shape)
    np.testing.assert_allclose(interpolate(np.full(size, 7.0), cell, shape), 7.0, rtol=1e-14)
    found = interpolate(centred_plane(cell, shape), cell, shape)
    assert found.shape == shape
    inside = between_centres(cell, shape)
    np.testing.assert_allclose(found[inside], plane(*np.indices(shape))[inside], atol=1e-13)


def test_spread_goes_on_level_beyond_the_outermost_centres():
    found = interpolate(np.array([[1.0, 2.0], [3.0, 5.0]]), 3, (6, 6))
    np.testing.assert_array_equal(found[:2, :2], 1.0)
    np.testing.assert_array_equal(found[4:, 4:], 5.0)


@pytest.mark.parametrize("cell", CELLS)
def test_the_cells_inside_hold_a_pixel_of_the_mask(mask, cell):
    inside = Cells.on(mask, cell).inside
    for r, c in np.ndindex(inside.shape):
        block = mask[r * cell : (r + 1) * cell, c * cell : (c + 1) * cell]
        assert inside[r, c] == block.any()


@pytest.mark.parametrize("cell", CELLS)
def test_gather_is_the_transpose_of_spread(mask, cell):
    cells = Cells.on(mask, cell)
    values, image = normal(cells.inside.shape, 1), normal(mask.shape, 2)
    there = (cells.interpolate(values) * image)[mask].sum()
    back = (values * cells.gather(image))[cells.inside].sum()
    assert there == pytest.approx(back, abs=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_nothing_outside_is_read(mask, cell):
    cells = Cells.on(mask, cell)
    values, image = normal(cells.inside.shape, 1), normal(mask.shape, 2)
    wild = cells.interpolate(np.where(cells.inside, values, np.nan))
    np.testing.assert_array_equal(wild, cells.interpolate(values))
    wild = cells.gather(np.where(mask, image, np.nan))
    np.testing.assert_array_equal(wild, cells.gather(image))
    assert not wild[~cells.inside].any()


@pytest.mark.parametrize("cell", CELLS)
def test_fields_of_cells_keep_constants_and_planes(mask, cell):
    cells = Cells.on(mask, cell)
    np.testing.assert_allclose(cells.interpolate(np.full(cells.inside.shape, 7.0)), 7.0, rtol=1e-14)
    # A plane where all the cells around are inside; elsewhere the nearest one goes on.
    known = interpolate(cells.inside.astype(float), cell, mask.shape) > 1 - 1e-12
    known &= between_centres(cell, mask.shape)
    found = cells.interpolate(centred_plane(cell, mask.shape))
    np.testing.assert_allclose(found[known], plane(*np.indices(mask.shape))[known], atol=1e-13)


@pytest.mark.parametrize("cell", CELLS)
def test_gather_keeps_the_sum(mask, cell):
    image = normal(mask.shape)
    assert Cells.on(mask, cell).gather(image).sum() == pytest.approx(image[mask].sum(), abs=1e-12)


def test_cells_of_one_pixel_are_the_pixels(mask):
    cells, image = Cells.on(mask, 1), normal(mask.shape)
    np.testing.assert_array_equal(cells.inside, mask)
    np.testing.assert_array_equal(cells.interpolate(image)[mask], image[mask])
    np.testing.assert_array_equal(cells.gather(image), np.where(mask, image, 0.0))


def test_a_cell_outside_continues_the_nearest_inside():
    cells = Cells.on(np.arange(9)[None] >= 6, 3)
    found = cells.interpolate(np.array([[5.0, -7.0, 1.0]]))
    np.testing.assert_array_equal(found, np.ones((1, 9)))
