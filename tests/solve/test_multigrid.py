from dataclasses import replace

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.geometry.grid import mean_gradient
from rakelight.jit import limited_threads
from rakelight.solve import _kernels as kernels
from rakelight.solve import assemble, build_hierarchy, multigrid, solve
from rakelight.solve.multigrid import laplacian_surrogate
from rakelight.solve.sparse import stencil_matrix
from tests.solve.exact import laplacian_matrix, solution
from tests.solve.rough_systems import disc, masks, rough


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.mark.parametrize("name", masks(8))
@pytest.mark.parametrize("options", [{}, {"anisotropy": 1e6, "direction": 0.5}, {"decades": 3}])
def test_same_answer_as_the_factorisation(name, options):
    system = rough(90, 90, mask=masks(90)[name], **options).system()
    exact = solution(system)
    fast = solve(system, tolerance=1e-9, max_iterations=300)
    assert fast.status == "converged"
    assert np.linalg.norm(fast.value - exact) < 1e-5 * np.linalg.norm(exact)


def _operator(system):
    """The preconditioner as a dense matrix over the unknowns."""
    hierarchy = build_hierarchy(system)
    columns = []
    for r, c in np.argwhere(np.pad(system.mask[hierarchy.window], 1)):
        unit = np.zeros(hierarchy.levels[0].x.shape)
        unit[r, c] = 1
        z = hierarchy.precondition(unit, 1.0)[1:-1, 1:-1]
        columns.append(z[system.mask[hierarchy.window]].astype(float))
    return np.array(columns), hierarchy


@pytest.mark.parametrize("name", ["disc", "holes", "thin", "parts"])
def test_cycle_is_symmetric_and_positive_definite(name, monkeypatch):
    monkeypatch.setattr(multigrid, "COARSEST", 20)
    system = rough(25, 22, mask=masks(25)[name][:, :22]).system()
    B, hierarchy = _operator(system)
    assert len(hierarchy.levels) > 2
    assert np.abs(B - B.T).max() < 2e-6 * np.abs(B).max()
    # Near the inverse of A: with A = C Cᵀ the iterations hang on the spectrum of Cᵀ B C.
    C = np.linalg.cholesky(system.to_sparse().toarray())
    eigenvalues = np.linalg.eigvalsh(C.T @ (B + B.T) @ C / 2)
    assert eigenvalues.min() > 0.1
    assert eigenvalues.max() < 1 + 1e-4


def test_cycle_is_symmetric_on_a_large_grid(rng):
    system = rough(150, 170, mask=None).system()
    hierarchy = build_hierarchy(system)
    x, y = np.pad(rng.normal(size=(2, 150, 170)), ((0, 0), (1, 1), (1, 1)))
    bx, by = (hierarchy.precondition(v, np.linalg.norm(v)).astype(float) for v in (x, y))
    assert (bx * y).sum() == pytest.approx((x * by).sum(), rel=1e-4)


@pytest.mark.parametrize("size", [64, 128, 256, 512, 1024])
def test_iterations_do_not_grow_with_size(size):
    solution = solve(rough(size, size, mask=disc(size)).system())
    assert solution.status == "converged"
    assert solution.iterations <= 9


@pytest.mark.parametrize(("name", "most"), [("holes", 22), ("thin", 20), ("parts", 14)])
def test_iterations_on_ragged_masks(name, most):
    solution = solve(rough(400, 400, mask=masks(400)[name]).system())
    assert solution.status == "converged"
    assert solution.iterations <= most


@pytest.mark.parametrize("direction", [0.0, 0.5, np.pi / 4, np.pi / 2])
def test_iterations_on_one_light_only(direction):
    """One photograph gives tensors of rank one, all in the same direction."""
    problem = rough(300, 300, anisotropy=1e9, decades=1, direction=direction)
    problem.weight[:] = 1e-2
    solution = solve(problem.system())
    assert solution.status == "converged"
    assert solution.iterations <= 20


