"""Fits of depth and lights: the energy, its derivative, and steps that never raise it."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from rakelight.geometry.averaging import Averaging
from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import Links
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light.energy import (
    depth_negative_gradient,
    depth_system,
    evaluated,
    first_fit,
    fourth_difference_term,
    fourth_difference_term_transposed,
    laplacian_of_change,
    reset_scale,
    update_scale,
)
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.joint_step import joint_step
from rakelight.methods.multi_light.light_model import LightModel
from rakelight.methods.multi_light.model_selection import with_coloured_lights
from rakelight.methods.multi_light.options import MultiLight
from rakelight.methods.multi_light.steps import (
    depth_step,
    descend,
    extrapolated,
    lights_step,
    parabola_falls,
    project_bas_relief,
    refine_lights,
)
from rakelight.model import silent
from rakelight.photometry.images import LightParameters
from rakelight.prepare import prepare
from rakelight.solve import solve
from rakelight.solve.levenberg_marquardt import FACTOR, LEAST
from rakelight.solve.robust import CAUCHY
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

STEPS = {
    "depth": depth_step,
    "joint": partial(joint_step, most_cells=10**6),
    "joint, cells": partial(joint_step, most_cells=60),
}


@cache
def make_level():
    """A head of some 800 pixels, with thin parts that have no normal."""
    shape = make_shape("head")
    options = SceneOptions(
        camera=shape.camera.scaled(0.15),
        photographs=6,
        depth_noise=DepthNoise(rms_mm=2.0),
        image_noise=0.005,
    )
    return finest_level(prepare(render_scene(shape, make_albedo("pattern"), options)[0]))


def with_cuts(level, share=0.15):
    """The level with links missing here and there."""
    whole, rng = Links.of(level.grid), np.random.default_rng(0)
    right, down = (side & (rng.random(side.shape) > share) for side in (whole.right, whole.down))
    grid = Links(level.mask, right, down)
    return replace(level, photographs=replace(level.photographs, grid=grid))


@pytest.fixture(params=["whole", "cut"])
def level(request):
    return make_level() if request.param == "whole" else with_cuts(make_level())


@pytest.fixture
def fit(level):
    return first_fit(level, level.prior, lights_of_prior(level))


def rough(level, seed=0):
    return np.random.default_rng(seed).normal(size=level.mask.shape)


def start(level, name):
    """A fit that is far from the best one, in the way that its name says."""
    lights, prior, rng = lights_of_prior(level), level.prior, np.random.default_rng(3)
    count = len(lights.vector)
    wild = LightParameters.distant(rng.normal(size=(count, 1, 3)), rng.uniform(0, 1, (count, 1)))
    alike = (np.repeat(each[:1], count, axis=0) for each in (lights.vector, lights.ambient))
    near = replace(lights, inverse_distance=np.full((count, 1), 3.0))
    beams = np.append(rng.normal(0, 2, (count, 1, 2)), np.full((count, 1, 1), 5.0), axis=-1)
    depth, light = {
        "rough depth": (prior + 0.03 * rough(level), lights),
        "rough depth, Laplacian": (prior + 0.03 * rough(level), lights),
        "flat depth": (np.full_like(prior, prior.mean()), lights),
        "wild lights": (prior, wild),
        "lights behind": (prior, replace(lights, vector=-lights.vector)),
        "no light": (prior, LightParameters.distant(0 * lights.vector, 0 * lights.ambient)),
        "lights alike": (prior, LightParameters.distant(*alike)),
        "near": (prior, near),
        "glossy near": (prior, near),
        "beam": (prior, replace(lights, beam=beams)),
        "near beam": (prior, replace(near, beam=beams)),
    }.get(name, (prior, lights))
    if "uneven" in name:
        light = replace(light, ambient=light.ambient + 0.1, ambient_direction=np.array([1, -1, 0]))
    if "glossy" in name:
        light = replace(light, gloss=np.array([0.02, 0.05, 0.01]))
    free = (kind in name for kind in ("near", "beam", "shared", "uneven"))
    fit = first_fit(level, depth, light, LightModel(*free))
    if "Laplacian" in name:  # it counts as much as the photographs
        counted = np.median(fit.linearization.jtwj[level.photographs.active]) / fit.noise**2
        fit = evaluated(level, replace(fit, laplacian_weight=counted), depth, light)
    return update_scale(level, with_coloured_lights(fit)) if "coloured" in name else fit


STARTS = (
    "prior", "rough depth", "flat depth", "wild lights", "lights behind", "no light",
    "lights alike", "coloured", "near", "coloured near", "glossy", "glossy near", "glossy coloured",
    "rough depth, Laplacian", "beam", "near beam", "uneven", "near uneven",
)  # fmt: skip


# ---- ripples


def test_ripples_transposed_is_their_transpose(level):
    x = rough(level, 1)
    images = [rough(level, seed) for seed in (2, 3)]
    there = sum(
        (wave * image).sum()
        for wave, image in zip(fourth_difference_term(level, x), images, strict=True)
    )
    assert there == pytest.approx(
        (x * fourth_difference_term_transposed(level, images)).sum(), abs=1e-11
    )


def test_ripples_do_not_see_smooth_surfaces(level):
    row, column = np.indices(level.mask.shape) / 10.0
    smooth = 3 + row - 2 * column + 0.5 * row**2 - row * column + 0.7 * column**2 + row**3
    for wave in fourth_difference_term(level, smooth):
        assert np.abs(wave).max() < 1e-12


def test_ripples_see_a_checkerboard_that_the_gradient_does_not(level):
    # Wherever two linked neighbours follow on both sides, the nearer with a normal.
    board = (-1.0) ** np.indices(level.mask.shape).sum(axis=0)
    links, gradient = Links.of(level.grid), level.surface(board).gradient
    for k, wave in enumerate(fourth_difference_term(level, board)):
        linked = np.pad((links.right, links.down.T)[k], ((0, 0), (2, 2)))
        ahead = [linked[:, i : i + level.mask.shape[1 - k]] for i in range(4)]
        where = np.logical_and.reduce(ahead)
        where = where if k == 0 else where.T
        steady = level.photographs.active
        where &= steady & np.roll(steady, 1, axis=1 - k) & np.roll(steady, -1, axis=1 - k)
        assert where.sum() > 100
        np.testing.assert_array_equal(wave, np.where(where, 2 * board, 0))
        assert not gradient[where, k].any()


def test_ripples_do_not_reach_across_a_cut():
    level = make_level()
    links, left = Links.of(level.grid), np.indices(level.mask.shape)[1] < 15
    step = 100.0 * left
    assert np.abs(fourth_difference_term(level, step)[0]).max() > 10
    grid = replace(links, right=links.right & (left == np.roll(left, -1, axis=1)))
    cut = replace(level, photographs=replace(level.photographs, grid=grid))
    assert not np.any(fourth_difference_term(cut, step))


# ---- the Laplacian of the change


def test_of_the_prepared_depth_and_a_plane_there_is_no_laplacian(level):
    rows, columns = np.indices(level.mask.shape)
    plane = 0.3 + 0.02 * columns - 0.01 * rows
    assert not np.any(laplacian_of_change(level, level.prior))
    assert np.abs(laplacian_of_change(level, level.prior + plane)).max() < 1e-14


def test_the_laplacian_is_the_sum_of_both_second_differences_where_all_neighbours_are_linked(level):
    rows, columns = np.indices(level.mask.shape)
    bowl = 0.01 * columns**2 + 0.02 * rows**2
    found = laplacian_of_change(level, level.prior + bowl)
    np.testing.assert_allclose(found[level.links.inner], 0.06, rtol=1e-9)
    assert not np.any(found[~level.links.inner])
    assert 0.3 * level.mask.sum() < level.links.inner.sum() < level.mask.sum()


def test_the_laplacian_does_not_reach_across_a_cut(level):
    step = level.prior + 0.2 * (np.indices(level.mask.shape)[1] > 20)
    assert np.abs(laplacian_of_change(level, step)).max() > 0.1
    links = level.links
    right = links.right.copy()
    right[:, 20] = False
    cut = level.linked(Links(links.mask, right, links.down))
    assert not np.any(laplacian_of_change(cut, step).round(12))


# ---- the derivative


@pytest.mark.parametrize(
    "name",
    ["prior", "rough depth", "rough depth, Laplacian", "near", "glossy near", "near uneven"],
)
def test_the_right_side_is_minus_half_the_derivative_of_the_energy(level, name):
    # By then the albedo's reweighting has come to rest, and the energy owes nothing to it.
    fit = start(level, name)
    for _ in range(40):
        fit = evaluated(level, fit, fit.log_depth, fit.lights)
    system = depth_system(level, fit, fit.linearization.jtwj)
    assert not system.pinned.any()
    close = 1e-12 * np.abs(system.rhs).max()
    np.testing.assert_allclose(
        depth_negative_gradient(level, fit)[level.mask], system.rhs[level.mask], atol=close
    )
    # Light less a highlight is rounded to 24 bits: longer steps.
    size, worst = (1e-5, 1e-5) if "glossy" in name else (1e-7, 1e-8)
    for seed in range(3):
        way = size * rough(level, seed)
        ahead, behind = (
            evaluated(level, fit, fit.log_depth + sign * way, fit.lights).energy for sign in (1, -1)
        )
        expected = -(ahead - behind) / 4
        scale = np.linalg.norm(system.rhs) * np.linalg.norm(way[level.mask])
        assert (system.rhs * way)[level.mask].sum() == pytest.approx(expected, abs=worst * scale)
        assert abs(expected) > 1e-4 * scale


# ---- steps


@pytest.mark.parametrize("kind", STEPS)
@pytest.mark.parametrize("name", STARTS)
def test_steps_never_raise_the_energy(level, name, kind):
    before = start(level, name)
    first = before.energy
    for _ in range(3):
        fit = STEPS[kind](level, before)
        assert fit.energy <= before.energy
        assert np.isfinite(fit.energy)
        assert np.isfinite(fit.log_depth).all()
        assert extrapolated(level, before, fit).energy <= fit.energy
        before = fit
    falling = "prior", "rough depth", "near", "coloured near", "glossy near"
    if name in falling and kind != "joint, cells":
        assert fit.energy < 0.7 * first


@pytest.mark.parametrize("kind", STEPS)
def test_a_steps_energy_is_that_of_its_depth_and_lights(level, fit, kind):
    after = STEPS[kind](level, fit)
    again = evaluated(level, fit, after.log_depth, after.lights)
    assert again.energy == after.energy < fit.energy
    assert after.scales is fit.scales
    assert (after.lights is fit.lights) is (kind == "depth")


@pytest.mark.parametrize("kind", STEPS)
def test_a_refused_step_leaves_all_but_the_damping(level, fit, kind):
    perfect = replace(fit, energy=0.0)
    after = STEPS[kind](level, perfect)
    assert after.log_depth is fit.log_depth
    assert after.lights is fit.lights
    damping = "depth_damping" if kind == "depth" else "joint_damping"
    before, now = getattr(fit, damping), getattr(after, damping)
    assert now == pytest.approx(before * FACTOR)
    assert replace(after, **{damping: getattr(fit, damping)}) == perfect
    for _ in range(6):
        after = STEPS[kind](level, after)
    assert getattr(after, damping) == pytest.approx(1 / LEAST)


@pytest.mark.parametrize("times", [9.0, 11.0, 1 / 9, 1 / 11])
def test_no_step_leads_ten_times_as_far_or_as_near(level, fit, times):
    there = level.prior.copy()
    row, column = np.argwhere(level.mask)[len(level.prior)]
    there[row, column] += np.log(times)
    energy = evaluated(level, fit, there, fit.lights).energy
    assert np.isfinite(energy) == (1 / 10 < times < 10)


def test_a_stalled_solve_is_a_refused_step(level, fit, monkeypatch):
    monkeypatch.setattr(
        "rakelight.methods.multi_light.steps.solve",
        lambda system, **_: replace(solve(system), status="stalled"),
    )
    after = depth_step(level, fit)
    assert after.log_depth is fit.log_depth
    assert after.depth_damping > fit.depth_damping


@pytest.mark.parametrize("refusals", [3, 100])
def test_no_descent_ends_with_a_joint_step_refused(level, fit, monkeypatch, refusals):
    """Until its damping leaves next to nothing of it."""
    refused = []

    def joint(level, fit, most_cells):
        if len(refused) == refusals:
            return joint_step(level, fit, most_cells)
        refused.append(fit.joint_damping)
        return replace(fit, joint_damping=min(fit.joint_damping * FACTOR, 1 / LEAST))

    monkeypatch.setattr("rakelight.methods.multi_light.steps.depth_step", lambda _, fit, **__: fit)
    monkeypatch.setattr("rakelight.methods.multi_light.steps.joint_step", joint)
    found = descend(level, replace(fit, joint_damping=1e-3), MultiLight(), silent, "", last=True)
    assert found.converged
    assert len(refused) == min(refusals, 4)  # from 1e-3 to more than 1
    assert (found.fit.energy < 0.9 * found.energies[0]) == (refusals == 3)


def test_depth_steps_that_are_taken_stay_damped(level, fit):
    for _ in range(4):
        fit = depth_step(level, replace(fit, depth_damping=2 * LEAST))
        assert fit.depth_damping == LEAST


def test_a_depth_step_leaves_the_lights_and_cells_leave_the_detail(level, fit):
    assert depth_step(level, fit).lights is fit.lights
    # Linear between centres some four pixels apart: next to nothing for ripples to see.
    sizes = {
        kind: np.abs(
            fourth_difference_term(level, STEPS[kind](level, fit).log_depth - fit.log_depth)
        ).max()
        for kind in ("joint", "joint, cells")
    }
    assert sizes["joint, cells"] < 0.2 * sizes["joint"]


def test_undamped_joint_steps_from_some_pixels_are_taken_under_near_lights():
    level, most_cells = make_level(), 60
    assert 3 * np.count_nonzero(level.photographs.subsample(2 * most_cells)) < level.mask.sum()
    fit = start(level, "near")
    for _ in range(5):
        before = depth_step(level, fit)
        fit = joint_step(level, replace(before, joint_damping=1e-6), most_cells)
        assert fit.energy < before.energy


# ---- strides


def lights_step_of(before, after):
    return after.lights.numbers - before.lights.numbers


@pytest.mark.parametrize("name", ["prior", "near", "coloured"])
def test_a_stride_goes_on_where_steps_are_short(level, name):
    before = start(level, name)
    whole = joint_step(level, depth_step(level, before), 10**6)
    way, lights = whole.log_depth - before.log_depth, lights_step_of(before, whole)
    short = evaluated(level, before, before.log_depth + way / 20, before.lights.moved(lights / 20))
    far = extrapolated(level, before, short)
    assert far.energy < 0.9 * short.energy
    share = (far.log_depth - short.log_depth).sum() / (way / 20).sum()
    assert np.log2(share) == pytest.approx(round(np.log2(share)), abs=1e-9)
    assert share > 2
    for after, step in (
        (far.log_depth - short.log_depth, way),
        (lights_step_of(short, far), lights),
    ):
        np.testing.assert_allclose(after, share * step / 20, atol=1e-12)


def test_a_stride_uphill_is_none(level, fit):
    better = joint_step(level, depth_step(level, fit), 10**6)
    assert extrapolated(level, better, fit) is fit


@pytest.mark.parametrize(("middle", "further"), [(2.9, False), (3.1, True)])
def test_a_stride_goes_as_far_as_its_parabola_goes_down(middle, further):
    places = [0.0, 1.0, 2.0]
    behind = [(place, 7 + 3 * (place - middle) ** 2) for place in places]
    # 4 is lower than 2 where the middle is beyond 3.
    assert parabola_falls(behind, 4.0) == further
    assert parabola_falls(behind[:2], 4.0)
    assert parabola_falls([(-8.0, 1.0), *behind], 4.0) == further


def test_a_stride_stops_before_its_parabola_rises(level, monkeypatch):
    before = start(level, "prior")
    fit = joint_step(level, depth_step(level, before), 10**6)
    tried = []
    monkeypatch.setattr(
        "rakelight.methods.multi_light.steps.evaluated",
        lambda level, fit, log_depth, lights: (
            tried.append(1) or replace(fit, energy=energies.pop())
        ),
    )
    fit = replace(fit, energy=before.energy - 3)
    # As (t - 2.5)^2 at 2, and what would be tried at 3.
    energies = [before.energy - 100, before.energy - 4.5]
    assert extrapolated(level, before, fit).energy == pytest.approx(before.energy - 4.5)
    assert len(tried) == 1


@pytest.mark.parametrize("name", ["prior", "near", "coloured near"])
def test_lights_step_is_what_moves_them(name):
    fit = start(make_level(), name)
    rng = np.random.default_rng(1)
    numbers = (fit.lights.vector, fit.lights.ambient, fit.lights.inverse_distance)
    other = LightParameters(*(each + 0.1 * rng.random(each.shape) for each in numbers))
    moved_lights = fit.lights.moved(other.numbers - fit.lights.numbers)
    for one, two in zip(moved_lights.arrays, other.arrays, strict=True):
        np.testing.assert_allclose(one, two, atol=1e-15)


# ---- begun anew


def test_under_another_depth_weight_the_robust_scale_is_reset(level, fit):
    for _ in range(3):
        fit = update_scale(level, fit)
    first = first_fit(level, fit.log_depth, fit.lights)
    anew = reset_scale(level.weighted(0.1), fit)
    np.testing.assert_array_equal(anew.linearization.albedo, first.linearization.albedo)
    assert np.abs(fit.linearization.albedo - anew.linearization.albedo).max() > 1e-4


# ---- one scale for all pixels


def test_one_scale_is_that_of_the_noise_and_of_all_pixels(level, fit):
    one, own = update_scale(level, fit, one_scale=True), update_scale(level, fit)
    sigma = fit.linearization.noise_sigma
    np.testing.assert_allclose(one.scales, CAUCHY * sigma, rtol=1e-12)
    assert own.scales.max() > 2 * CAUCHY * sigma
    assert own.scales.min() == one.scales.min()


def test_under_one_scale_the_lights_do_not_follow_pixels_where_the_model_errs():
    """On a tenth of a vase the photographs change places: no normal explains them there."""
    shape = make_shape("vase")
    options = SceneOptions(camera=shape.camera.scaled(0.2), photographs=8, image_noise=0.002)
    capture, truth = render_scene(shape, make_albedo("white"), options)
    prepared = prepare(capture)
    level = finest_level(prepared)
    true = truth.depth[prepared.rows, prepared.columns]
    log_depth = np.where(np.isfinite(true), np.log(np.nan_to_num(true, nan=1.0)), level.prior)
    rows = np.flatnonzero(level.mask.any(axis=1))
    wrong = slice(rows[len(rows) // 2], rows[len(rows) * 6 // 10])
    values = level.photographs.values.copy()
    values[:, wrong] = np.roll(values[:, wrong], 3, axis=0)
    level = replace(level, photographs=replace(level.photographs, values=values))
    off_deg = {}
    for one_scale in (False, True):
        fit = first_fit(
            level, log_depth, LightParameters.distant(truth.lights.vector, truth.lights.ambient)
        )
        for _ in range(4):
            fit = refine_lights(level, update_scale(level, fit, one_scale=one_scale))
        cosine = np.sum(fit.lights.as_lights(level.middle_m).direction * truth.lights.direction, -1)
        off_deg[one_scale] = np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()
    assert off_deg[True] < 0.5 * off_deg[False]


# ---- the bas-relief transform


def flattened(level, fit, by=0.8, tilt=(0.2, -0.1, 0.0)):
    """The fit after  1/z' = by/z + tilt . (x, y, 1) + constant, the middle staying."""
    rays = back_project(np.ones(level.mask.shape), level.photographs.camera)
    inverse = by * np.exp(-fit.log_depth) + rays @ tilt
    inverse += (np.exp(-fit.log_depth) - inverse)[level.mask].mean()
    return evaluated(level, fit, np.where(level.mask, -np.log(inverse), fit.log_depth), fit.lights)


