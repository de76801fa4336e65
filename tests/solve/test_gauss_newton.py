"""The joint step of a field and a few numbers, and robust scales."""

import numpy as np
import pytest

from rakelight.geometry.grid import gradient_matrices
from rakelight.solve.gauss_newton import bordered_step, damped_solution
from rakelight.solve.robust import CAUCHY, cauchy_scales
from tests.solve.rough_systems import disc, masks, rough

SIZE, COUNT = 14, 6


MASKS = {"all": np.ones((9, 11), bool), **masks(SIZE)}


def parts(mask, seed=0):
    """A rough depth system and its residual, the coupling, the numbers' terms.

    Positive definite together; the coupling goes through the gradient, as light's does.
    """
    rng = np.random.default_rng(seed)
    system = rough(*mask.shape, seed=seed, mask=mask).system()
    residual = (system.rhs - system.apply(rng.normal(size=mask.shape)))[mask]
    columns = sum(
        side.T @ (0.05 * rng.normal(size=(system.unknowns, COUNT)))
        for side in gradient_matrices(mask)
    )
    root = rng.normal(size=(COUNT, COUNT)) * 10.0 ** rng.uniform(-1, 1, COUNT)
    hessian = root.T @ root + 20 * np.eye(COUNT)
    return system.to_sparse(), residual, columns, hessian, rng.normal(size=COUNT)


@pytest.mark.parametrize("name", MASKS)
@pytest.mark.parametrize("damping", [0.0, 1e-3, 0.5])
def test_a_bordered_step_solves_the_whole_system(name, damping):
    matrix, residual, columns, hessian, slope = parts(MASKS[name])
    field, numbers = bordered_step(matrix, residual, columns, hessian, slope, damping)
    ridge = damping * np.diag(hessian) + 1e-9 * np.diag(hessian).mean()
    whole = np.block([[matrix.toarray(), columns], [columns.T, hessian + np.diag(ridge)]])
    assert np.linalg.eigvalsh(whole).min() > 0
    expected = np.linalg.solve(whole, np.concatenate([residual, -slope]))
    np.testing.assert_allclose(field, expected[:-COUNT], atol=1e-11 * np.abs(expected).max())
    np.testing.assert_allclose(numbers, expected[-COUNT:], rtol=1e-9)


def test_the_coupling_matters():
    matrix, residual, columns, hessian, slope = parts(disc(SIZE))
    field, numbers = bordered_step(matrix, residual, columns, hessian, slope, 0.0)
    alone, apart = bordered_step(matrix, residual, 0 * columns, hessian, slope, 0.0)
    assert np.abs(field - alone).max() > 1e-3 * np.abs(field).max()
    assert np.abs(numbers - apart).max() > 1e-3 * np.abs(numbers).max()
    np.testing.assert_allclose(matrix @ alone, residual, atol=1e-11 * np.abs(residual).max())


def test_a_step_from_the_solution_is_nought():
    matrix, residual, columns, hessian, slope = parts(disc(SIZE))
    field, numbers = bordered_step(matrix, residual, columns, hessian, slope, 0.0)
    residual_there = residual - matrix @ field - columns @ numbers
    slope_there = slope + columns.T @ field + hessian @ numbers
    again = bordered_step(matrix, residual_there, columns, hessian, slope_there, 0.0)
    for second, first in zip(again, (field, numbers), strict=True):
        assert np.abs(second).max() < 1e-8 * np.abs(first).max()


def test_damping_shortens_the_numbers_step():
    matrix, residual, *others = parts(disc(SIZE))
    steps = [bordered_step(matrix, residual, *others, each) for each in (0, 1, 100, 1e6, 1e12)]
    lengths = [np.linalg.norm(numbers) for _, numbers in steps]
    assert (np.diff(lengths) < 0).all()
    assert lengths[3] < 1e-4 * lengths[0]
    field, alone = steps[-1][0], np.linalg.solve(matrix.toarray(), residual)
    np.testing.assert_allclose(field, alone, atol=1e-9)


