"""The RGB ratio model: what it gains, that it does no harm, and what it warns of."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rakelight.errors import InputError
from rakelight.geometry.normals import surface_normals
from rakelight.methods.levels import first_photograph
from rakelight.methods.rgb_ratio import RgbRatio, alternated, depth_weight_from_change, rgb_ratio
from rakelight.methods.rgb_ratio.lights import arriving_lights
from rakelight.methods.rgb_ratio.ratios import Ratios
from rakelight.metrics import evaluate_maps
from rakelight.model import silent
from rakelight.paper.scenes import paper_object, paper_scene
from rakelight.photometry.color_modes import nearest_colors
from rakelight.prepare import prepare
from rakelight.synthetic import (
    DepthNoise,
    SceneOptions,
    make_albedo,
    make_shape,
    random_capture,
    render_scene,
)
from tests.solve.stalling import stalling_solver

BUST = paper_object()
OPTIONS = SceneOptions(
    lighting="rgb-leds",
    camera=make_shape("sphere").camera.scaled(0.2),
    depth_noise=DepthNoise(rms_mm=2.0, correlation_length_px=6.0),
    image_noise=0.003,
)


@cache
def scene(paint="simple", **changes):
    return render_scene(make_shape("sphere"), make_albedo(paint), replace(OPTIONS, **changes))


@cache
def refined(paint="simple", **changes):
    return rgb_ratio(prepare(scene(paint, **changes)[0]), RgbRatio(), silent)


def scores(prepared, log_depth, truth):
    depth = np.exp(log_depth)
    normals = surface_normals(depth, prepared.mask, prepared.camera)
    found = evaluate_maps(prepared.embed(depth, np.nan), prepared.embed(normals, np.nan), truth)
    return np.array([found.depth.rmse_mm, found.normals.mae_deg])


def codes(capture):
    options = RgbRatio(max_iterations=0)
    return [finding.code for finding in rgb_ratio(prepare(capture), options, silent).findings]


def changed(capture, change):
    """The capture with its photographs, as fractions of white, changed."""
    values = np.clip(change(capture.photographs / capture.white), 0, 1)
    return replace(capture, photographs=np.round(values * capture.white).astype(np.uint16))


# ---- depth


# Of the error before, 1.02 being no harm: a quarter of the size leaves little to gain.
@pytest.mark.parametrize(
    ("paint", "size", "most"),
    [
        ("simple", 0.5, (0.92, 0.82)),
        ("simple", 0.25, (1.02, 0.96)),
        ("pattern", 0.25, (1.02, 1.0)),
        ("complicated", 0.25, (1.02, 1.02)),
    ],
)
def test_the_bust_gains_normals_and_keeps_its_depth(paint, size, most):
    capture, truth = paper_scene(paint, "rgb-leds", size, BUST)
    prepared = prepare(capture)
    before = scores(prepared, np.log(prepared.depth_m), truth)
    after = scores(prepared, rgb_ratio(prepared, RgbRatio(), silent).log_depth, truth)
    assert (after <= before * most).all(), (before, after)


def test_the_truth_meets_the_ratio_equations():
    capture, truth = scene(depth_noise=DepthNoise(rms_mm=0.0), image_noise=0.0)
    prepared = prepare(capture)
    window = np.s_[prepared.rows, prepared.columns]
    light = np.concatenate([truth.lights.vector[0], truth.lights.ambient[0][:, None]], axis=1)
    level = first_photograph(prepared)
    arriving = arriving_lights(level, light, 0.0)
    ratios = Ratios(level.image, level.shaded, 1.0, truth.albedo[window].astype(float), arriving)
    normals = np.nan_to_num(truth.normals[window].astype(float))
    squares = ratios.squares(normals)[prepared.mask]
    assert np.isfinite(squares).mean() > 0.5
    # Sixteen bits, and pixels that are averages.
    assert np.sqrt(np.nanmedian(squares)) < 5e-4


def test_no_round_leaves_the_prepared_depth_alone():
    prepared = prepare(scene()[0])
    estimate = rgb_ratio(prepared, RgbRatio(max_iterations=0), silent)
    np.testing.assert_array_equal(estimate.log_depth, np.log(prepared.depth_m))
    assert len(estimate.energy) == 1


def test_a_large_depth_weight_keeps_the_prepared_depth():
    prepared = prepare(scene()[0])
    estimate = rgb_ratio(prepared, RgbRatio(depth_weight=1e9, max_iterations=1), silent)
    moved = np.exp(estimate.log_depth) - prepared.depth_m
    assert np.abs(moved[prepared.mask]).max() < 1e-6


def test_a_few_colours_on_a_small_sphere_do_the_depth_no_harm():
    capture, truth = scene()
    prepared = prepare(capture)
    before = scores(prepared, np.log(prepared.depth_m), truth)
    after = scores(prepared, refined().log_depth, truth)
    assert after[0] < 1.02 * before[0]
    # Normals lose a little: at 96 x 72 pixels three colours and three lights are hard to part.
    assert after[1] < 1.06 * before[1]


def change(length_px, drift=0.0):
    """A scene without depth noise, and its log depth with errors of that length, and a drift."""
    capture, _ = scene("white", depth_noise=DepthNoise(rms_mm=0.0))
    level = first_photograph(prepare(capture))
    errors = gaussian_filter(np.random.default_rng(0).normal(size=level.prior.shape), length_px)
    column = np.linspace(-1, 1, errors.shape[1])
    return level, level.prior + 1e-3 * (errors / errors.std() + drift * column)


def test_the_depth_weight_falls_with_the_errors_correlation_length():
    fine, middle, coarse = (
        depth_weight_from_change(*change(length), 0.0) for length in (0.7, 2.0, 5.0)
    )
    assert fine > 3 * middle > 9 * coarse
    assert fine > 0.3
    assert coarse < 0.05


def test_a_drift_triples_the_depth_weight():
    assert depth_weight_from_change(*change(2.0), 1.0) == 1.0
    assert depth_weight_from_change(*change(2.0, drift=20.0), 1.0) == 3.0


def test_a_dark_channel_keeps_the_depth_and_is_told():
    capture = scene()[0]
    dark = changed(capture, lambda light: light * [1.0, 1.0, 0.0])
    prepared = prepare(dark)
    estimate = rgb_ratio(prepared, RgbRatio(), silent)
    assert [f.code for f in estimate.findings] == ["channel-dark"]
    assert "blue" in estimate.findings[0].message
    np.testing.assert_array_equal(estimate.log_depth, np.log(prepared.depth_m))


# ---- light, albedo, confidence


def test_lights_are_found_within_five_degrees():
    found, truth = refined("white").lights, scene("white")[1].lights
    cosine = (found.direction[0] * truth.direction[0]).sum(axis=-1)
    assert np.degrees(np.arccos(cosine)).max() < 5


def test_the_estimate_has_the_shapes_of_the_contract():
    prepared, estimate = prepare(scene()[0]), refined()
    shape = prepared.mask.shape
    assert estimate.lights.vector.shape == (1, 3, 3)
    assert estimate.lights.ambient.shape == (1, 3)
    assert estimate.albedo.shape == (*shape, 3)
    assert np.percentile(estimate.albedo[prepared.mask], 99, axis=0) == pytest.approx(1.0)
    assert estimate.confidence.shape == shape
    assert 0 <= estimate.confidence.min() < estimate.confidence.max() <= 1


def test_more_noise_is_less_confidence():
    clear, noisy = (refined("white", image_noise=noise) for noise in (0.003, 0.03))
    assert clear.confidence.mean() > 2 * noisy.confidence.mean()


def test_colours_of_paint_are_told_apart():
    rng = np.random.default_rng(0)
    paints = np.log([[0.7, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.3, 0.7]])
    label = rng.integers(3, size=3000)
    colors, alike = nearest_colors(paints[label] + rng.normal(scale=0.05, size=(3000, 3)))
    np.testing.assert_allclose(colors, paints[label], atol=0.01)
    assert np.median(alike) > 0.7


# ---- findings


def test_a_refined_surface_may_show_paint_and_says_so():
    estimate = rgb_ratio(prepare(scene()[0]), RgbRatio(max_iterations=1), silent)
    assert [(f.severity, f.code) for f in estimate.findings] == [("warning", "single-photograph")]


def test_good_lights_need_no_warning():
    assert codes(scene()[0]) == []


def test_lights_side_by_side_are_told():
    near = (-90.0, -60.0, 150.0)  # 19 degrees apart, the others 60 and more
    assert codes(scene("pattern", led_azimuth_deg=near)[0]) == ["leds-close"]


@pytest.mark.parametrize(("off", "expected"), [(1.015, ["white-balance"]), (1.05, [])])
def test_channels_within_two_percent_are_white_balanced(off, expected):
    capture = scene("white")[0]
    mean = (capture.photographs[0] / capture.white)[capture.mask].mean(axis=0)
    gains = 0.3 / mean * [1.0, 1.0, off]
    assert codes(changed(capture, lambda light: light * gains)) == expected


@pytest.mark.parametrize(("share", "expected"), [(0.015, ["highlights"]), (0.007, [])])
def test_more_than_a_hundredth_saturated_is_told(share, expected):
    capture = changed(scene()[0], lambda light: 0.9 * light)
    rows, columns = np.nonzero(capture.mask)
    chosen = slice(None, None, round(1 / share))
    photographs = capture.photographs.copy()
    photographs[:, rows[chosen], columns[chosen]] = 65535
    assert codes(replace(capture, photographs=photographs)) == expected


def test_further_photographs_are_noted():
    capture = scene()[0]
    two = replace(capture, photographs=np.repeat(capture.photographs, 2, axis=0))
    assert codes(two) == ["first-photograph"]


@pytest.mark.parametrize(
    "wrong", [{"sigma_c": 0.0}, {"lambda_rho": -1.0}, {"depth_weight": 0.0}, {"laplacian": np.nan}]
)
def test_impossible_options_are_refused(wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        RgbRatio(**wrong)


# Five rounds were too few for it.
def test_steps_under_patterned_paint_come_to_rest():
    prepared = prepare(random_capture(81, 0.5, lighting="rgb-leds")[0])
    estimate = rgb_ratio(prepared, RgbRatio(), silent)
    assert estimate.converged
    assert estimate.iterations > 5


# ---- a solver that stalls


# Three channels of albedo are solved twice, then the depth twice and, its weight being chosen,
# again; the second round begins with the albedo.
@pytest.mark.parametrize(
    ("depth_weight", "after", "rounds"), [(1.0, 6, 0), (1.0, 7, 0), (None, 8, 0), (1.0, 11, 1)]
)
def test_a_step_that_the_solver_does_not_find_is_refused(depth_weight, after, rounds):
    prepared = prepare(scene()[0])
    options = RgbRatio(lambda_palette=0.0, depth_weight=depth_weight, tolerance=0.0)
    with stalling_solver(after) as solved:
        estimate = rgb_ratio(prepared, options, silent)
    assert solved == [True] * after + [False]
    level = first_photograph(prepared)
    expected = alternated(level, prepared, options, rounds, silent)
    np.testing.assert_array_equal(estimate.log_depth, expected.log_depth)
    assert estimate.energy == expected.energies
    assert not estimate.converged
