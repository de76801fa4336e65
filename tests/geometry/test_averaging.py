"""The averaging operator K against its definition, pixel by pixel."""

import numpy as np
import pytest

from rakelight.geometry.averaging import AveragedData, Averaging, data_sum_of_squares, data_terms
from rakelight.solve import assemble

SHAPE = (12, 20)


def edges_of(factor):
    """Sensor pixels that begin before the window and end after it."""
    return [np.arange(-0.5 * factor, side + factor, factor) for side in SHAPE]


@pytest.fixture(params=[1.0, 1.75, 2.0, 4.0])
def averaging(request):
    mask = np.random.default_rng(1).random(SHAPE) < 0.7
    mask[:5, :5] = False
    return Averaging.on(mask, *edges_of(request.param))


@pytest.fixture
def images(averaging):
    rng = np.random.default_rng(2)
    return rng.normal(size=SHAPE), rng.normal(size=averaging.covered.shape)


def test_means_are_over_the_covered_part_of_the_object(averaging, images):
    image = images[0]
    covered = np.zeros(averaging.covered.shape)
    for i, j in np.ndindex(covered.shape):
        share = np.zeros(SHAPE)
        for row, column in np.argwhere(averaging.mask):
            parts = [
                min(edges[k + 1], at + 1) - max(edges[k], at)
                for edges, k, at in (
                    (averaging.row_edges, i, row),
                    (averaging.column_edges, j, column),
                )
            ]
            share[row, column] = max(parts[0], 0) * max(parts[1], 0)
        if share.sum() > 0:
            covered[i, j] = (share * image).sum() / share.sum()
        assert averaging.covered[i, j] == (share.sum() > 0)
    np.testing.assert_allclose(averaging.down(image), covered, atol=1e-12)
    assert not averaging.covered.all()


def test_up_is_the_transpose_of_down(averaging, images):
    image, sensor = images
    assert np.vdot(averaging.down(image), sensor) == pytest.approx(
        np.vdot(image, averaging.up(sensor)), rel=1e-12
    )


def test_a_pixel_has_the_mean_of_the_sensor_pixels_that_cover_it(averaging, images):
    sensor = images[1]
    shares = averaging.matrix(averaging.mask)
    area = averaging.total(np.ones(SHAPE))[averaging.covered]
    weights = (shares * area[:, None]).toarray()
    found = averaging.upsampled(sensor)
    expected = weights.T @ sensor[averaging.covered] / weights.sum(axis=0)
    np.testing.assert_allclose(found[averaging.mask], expected, atol=1e-12)
    assert not found[~averaging.mask].any()


def test_what_is_outside_the_object_does_not_count(averaging, images):
    image, sensor = images
    other = np.where(averaging.mask, image, np.nan)
    np.testing.assert_array_equal(averaging.down(other), averaging.down(image))
    assert not averaging.up(sensor)[~averaging.mask].any()


def test_averaged_data_are_symmetric_and_their_row_sums_the_weights_shares(averaging, images):
    image, sensor = images
    data = AveragedData(averaging, sensor**2)
    other = np.random.default_rng(3).normal(size=SHAPE)
    assert np.vdot(other, data.apply(image)) == pytest.approx(
        np.vdot(image, data.apply(other)), rel=1e-10
    )
    assert np.vdot(image, data.apply(image)) == pytest.approx(
        (sensor**2 * averaging.down(image) ** 2).sum(), rel=1e-12
    )
    assert data.diagonal().sum() == pytest.approx((sensor**2)[averaging.covered].sum(), rel=1e-12)


def test_half_the_pixels_see_the_same_plane():
    mask = np.ones((8, 12), bool)
    edges = [np.arange(0, side + 1, 4.0) for side in mask.shape]
    fine = Averaging.on(mask, *edges)
    assert fine.factor == 4
    coarse = fine.halved(np.ones((4, 6), bool))
    assert coarse.factor == 2
    v, u = np.indices(mask.shape)
    plane = 1 + 0.5 * v - 0.25 * u
    halved = plane.reshape(4, 2, 6, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse.down(halved), fine.down(plane), rtol=1e-12)


def test_terms_and_misfit_are_of_one_energy():
    rng = np.random.default_rng(3)
    mask = rng.random((6, 8)) < 0.8
    tensor, vector = np.zeros((6, 8, 3)), np.zeros((6, 8, 2))
    tensor[..., [0, 2]] = 1e-6
    weight, target, there = (rng.random((6, 8)) for _ in range(3))
    edges = np.arange(0.0, 7.0, 2.0), np.arange(0.0, 9.0, 2.0)
    for averaging in (None, Averaging.on(mask, *edges)):
        system = assemble(mask, tensor, vector, **data_terms(averaging, weight, target))
        gradient = (system.apply(np.where(mask, there, 0.0)) - system.rhs)[mask]

        def energy(image, averaging=averaging):
            return data_sum_of_squares(averaging, weight, image - target, mask)

        for k, place in enumerate(np.argwhere(mask)[::7]):
            step = np.zeros(mask.shape)
            step[tuple(place)] = 1e-3
            slope = (energy(there + step) - energy(there - step)) / 2e-3
            assert slope / 2 == pytest.approx(gradient[7 * k], abs=1e-4)


def test_the_factor_is_that_of_the_narrower_side():
    edges = np.array([0.0, 2.0, 4.0]), np.array([-0.5, 1.0, 2.5, 4.0])
    averaging = Averaging.on(np.ones((4, 3), bool), *edges)
    np.testing.assert_allclose(averaging.upsampled(np.ones((2, 3))), 1.0)
    assert averaging.factor == 1.5
