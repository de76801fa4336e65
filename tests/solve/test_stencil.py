import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.solve import _kernels, assemble, solve
from rakelight.solve.stencil import NEGLIGIBLE
from tests.solve.exact import matrix, solution
from tests.solve.plain_stencil import PAIRS, gradient_stencil, reached
from tests.solve.rough_systems import masks, rough


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def energy(p, problem, pairs, lam, aim):
    """E(p), pixel by pixel, as it is written at the top of stencil.py."""
    mask, total = problem.mask, 0.0

    def inside(r, c):
        return 0 <= r < mask.shape[0] and 0 <= c < mask.shape[1] and mask[r, c]

    for r, c in np.argwhere(mask):
        total += problem.weight[r, c] * (p[r, c] - problem.target[r, c]) ** 2
        (uu, uv, vv), terms = problem.tensor[r, c], []
        for k, (su, sv) in enumerate(PAIRS):
            if inside(r, c + su) and inside(r + sv, c):
                d = np.array([su * (p[r, c + su] - p[r, c]), sv * (p[r + sv, c] - p[r, c])])
                quadratic = d @ np.array([[uu, uv], [uv, vv]]) @ d
                terms.append(pairs[r, c, k] * (quadratic - 2 * problem.vector[r, c] @ d))
        total += np.mean(terms) if terms else 0.0
        laplace = 0.0
        for dr, dc in ((0, 1), (1, 0)):
            if inside(r + dr, c + dc) and inside(r - dr, c - dc):
                laplace += p[r + dr, c + dc] - 2 * p[r, c] + p[r - dr, c - dc]
        total += lam[r, c] * (laplace - aim[r, c]) ** 2
    return total


def test_gradient_of_the_energy(rng):
    shape = (7, 6)
    problem = rough(*shape, mask=rng.random(shape) < 0.8)
    pairs, lam, aim, p = rng.random((*shape, 4)), rng.random(shape), *rng.normal(size=(2, *shape))
    system = problem.system(pair_weights=pairs, laplacian_weight=lam, laplacian_target=aim)
    gradient = 2 * (system.apply(p) - system.rhs)
    for r, c in np.argwhere(problem.mask):
        step = np.zeros(shape)
        step[r, c] = 1e-3
        up, down = (energy(q, problem, pairs, lam, aim) for q in (p + step, p - step))
        assert (up - down) / 2e-3 == pytest.approx(gradient[r, c], rel=1e-7, abs=1e-7)
    assert not gradient[~problem.mask].any()


@pytest.mark.parametrize("name", masks(8))
def test_compiled_assembly_is_the_plain_one(name, rng):
    mask = masks(41)[name][:, :33]
    problem = rough(41, 33, mask=mask)
    pairs = rng.random((41, 33, 4))
    plain, plain_rhs = gradient_stencil(mask, problem.tensor, problem.vector, pairs)
    system = problem.system(pair_weights=pairs)
    pinned_or_data = system.centre - plain[0, 1:-1, 1:-1]
    np.testing.assert_allclose(system.stencil[1:], plain[1:], rtol=0, atol=1e-14)
    np.testing.assert_allclose(pinned_or_data, np.where(mask, problem.weight, 0), atol=1e-13)
    expected = plain_rhs[1:-1, 1:-1] + np.where(mask, problem.weight * problem.target, 0)
    np.testing.assert_allclose(system.rhs, expected, atol=1e-13)


def test_compiled_reach_is_the_plain_one(rng):
    for mask in masks(40).values():
        plain, _ = gradient_stencil(mask, rough(40, 40).tensor, np.zeros((40, 40, 2)))
        anchors = np.pad(mask & (rng.random((40, 40)) < 0.02), 1)
        out, stack = anchors.copy(), np.empty((np.count_nonzero(mask), 2), np.int32)
        _kernels.mark_connected(plain, NEGLIGIBLE, out, stack)
        np.testing.assert_array_equal(out, reached(plain, anchors, NEGLIGIBLE))


def test_matrix_and_apply_agree(rng):
    for mask in masks(24).values():
        problem = rough(24, 24, mask=mask)
        system = problem.system(laplacian_weight=0.3)
        x, y = rng.normal(size=(2, 24, 24))
        ax = system.apply(x)
        np.testing.assert_allclose(matrix(system) @ x[mask], ax[mask], atol=1e-12)
        # Symmetric: <A x, y> = <x, A y>.
        assert (ax * y)[mask].sum() == pytest.approx((x * system.apply(y))[mask].sum(), rel=1e-12)


def test_right_side_is_the_adjoint_of_the_differences(rng):
    """<rhs, p> of b = M g equals <A p, q> when g are the differences of a plane q."""
    row, column = np.mgrid[:9, :11]
    problem = rough(9, 11)
    plane = 0.3 * column - 0.7 * row
    m = problem.tensor
    problem.vector = np.stack(
        [0.3 * m[..., 0] - 0.7 * m[..., 1], 0.3 * m[..., 1] - 0.7 * m[..., 2]], axis=-1
    )
    problem.target = plane
    system = problem.system()
    p = rng.normal(size=plane.shape)
    assert (system.rhs * p).sum() == pytest.approx((system.apply(p) * plane).sum(), rel=1e-11)