def test_weak_anchors_far_away(rng):
    """Rows that hang on one pixel each, 400 pixels away, through differences along u alone."""
    problem = rough(40, 400)
    problem.tensor[:] = [1.0, 0.0, 0.0]
    problem.weight[:] = 0
    problem.weight[:, 0] = 1
    system = problem.system()
    exact, fast = solution(system), solve(system, tolerance=1e-9)
    assert fast.status == "converged"
    assert np.abs(fast.value - exact).max() < 1e-4 * np.abs(exact).max()


def islands(strength, seed=0):
    """Few pixels know a gradient: parts of some pixels each, held by weak data only."""
    problem = rough(60, 60, seed=seed)
    unknown = np.random.default_rng(seed).random((60, 60)) < 0.85
    problem.tensor[unknown] = problem.vector[unknown] = problem.tensor[..., 1] = 0
    centre = replace(problem, weight=np.zeros((60, 60))).system().centre
    problem.weight = strength * np.where(centre > 0, centre, centre.mean())
    return problem.system()


@pytest.mark.parametrize("strength", [1e-4, 1e-7, 2e-8])
def test_islands_that_hang_on_weak_data(strength):
    system = islands(strength)
    assert not system.pinned.any()
    assert solve(system).status == "converged"


@pytest.mark.parametrize("strength", [1e-4, 2e-8])
def test_every_level_stays_positive_definite(strength, monkeypatch):
    monkeypatch.setattr(multigrid, "COARSEST", 20)
    levels = build_hierarchy(islands(strength)).levels
    assert len(levels) > 3
    for level in levels:
        inside = level.stencil[0] > 0
        assert not level.stencil[:, ~inside].any()
        matrix = stencil_matrix(level.stencil.astype(float), inside).toarray()
        np.linalg.cholesky(matrix)  # raises of any other, and is quicker than eigenvalues


def test_single_precision_is_never_below_double():
    stencil = np.pad(islands(2e-8).stencil[:, 1:-1, 1:-1], ((0, 0), (1, 1), (1, 1)))
    single = np.zeros(stencil.shape, np.float32)
    kernels.rounded_up(1, stencil.shape[1] - 1, stencil, single)
    np.testing.assert_allclose(single, stencil, rtol=2e-6)
    gain = stencil_matrix(single - stencil, stencil[0] > 0).toarray()
    assert np.abs(gain - np.diag(np.diag(gain))).sum() > 0
    assert (2 * np.diag(gain) >= np.abs(gain).sum(axis=1)).all()  # diagonally dominant


def test_weights_as_far_apart_as_double_precision_goes():
    problem = rough(12, 12)
    problem.weight[:, :6] = 1e-60
    problem.tensor[:, :6] = problem.vector[:, :6] = 0
    system = problem.system()
    assert not system.pinned.any()
    solution = solve(system)
    assert solution.status == "converged"
    np.testing.assert_allclose(solution.value[:, :5], problem.target[:, :5])


def test_a_matrix_that_is_not_positive_definite_is_refused():
    system = rough(12, 12).system()
    for change in (-system.stencil[0], -3 * system.stencil[0], 3 * system.stencil[1]):
        stencil = system.stencil.copy()
        stencil[0] += change
        with pytest.raises(InputError, match="not positive definite"):
            build_hierarchy(replace(system, stencil=stencil))


def test_a_hierarchy_serves_close_systems_too():
    problem = rough(120, 120)
    hierarchy = build_hierarchy(problem.system())
    problem.tensor *= 1 + 0.2 * np.random.default_rng(3).random((120, 120, 1))
    system = problem.system()
    own, shared = solve(system, tolerance=1e-9), solve(system, tolerance=1e-9, hierarchy=hierarchy)
    assert shared.iterations <= own.iterations + 3
    np.testing.assert_allclose(shared.value, own.value, atol=1e-6 * np.abs(own.value).max())
    with pytest.raises(InputError, match="another mask"):
        solve(rough(120, 120, mask=disc(120)).system(), hierarchy=hierarchy)


