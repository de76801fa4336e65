"""The joint step of a field and a few numbers, and robust scales."""

import numpy as np
import pytest
from rough_systems import disc, masks, rough

from rakelight.geometry.grid import gradient_matrices, mean_gradient
from rakelight.solve.gauss_newton import border
from rakelight.solve.robust import CAUCHY, cauchy_scales

SIZE, COUNT = 14, 6


def parts(mask, seed=0):
    """A rough depth system, a value, and the numbers' terms, positive definite together."""
    rng = np.random.default_rng(seed)
    system = rough(*mask.shape, seed=seed, mask=mask).system()
    value = rng.normal(size=mask.shape)
    coupling = 0.05 * rng.normal(size=(*mask.shape, 2, COUNT))
    root = rng.normal(size=(COUNT, COUNT)) * 10.0 ** rng.uniform(-1, 1, COUNT)
    hessian = root.T @ root + 20 * np.eye(COUNT)
    return system, value, coupling, hessian, rng.normal(size=COUNT)


def whole(system, value, coupling, hessian, slope):
    """The bordered matrix (P + K, P + K), dense, and its right side."""
    mask = system.mask
    A = system.to_sparse().toarray()
    C = np.zeros((len(A), COUNT))
    units = np.zeros(mask.shape)
    for p, pixel in enumerate(zip(*np.nonzero(mask), strict=True)):
        units[pixel] = 1.0  # what the mean gradient sees of this pixel
        u, v = mean_gradient(units, mask)
        C[p] = np.einsum("hw,hwk->k", u, coupling[..., 0, :])
        C[p] += np.einsum("hw,hwk->k", v, coupling[..., 1, :])
        units[pixel] = 0.0
    right = np.concatenate([(system.rhs - system.apply(value))[mask], -slope])
    return np.block([[A, C], [C.T, hessian]]), right


MASKS = {"all": np.ones((9, 11), bool), "disc": disc(SIZE)}


@pytest.mark.parametrize("name", MASKS)
@pytest.mark.parametrize("damping", [0.0, 1e-3, 0.5])
def test_border_solves_the_whole_system(name, damping):
    system, value, coupling, hessian, slope = parts(MASKS[name])
    field, numbers = border(system, value, coupling, hessian, slope).step(damping)
    ridge = damping * np.diag(hessian) + 1e-9 * np.diag(hessian).mean()
    matrix, right = whole(system, value, coupling, hessian + np.diag(ridge), slope)
    assert np.linalg.eigvalsh(matrix).min() > 0
    expected = np.linalg.solve(matrix, right)
    np.testing.assert_allclose(field, expected[:-COUNT], atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(numbers, expected[-COUNT:], atol=1e-8 * np.abs(expected).max())
    # the coupling matters
    alone, _ = border(system, value, 0 * coupling, hessian, slope).step(damping)
    assert np.abs(field - alone).max() > 1e-3 * np.abs(field).max()


@pytest.mark.parametrize("name", ["holes", "thin", "dust", "lines"])
def test_border_on_masks_with_pixels_that_have_no_gradient(name):
    system, value, coupling, hessian, slope = parts(masks(24)[name])
    # the coupling of a pixel without a normal is not read
    u, v = (m @ np.arange(1.0, system.unknowns + 1) ** 2 for m in gradient_matrices(system.mask))
    lone = np.zeros(system.mask.shape, bool)
    lone[system.mask] = (u == 0) & (v == 0)
    assert lone.any()
    wild = np.where(lone[..., None, None], 1e9, coupling)
    one = border(system, value, coupling, hessian, slope).step(0.1)
    two = border(system, value, wild, hessian, slope).step(0.1)
    for each, other in zip(one, two, strict=True):
        assert np.isfinite(each).all()
        np.testing.assert_array_equal(each, other)


def test_a_step_from_the_solution_is_nought():
    system, value, coupling, hessian, slope = parts(disc(SIZE))
    field, numbers = border(system, value, coupling, hessian, slope).step(0.0)
    there = value.copy()
    there[system.mask] += field
    # moving the numbers changes the slopes: theirs by H, the field's right side by -C
    u, v = gradient_matrices(system.mask)
    along = coupling[system.mask]
    columns = u.T @ along[:, 0] + v.T @ along[:, 1]
    residual = (system.rhs - system.apply(there))[system.mask] - columns @ numbers
    assert np.abs(residual).max() < 1e-9 * np.abs(system.rhs).max()
    rest = -slope - columns.T @ field - hessian @ numbers
    assert np.abs(rest).max() < 1e-6 * np.abs(slope).max()


def test_damping_shortens_the_numbers_step():
    joint = border(*parts(disc(SIZE)))
    lengths = [np.linalg.norm(joint.step(damping)[1]) for damping in (0.0, 1.0, 100.0, 1e6)]
    assert (np.diff(lengths) < 0).all()
    assert lengths[-1] < 1e-4 * lengths[0]
    np.testing.assert_allclose(joint.step(1e12)[0], joint.field, atol=1e-9)


def test_a_number_that_nothing_determines_does_not_move():
    system, value, coupling, hessian, slope = parts(disc(SIZE))
    coupling[..., 2] = 0
    hessian[2] = hessian[:, 2] = slope[2] = 0
    joint = border(system, value, coupling, hessian, slope)
    for damping in (0.0, 0.1):
        field, numbers = joint.step(damping)
        assert abs(numbers[2]) < 1e-6 * np.abs(numbers).max()
        assert np.isfinite(field).all()


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


def test_scales_are_never_nought():
    scales = cauchy_scales(0.0, np.zeros((2, 2)))
    np.testing.assert_allclose(scales, CAUCHY * 1e-5, rtol=1e-12)


def test_cauchy_at_this_scale_is_95_percent_efficient():
    # Asymptotic efficiency of the location estimate on unit Gaussian noise: (E psi')^2 / E psi^2.
    r = np.linspace(-12, 12, 200_001)
    density = np.exp(-r * r / 2) / np.sqrt(2 * np.pi)
    q = (r / CAUCHY) ** 2
    slope = ((1 - q) / (1 + q) ** 2 * density).sum() * (r[1] - r[0])
    square = ((r / (1 + q)) ** 2 * density).sum() * (r[1] - r[0])
    assert slope**2 / square == pytest.approx(0.95, abs=5e-4)