@pytest.mark.parametrize("factor", [1, 3])
def test_the_sensor_sets_the_four_numbers_that_the_photographs_leave_open(factor):
    level = make_level()
    if factor > 1:
        edges = (np.arange(-(-side // factor) + 1.0) * factor for side in level.mask.shape)
        level = replace(level, averaging=Averaging.on(level.mask, *edges))
    level = level.weighted(100.0)
    fit = flattened(level, first_fit(level, level.prior, lights_of_prior(level)))
    found = project_bas_relief(level, fit)
    assert found.energy < fit.energy
    # Means of the inverse are not quite the inverse of the means.
    assert level.sensor_sum_of_squares(found.log_depth) < 1e-3 * level.sensor_sum_of_squares(
        fit.log_depth
    )


def test_where_the_sensor_has_nothing_to_add_the_surface_stays(level):
    fit = first_fit(level, level.prior, lights_of_prior(level))
    np.testing.assert_allclose(project_bas_relief(level, fit).log_depth, fit.log_depth, atol=1e-9)


def test_the_photographs_have_no_say_in_the_relief_that_distant_lights_leave_open():
    """Not even where a weightless sensor means that their energy is lower at another one."""
    level = make_level().weighted(1e-9)
    fit = flattened(level, first_fit(level, level.prior, lights_of_prior(level)))
    found = project_bas_relief(level, fit)
    assert level.sensor_sum_of_squares(found.log_depth) < 1e-3 * level.sensor_sum_of_squares(
        fit.log_depth
    )


def test_near_lights_settle_the_relief(level):
    fit = flattened(level.weighted(100.0), start(level, "near"))
    assert project_bas_relief(level.weighted(100.0), fit) is fit


@pytest.mark.parametrize("by", [0.7, 1.4], ids=["too flat", "too deep"])
def test_under_near_lights_joint_steps_in_cells_set_the_relief_of_the_detail_too(by):
    level, true, lights = near_level()
    at_rest = steps_of_both(level, first_fit(level, true, lights, LightModel(near=True)), 8)
    wrong = refine_lights(
        level, refine_lights(level, flattened(level, at_rest, by, tilt=(0, 0, 0)))
    )
    fit = steps_of_both(level, wrong, 16)
    details = [detail(level, each.log_depth) for each in (at_rest, wrong, fit)]
    before, after = (details[0] @ each / (details[0] @ details[0]) - 1 for each in details[1:])
    assert before == pytest.approx(by - 1, abs=0.05)
    assert abs(after) < 0.5 * abs(before)
    inverse_distance = [np.median(each.lights.inverse_distance) for each in (at_rest, wrong, fit)]
    assert abs(inverse_distance[2] - inverse_distance[0]) < 0.5 * abs(
        inverse_distance[1] - inverse_distance[0]
    )


@cache
def near_level():
    """Folds under lights at half a metre; their true log depth and lights."""
    shape = make_shape("cloth")
    options = SceneOptions(camera=shape.camera.scaled(0.25), photographs=8, lamp_distance_m=0.5)
    capture, truth = render_scene(shape, make_albedo("pattern"), options)
    prepared = prepare(capture)
    level = finest_level(prepared).weighted(1e-3)
    depth = np.where(prepared.mask, truth.depth[prepared.rows, prepared.columns], 1.0)
    true = truth.lights
    lights = LightParameters(true.vector, true.ambient, 1 / true.distance_m)
    return level, np.where(prepared.mask, np.log(depth), level.prior), lights


def steps_of_both(level, fit, count):
    for _ in range(count):
        fit = joint_step(level, depth_step(level, fit), most_cells=1000)
    return fit


def detail(level, log_depth):
    """(P,) log depth less its mean over 9 x 9 pixels."""
    return (log_depth - uniform_filter(log_depth, 9))[level.mask]


@pytest.mark.parametrize("name", STARTS)
def test_lights_steps_never_raise_the_energy(level, name):
    fit = flattened(level, start(level, name))
    assert lights_step(level, fit).energy <= fit.energy


@pytest.mark.parametrize("name", ["wild lights", "rough depth", "near", "coloured"])
def test_a_lights_step_lowers_the_energy_and_leaves_the_depth(level, name):
    fit = start(level, name)
    after = lights_step(level, fit)
    assert after.energy < fit.energy
    assert after.log_depth is fit.log_depth


def test_what_no_normal_depends_on_is_not_pulled():
    # A strip of one row has no normals; its end lies two pixels from the last pixel with one.
    level = make_level()
    mask = np.zeros_like(level.mask)
    mask[4:12, 4:12] = mask[8, 12:20] = True
    level = replace(level, photographs=replace(level.photographs, grid=mask))
    pull = fourth_difference_term_transposed(level, fourth_difference_term(level, rough(level)))
    assert np.abs(pull[4:12, 4:12]).min() > 0
    assert not pull[8, 13:20].any()