def test_a_good_start_saves_iterations():
    system = rough(120, 120).system()
    first = solve(system, tolerance=1e-8)
    again = solve(system, start=first.value + 1e-6, tolerance=1e-6)
    assert again.iterations < solve(system, tolerance=1e-6).iterations
    assert solve(system, start=first.value, tolerance=1e-6).iterations == 0


def test_scale_of_the_system_does_not_matter():
    """Photometric weights and depth steps can be tiny: single precision must not feel it."""
    problem = rough(100, 100)
    plain = solve(problem.system())
    for factor in (1e-25, 1e25):
        scaled = rough(100, 100)
        for name in ("tensor", "vector", "weight"):
            setattr(scaled, name, getattr(problem, name) * factor)
        solution = solve(scaled.system())
        assert solution.iterations == plain.iterations
        np.testing.assert_allclose(solution.value, plain.value, rtol=1e-5, atol=1e-6)


def test_two_runs_give_the_same_numbers():
    system = rough(200, 210).system()
    np.testing.assert_array_equal(solve(system).value, solve(system).value)


def test_result_does_not_depend_on_the_number_of_threads():
    system = rough(200, 210).system()
    many = solve(system).value
    with limited_threads(1):
        np.testing.assert_array_equal(solve(system).value, many)


@pytest.mark.parametrize(("strength", "most"), [(0.01, 16), (0.1, 25), (1.0, 60)])
def test_laplacian(strength, most):
    system = rough(90, 90, mask=disc(90)).system(laplacian_weight=strength)
    exact, fast = solution(system), solve(system, tolerance=1e-9)
    assert fast.status == "converged"
    assert np.linalg.norm(fast.value - exact) < 1e-5 * np.linalg.norm(exact)
    assert fast.iterations <= most


def test_laplacian_surrogate_is_a_bound():
    mask = masks(14)["holes"]
    system = rough(14, 14, mask=mask).system(laplacian_weight=0.7)
    exact = laplacian_matrix(system.laplacian, mask).toarray()
    bound = stencil_matrix(laplacian_surrogate(system.laplacian), np.pad(mask, 1)).toarray()
    assert np.linalg.eigvalsh(bound - exact).min() > -1e-12


