import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import rakelight
from rakelight.errors import InputError
from rakelight.metrics import (
    depth_error_map_mm,
    depth_errors,
    evaluate_depth,
    evaluate_maps,
    normal_error_map_deg,
    normal_errors,
)
from rakelight.model import Camera, Lights, Result, Truth

SIZE = (4, 5)
ALL = np.ones(SIZE, bool)
FACING = np.broadcast_to([0.0, 0.0, -1.0], (*SIZE, 3))

depths = arrays(float, SIZE, elements=st.floats(0.3, 2.0))
estimates = arrays(float, SIZE, elements=st.one_of(st.just(np.nan), st.floats(-1.0, 6.0)))
vectors = arrays(float, (*SIZE, 3), elements=st.floats(-1.0, 1.0))
dropped = arrays(bool, SIZE)


def scores(errors) -> list[float]:
    return [getattr(errors, name) for name in errors.__slots__ if name != "coverage"]


def test_known_depth_errors():
    truth = np.full(SIZE, 0.8)
    off = np.zeros(20)
    off[:2] = 0.004, -0.003
    errors = depth_errors(truth + off.reshape(SIZE), truth, ALL)
    assert errors.rmse_mm == pytest.approx(np.sqrt(25 / 20), rel=1e-9)
    assert errors.median_mm == 0
    # 19 steps between 20 values: the 95th percentile is a twentieth of the way to the last
    assert errors.p95_mm == pytest.approx(3 + 0.05 * (4 - 3), rel=1e-9)
    assert errors.coverage == 1


def test_known_normal_errors():
    tilted = FACING.copy()
    tilted[0, 0] = np.sin(0.3), 0, -np.cos(0.3)
    errors = normal_errors(tilted, FACING, ALL)
    assert errors.mae_deg == pytest.approx(np.degrees(0.3) / 20, rel=1e-12)
    assert errors.median_deg == 0


def test_small_angles_keep_their_digits():
    tilted = FACING.copy()
    tilted[..., 0] = 1e-9
    errors = normal_errors(tilted, FACING, ALL)
    assert errors.mae_deg == pytest.approx(np.degrees(1e-9), rel=1e-9)


@settings(max_examples=200, deadline=None)
@given(estimates, depths, dropped)
def test_missing_depth_never_improves_a_score(estimate, truth, missing):
    before = depth_errors(estimate, truth, ALL)
    after = depth_errors(np.where(missing, np.nan, estimate), truth, ALL)
    assert all(b >= a for a, b in zip(scores(before), scores(after), strict=True))
    assert after.coverage <= before.coverage


@settings(max_examples=200, deadline=None)
@given(vectors, vectors, dropped)
def test_missing_normals_never_improve_a_score(estimate, truth, missing):
    truth[~truth.any(axis=-1)] = 0, 0, -1
    before = normal_errors(estimate, truth, ALL)
    after = normal_errors(np.where(missing[..., None], np.nan, estimate), truth, ALL)
    assert all(b >= a for a, b in zip(scores(before), scores(after), strict=True))
    assert after.coverage <= before.coverage


@settings(max_examples=100, deadline=None)
@given(estimates, depths, dropped, st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -0.5]))
def test_every_way_to_leave_a_pixel_out_costs_the_same(estimate, truth, missing, nothing):
    one = depth_errors(np.where(missing, np.nan, estimate), truth, ALL)
    other = depth_errors(np.where(missing, nothing, estimate), truth, ALL)
    assert one == other


@settings(max_examples=100, deadline=None)
@given(estimates, depths, dropped)
def test_only_the_mask_counts(estimate, truth, mask):
    mask[0, 0] = True
    elsewhere = np.where(mask, estimate, 123.0)
    assert depth_errors(estimate, truth, mask) == depth_errors(elsewhere, truth, mask)


@settings(max_examples=100, deadline=None)
@given(depths, depths, st.floats(0.1, 1.0))
def test_smaller_errors_score_better(estimate, truth, share):
    nearer = truth + share * (estimate - truth)
    far, near = (scores(depth_errors(z, truth, ALL)) for z in (estimate, nearer))
    assert all(n <= f * (1 + 1e-9) + 1e-9 for n, f in zip(near, far, strict=True))


def test_a_missing_pixel_is_charged_a_tenth_of_the_depth_and_180_degrees():
    depth, normals = np.full(SIZE, 0.8), FACING.copy()
    depth[1, 1] = normals[1, 1] = np.nan
    truth = Truth(np.full(SIZE, 0.8), FACING, np.ones((*SIZE, 3)))
    scored = evaluate_maps(depth, normals, truth)
    assert scored.depth.rmse_mm == pytest.approx(80 / np.sqrt(20), rel=1e-9)
    assert scored.normals.mae_deg == pytest.approx(180 / 20, rel=1e-12)
    assert scored.depth.coverage == scored.normals.coverage == 0.95


def test_the_mask_is_the_truths_and_never_the_estimates():
    truth_depth = np.full(SIZE, 0.8)
    truth_depth[0] = np.nan
    truth = Truth(truth_depth, np.where(ALL[..., None], FACING, 0), np.ones((*SIZE, 3)))
    only_one = np.full(SIZE, np.nan)
    only_one[2, 2] = 0.8
    assert evaluate_maps(only_one, FACING, truth).depth.coverage == pytest.approx(1 / 15)