def test_a_number_that_nothing_determines_does_not_move():
    matrix, residual, columns, hessian, slope = parts(disc(SIZE))
    columns[:, 2] = 0
    hessian[2] = hessian[:, 2] = slope[2] = 0
    for damping in (0.0, 0.1):
        field, numbers = bordered_step(matrix, residual, columns, hessian, slope, damping)
        assert abs(numbers[2]) < 1e-6 * np.abs(numbers).max()
        assert np.isfinite(field).all()


def test_a_damped_solution_is_that_of_the_damped_matrix():
    half = np.random.default_rng(0).normal(size=(6, 6))
    matrix, right = half @ half.T, np.arange(6.0)
    found = damped_solution(matrix, right, matrix.diagonal(), 0.3)
    damped = matrix + 0.3 * np.diag(matrix.diagonal())
    np.testing.assert_allclose(damped @ found, right, rtol=0, atol=1e-7)


def test_nothing_moves_along_what_is_not_determined():
    # A matrix of rank two: a right side's rounding along the third direction is next to nothing.
    half = np.array([[1.0, 2.0], [2.0, -1.0], [3.0, 1.0]])
    matrix, free = half @ half.T, np.array([1.0, 1.0, -1.0]) / np.sqrt(3)
    right = matrix @ [1.0, 0.0, 0.0]
    for rounding in (0.0, 1e-14):
        found = damped_solution(matrix, right + rounding * free, matrix.diagonal(), 0.0)
        assert abs(free @ found) < 1e-5
        np.testing.assert_allclose(matrix @ found, right, rtol=0, atol=1e-7)
    assert not damped_solution(np.zeros((3, 3)), np.ones(3), np.zeros(3), 0.1).any()


def test_a_matrix_that_rounding_left_indefinite_is_solved_too():
    matrix = np.array([[1.0, 2.0], [2.0, 1.0]])
    found = damped_solution(matrix, np.array([3.0, 3.0]), matrix.diagonal(), 0.0)
    np.testing.assert_allclose(found, [1.0, 1.0], rtol=1e-8)


# ---- robust scales


def test_the_scale_is_the_spreads_where_the_pixel_is_no_worse():
    scales = cauchy_scales(0.02, np.full((3, 4), 0.001))
    np.testing.assert_allclose(scales, 2.385 * 0.02, rtol=1e-12)


def test_the_scale_grows_with_a_pixels_own_misfit():
    # For Gaussian noise the mean absolute residual is sqrt(2 / pi) of the deviation.
    rng = np.random.default_rng(0)
    residual = 0.03 * rng.normal(size=(200_000, 1))
    misfit = np.abs(residual).mean(axis=0)[None]
    assert cauchy_scales(0.01, misfit)[0, 0] == pytest.approx(CAUCHY * 0.03, rel=0.01)
    misfits = np.linspace(0, 0.2, 50)[None]
    scales = cauchy_scales(0.01, misfits)
    assert (np.diff(scales) >= 0).all()
    assert scales[0, 0] < scales[0, -1] / 10
    np.testing.assert_allclose(scales[0, -1], CAUCHY * np.sqrt(np.pi / 2) * 0.2, rtol=1e-12)


def test_cauchy_at_this_scale_is_95_percent_efficient():
    # Asymptotic efficiency of the location estimate on unit Gaussian noise: (E psi')^2 / E psi^2.
    r = np.linspace(-12, 12, 200_001)
    density = np.exp(-r * r / 2) / np.sqrt(2 * np.pi)
    q = (r / CAUCHY) ** 2
    slope = ((1 - q) / (1 + q) ** 2 * density).sum() * (r[1] - r[0])
    square = ((r / (1 + q)) ** 2 * density).sum() * (r[1] - r[0])
    assert slope**2 / square == pytest.approx(0.95, abs=5e-4)