class BlockMeans:
    """K^T W K of super-resolution: K averages blocks of n x n pixels."""

    def __init__(self, n, weight):
        self.n, self.weight = n, weight

    def apply(self, x):
        h, w = x.shape
        means = x.reshape(h // self.n, self.n, w // self.n, self.n).mean(axis=(1, 3))
        return np.kron(self.weight * means, np.ones((self.n, self.n))) / self.n**2

    def diagonal(self):
        return np.kron(self.weight, np.ones((self.n, self.n))) / self.n**2


def test_extra_operator_carries_the_data(rng):
    """Super-resolution: no pixel has data of its own, every block of 4 x 4 has."""
    truth = np.cumsum(np.cumsum(rng.normal(size=(80, 96)), 0), 1) / 1000
    operator = BlockMeans(4, np.full((20, 24), 50.0))
    problem = rough(80, 96)
    problem.weight[:] = 0
    system = problem.system(extra=operator, extra_rhs=operator.apply(truth))
    assert not system.pinned.any()
    solution = solve(system, tolerance=1e-9)
    assert solution.status == "converged"
    assert solution.iterations <= 60
    residual = system.rhs - system.apply(solution.value)
    assert np.linalg.norm(residual) < 1e-8 * np.linalg.norm(system.rhs)
    with pytest.raises(InputError, match="without wider terms"):
        system.to_sparse()


def shared(links):
    """Blocks of 4 x 4 have a mean each, and pixels the difference pairs that `links` names."""
    operator, problem = BlockMeans(4, np.full((5, 5), 1e-4)), rough(20, 20)
    problem.weight[:] = problem.target[:] = 0
    means = operator.apply(np.ones((20, 20)))
    return problem.system(extra=operator, extra_rhs=means, pair_weights=links)


def test_parts_that_share_a_measurement_do_not_float_against_each_other():
    left = np.indices((20, 20))[1] % 2 == 0
    links = np.stack([left, left, ~left, ~left], axis=-1).astype(float)  # strips of two columns
    system = shared(links)
    assert not system.pinned.any()
    against = np.where(np.indices((20, 20))[1] % 4 < 2, 1.0, -1.0)  # each block's mean is 0
    assert (against * system.apply(against)).sum() > 1e-9
    assert solve(system).status == "converged"


def test_a_pixel_without_gradient_keeps_its_target_whatever_its_block_means():
    links = np.ones((20, 20, 4))
    links[4:8, 4:8] = 0
    system = shared(links)
    lonely = np.zeros((20, 20), bool)
    lonely[5:7, 5:7] = True
    np.testing.assert_array_equal(system.pinned, lonely)
    solution = solve(system)
    assert solution.status == "converged"
    assert np.abs(solution.value[lonely]).max() < 1e-3


def test_status_tells_the_truth():
    system = rough(60, 60).system()
    assert solve(system, max_iterations=2).status == "iteration limit"
    assert solve(system, tolerance=1e-30, max_iterations=500).status == "stalled"
    with pytest.raises(InputError, match="tolerance"):
        solve(system, tolerance=0.0)
    with pytest.raises(InputError, match="start"):
        solve(system, start=np.full((60, 60), np.nan))


def test_a_small_change_is_solved_to_a_share_of_itself():
    mask, column = np.ones((40, 40), bool), np.arange(40.0)
    plane = np.full(mask.shape, 3.0)  # log depth: of the whole, relief is a share of 1e-4
    relief = np.broadcast_to(3e-4 * np.sin(column / 5), mask.shape)
    slope = np.stack(mean_gradient(relief, mask), axis=-1)
    tensor, weight = np.broadcast_to([1.0, 0.0, 1.0], (*mask.shape, 3)), np.full(mask.shape, 0.03)
    system = assemble(mask, tensor, slope, weight, plane)
    exact = solution(system) - plane
    assert np.abs(exact).max() > 1e-4

    kept = solve(system, start=plane, tolerance=1e-3)
    assert (kept.status, kept.iterations) == ("converged", 0)
    found = solve(system, start=plane, origin=plane, tolerance=1e-3)
    assert found.status == "converged"
    assert found.relative_residual <= 1e-3
    assert np.linalg.norm(found.value - plane - exact) < 1e-2 * np.linalg.norm(exact)
    with pytest.raises(InputError, match="origin"):
        solve(system, origin=plane[1:])


def test_smallest_systems():
    for shape in ((1, 1), (1, 7), (2, 2), (3, 2)):
        problem = rough(*shape)
        system = problem.system()
        exact = solution(system)
        np.testing.assert_allclose(solve(system, tolerance=1e-10).value, exact, rtol=1e-7)


def test_interpolation_stays_bounded_where_couplings_cancel(rng):
    # Needles and weak links give couplings of both signs, whose ratios know no bound.
    stencil = np.zeros((5, 42, 42))
    stencil[:, 1:-1, 1:-1] = rng.uniform(-1, 1, (5, 40, 40))
    stencil[0, 1:-1, 1:-1] = 4
    weights = np.zeros((42, 42, 4), np.float32)
    kernels.interpolation(1, 41, stencil, weights)
    kernels.interpolation_amid_four(0, 20, stencil, weights)
    np.testing.assert_allclose(weights[1:-1, 1:-1].sum(axis=-1), 1, atol=1e-4)
    assert weights.min() >= -1
    assert weights.max() <= 4