def test_maps_hold_the_scored_errors():
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.7, 0.9, SIZE)
    depth = truth + rng.normal(0, 0.003, SIZE)
    mask = rng.random(SIZE) < 0.7
    errors = depth_error_map_mm(depth, truth, mask)
    assert np.array_equal(np.isnan(errors), ~mask)
    assert depth_errors(depth, truth, mask).rmse_mm == np.sqrt(np.mean(errors[mask] ** 2))
    normals = FACING + rng.normal(0, 0.2, (*SIZE, 3))
    angles = normal_error_map_deg(normals, FACING, mask)
    assert np.array_equal(np.isnan(angles), ~mask)
    assert normal_errors(normals, FACING, mask).mae_deg == np.mean(angles[mask])


def test_lengths_of_normals_do_not_matter():
    normals = np.broadcast_to([0.3, 0.1, -1.0], (*SIZE, 3))
    whole = normal_errors(normals, FACING, ALL).mae_deg
    assert normal_errors(1e-200 * normals, 1e10 * FACING, ALL).mae_deg == pytest.approx(whole)
    assert whole == pytest.approx(np.degrees(np.arctan(np.hypot(0.3, 0.1))))


@pytest.mark.parametrize(
    ("depth", "truth", "mask", "words"),
    [
        (np.ones((4, 4)), np.ones(SIZE), ALL, "different size"),
        (np.ones(SIZE), np.ones(SIZE), np.ones((4, 4), bool), "different size"),
        (np.ones(SIZE), np.ones(SIZE), ~ALL, "marks no pixel"),
        (np.ones(SIZE), np.ones(SIZE), ALL.astype(np.uint8), "not a mask"),
        (np.ones(SIZE), np.full(SIZE, np.nan), ALL, "beyond the truth"),
    ],
)
def test_wrong_input(depth, truth, mask, words):
    with pytest.raises(InputError, match=words):
        depth_errors(depth, truth, mask)


def test_normals_of_another_size():
    with pytest.raises(InputError, match="different size"):
        normal_errors(FACING[:2], FACING, ALL)


@pytest.mark.parametrize("bad", [None, [[1.0]], np.full(SIZE, "x"), np.ones(SIZE, complex), 3.0])
def test_what_is_no_array_of_numbers(bad):
    flat = Truth(np.ones(SIZE), np.ones((*SIZE, 3)), np.ones((*SIZE, 3)))
    for depth, normals, truth in (
        (bad, flat.normals, flat),
        (flat.depth, bad, flat),
        (flat.depth, flat.normals, Truth(bad, flat.normals, flat.albedo)),
        (flat.depth, flat.normals, bad),
    ):
        with pytest.raises(InputError, match="is no"):
            evaluate_maps(depth, normals, truth)
    with pytest.raises(InputError, match="mask"):
        evaluate_maps(flat.depth, flat.normals, flat, mask=[[True]])


def a_result(depth, normals):
    flat = np.ones(SIZE)
    lights, camera = Lights(FACING, flat), Camera(SIZE[1], SIZE[0], 9.0, 9.0, 2.0, 1.5)
    return Result(depth, normals, np.ones((*SIZE, 3)), flat, lights, camera, flat, "none")


def a_truth():
    return Truth(np.full(SIZE, 0.8), FACING.copy(), np.ones((*SIZE, 3)))


def test_a_result_is_scored_by_its_maps():
    truth = a_truth()
    tilted = FACING.copy()
    tilted[0, 0] = 0, np.sin(0.2), -np.cos(0.2)
    depth = truth.depth + 0.002
    depth[1, 1] = np.nan
    scores = rakelight.evaluate(a_result(depth, tilted), truth)
    assert scores == evaluate_maps(depth, tilted, truth)
    assert scores.depth.rmse_mm == pytest.approx(np.sqrt((19 * 2.0**2 + 80.0**2) / 20))
    assert scores.normals.mae_deg == pytest.approx(np.degrees(0.2) / 20)
    assert scores.depth.coverage == 0.95
    only = np.zeros(SIZE, bool)
    only[2:] = True
    assert rakelight.evaluate(a_result(depth, tilted), truth, only).depth.rmse_mm == pytest.approx(
        2
    )


@pytest.mark.parametrize(
    ("result", "truth", "words"),
    [
        (np.ones(SIZE), a_truth(), r"no Result .*Fix: give what rakelight\.refine"),
        (a_truth(), a_result(np.ones(SIZE), FACING), "no Result .seen Truth"),
        (a_result(np.ones(SIZE), FACING), np.ones(SIZE), r"no Truth .*rakelight\.load_truth"),
        (a_result(np.ones((2, 2)), FACING), a_truth(), "different size .*truth's resolution"),
    ],
)
def test_what_cannot_be_scored(result, truth, words):
    with pytest.raises(InputError, match=words) as refused:
        rakelight.evaluate(result, truth)
    assert refused.value.needed


def test_depth_beside_the_truth_does_not_count():
    camera = Camera(6, 6, fx=100.0, fy=100.0, cx=2.5, cy=2.5)
    depth = np.ones((6, 6))
    depth[:, 3:] = 1.02
    true_depth = np.where(np.arange(6) < 3, 1.0, np.nan) + np.zeros((6, 1))
    inside = np.isfinite(true_depth)[..., None]
    normals = np.where(inside, [0.0, 0.0, -1.0], np.nan)
    truth = Truth(true_depth, normals, np.where(inside, np.ones((6, 6, 3)), 0))
    assert evaluate_depth(depth, camera, truth).normals.mae_deg == 0.0