def test_a_plane_comes_back_from_its_own_gradients():
    mask = masks(40)["disc"]
    row, column = np.mgrid[:40, :40]
    plane = 2.0 + 0.04 * column - 0.025 * row
    weight = np.where((row == 20) & (column == 20), 1.0, 0.0)
    gradient = np.broadcast_to([0.04, -0.025], (40, 40, 2))
    identity = np.broadcast_to([1.0, 0.0, 1.0], (40, 40, 3))
    target = np.where(weight > 0, plane, 0.0)
    system = assemble(mask, identity, gradient, weight, target)
    for found in (solution(system), solve(system, tolerance=1e-12).value):
        np.testing.assert_allclose(found[mask], plane[mask], atol=1e-8)


def test_no_checkerboard_and_no_half_pixel_shift():
    """The stiffest modes are stiff, and a ridge stays on its own column."""
    size = 16
    shape, identity = (size, size), np.broadcast_to([1.0, 0.0, 1.0], (size, size, 3))
    none = np.zeros(shape)
    system = assemble(np.ones(shape, bool), identity, np.zeros((*shape, 2)), none + 1e-9, none)
    row, column = np.indices(shape)
    for pattern in ((-1.0) ** (row + column), (-1.0) ** row, (-1.0) ** column):
        assert (pattern * system.apply(pattern)).sum() > 0.9 * pattern.size
    eigenvalues = np.linalg.eigvalsh(system.to_sparse().toarray())
    assert np.count_nonzero(eigenvalues < 1e-3) == 1
    # A gradient that is odd about a column makes a surface that is even about it.
    ridge = np.zeros((15, 15, 2))
    ridge[..., 0] = np.sign(7 - np.arange(15))
    system = assemble(
        np.ones((15, 15), bool), identity[:15, :15], ridge, np.full((15, 15), 1e-3),
        np.zeros((15, 15)),
    )  # fmt: skip
    value = solution(system)
    np.testing.assert_allclose(value, value[:, ::-1], atol=1e-9)


def test_what_no_data_reaches_is_held_at_its_target():
    mask = np.zeros((12, 20), bool)
    mask[1:6, 1:9] = True  # with data
    mask[1:6, 11:19] = True  # without
    mask[8, 1:19] = True  # one pixel wide: no gradients
    mask[10, 10] = True
    weight = np.zeros(mask.shape)
    weight[3, 3] = 0.5
    target = np.arange(240.0).reshape(12, 20)
    tensor, vector = np.ones((12, 20, 3)) * [2, 0, 1], np.zeros((12, 20, 2))
    system = assemble(mask, tensor, vector, weight, target)
    expected = mask.copy()
    expected[1:6, 1:9] = False
    np.testing.assert_array_equal(system.pinned, expected)
    solved = solve(system, tolerance=1e-10)
    assert solved.status == "converged"
    for value in (solution(system), solved.value):
        np.testing.assert_allclose(value[8, 1:19], target[8, 1:19], rtol=1e-9)
        assert value[10, 10] == pytest.approx(target[10, 10], rel=1e-9)
        assert np.ptp(value[1:6, 1:9]) < 1e-5
        assert value[2, 2] == pytest.approx(target[3, 3], rel=1e-6)
        part = np.s_[1:6, 11:19]
        assert value[part].mean() == pytest.approx(target[part].mean(), rel=1e-4)
        assert np.ptp(value[part]) < 1e-4 * np.ptp(target[part])


def test_robust_pair_weights_do_not_bridge_a_jump():
    """A step between two columns survives flat gradients once its pairs weigh nothing."""
    shape = (10, 12)
    step = np.where(np.arange(12) < 6, 1.0, 2.0) + np.zeros(shape)
    pairs = np.ones((*shape, 4))
    pairs[:, 5, :2] = 0  # (+u, .) of the last low column
    pairs[:, 6, 2:] = 0  # (-u, .) of the first high column
    flat = np.broadcast_to([1.0, 0.0, 1.0], (*shape, 3)), np.zeros((*shape, 2))
    system = assemble(np.ones(shape, bool), *flat, np.full(shape, 1e-3), step, pairs)
    np.testing.assert_allclose(solve(system, tolerance=1e-10).value, step, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("tensor", lambda a: a[..., :2], "wrong shape"),
        ("tensor", lambda a: a * [1, 9, 1], "semidefinite"),
        ("vector", lambda a: a * np.nan, "not finite"),
        ("weight", lambda a: -a, "negative"),
        ("target", lambda a: a + np.inf, "not finite"),
        ("mask", lambda a: a.astype(int), "not a mask"),
        ("mask", np.zeros_like, "empty"),
    ],
)
def test_bad_input_is_named(name, change, message):
    problem = rough(5, 5)
    setattr(problem, name, change(getattr(problem, name)))
    with pytest.raises(InputError, match=message):
        problem.system()


def test_values_outside_the_mask_are_ignored():
    mask = masks(20)["disc"]
    clean, dirty = rough(20, 20, mask=mask), rough(20, 20, mask=mask)
    for array in (dirty.tensor, dirty.vector, dirty.weight, dirty.target):
        array[~mask] = np.nan
    np.testing.assert_array_equal(clean.system().stencil, dirty.system().stencil)
    np.testing.assert_array_equal(clean.system().rhs, dirty.system().rhs)
    solution = solve(dirty.system())
    assert np.isfinite(solution.value[mask]).all()
    assert solution.status == "converged"
