"""The joint multi-light method: accuracy, the lights it finds, what it refuses and warns of."""

from dataclasses import replace
from functools import cache
from itertools import groupby

import numpy as np
import pytest

from rakelight.errors import InputError, MethodError
from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import surface_normals
from rakelight.methods import multi_light
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light import MultiLight, steps
from rakelight.methods.multi_light.model_selection import are_near
from rakelight.metrics import evaluate_depth, evaluate_maps
from rakelight.model import Camera
from rakelight.photometry.images import LightParameters
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.synthetic import (
    DepthNoise,
    SceneOptions,
    Shape,
    Surface,
    draw,
    make_albedo,
    make_shape,
    render_draw,
    render_scene,
)
from tests.capture.capture_builder import told_apart
from tests.methods.remembered import remembered

HEAD = remembered(make_shape("head"))
# Close to the object, as at full resolution, but only a small window of it.
CAMERA = HEAD.camera.cropped(slice(135, 225), slice(180, 300))
WHITE = DepthNoise(rms_mm=2.5)
CORRELATED = DepthNoise(rms_mm=2.5, correlation_length_px=6.0)
DISTANT = {"distance": "distant"}  # near lights are not looked for


@cache
def make_scene(albedo="pattern", **changes):
    options = SceneOptions(camera=CAMERA, photographs=8, depth_noise=CORRELATED)
    return render_scene(HEAD, make_albedo(albedo), replace(options, **changes))


def run(capture, **options):
    return refine(capture, "multi-light", options=MultiLight(**options))


def scores(result, truth):
    return evaluate_maps(result.depth, result.normals, truth)


def scores_before(result, truth):
    return evaluate_depth(result.prepared_depth, result.camera, truth)


def light_errors_deg(lights, truth):
    return np.degrees(np.arccos(np.clip((lights.direction * truth.direction).sum(-1), -1, 1)))


def codes(result):
    return {finding.code for finding in result.findings}


# ---- accuracy


@pytest.mark.parametrize("noise", ["white", "correlated"])
def test_normals_and_depth_are_much_better_than_prepared_and_alternating(noise, request):
    if noise == "white":
        capture, truth = make_scene(depth_noise=WHITE)
        result = run(capture)
    else:
        (capture, truth), result = map(request.getfixturevalue, ("scene", "result"))
    before, after = scores_before(result, truth), scores(result, truth)
    other = scores(refine(capture, "multi-light-alternating"), truth)
    assert after.normals.mae_deg < min(before.normals.mae_deg / 10, other.normals.mae_deg / 2)
    assert after.depth.rmse_mm < min(before.depth.rmse_mm, other.depth.rmse_mm) / 2


def test_white_distant_lights_are_found_as_such(scene, result):
    lights, truth = result.lights, scene[1].lights
    assert lights.vector.shape == (8, 1, 3)
    assert lights.position_m is None
    assert light_errors_deg(lights, truth).max() < 3


@pytest.mark.parametrize(
    "changes",
    [
        {"specular": 0.15},
        {"specular": 0.15, "cast_shadows": True},
    ],
    ids=["highlights", "and shadows"],
)
def test_shadows_and_highlights_are_left_out(changes, monkeypatch):
    capture, truth = make_scene(**changes)
    result = run(capture, **DISTANT)
    assert scores(result, truth).normals.mae_deg < scores_before(result, truth).normals.mae_deg / 4
    assert "highlights" in codes(result)
    monkeypatch.setattr(multi_light, "remove_outliers", lambda level, _, lights: (level, lights))
    other = run(capture, **DISTANT)
    assert "highlights" not in codes(other)
    assert scores(result, truth).normals.mae_deg < 0.75 * scores(other, truth).normals.mae_deg
    assert scores(result, truth).depth.rmse_mm < scores(other, truth).depth.rmse_mm


def test_exposures_are_found_as_intensities():
    capture, truth = make_scene(exposure_spread=0.3)
    result = run(capture, **DISTANT)
    gain = (result.lights.intensity / truth.lights.intensity)[:, 0]
    assert gain.std() / gain.mean() < 0.05
    assert scores(result, truth).normals.mae_deg < scores_before(result, truth).normals.mae_deg / 4


@pytest.fixture(scope="module")
def jump():
    """Depth errors (mm) of the columns beside a jump of 50 mm, their means."""
    camera, gap = Camera(100, 80, 900.0, 900.0, 49.5, 39.5), 0.05

    def render(camera, rows):
        v, u = np.mgrid[: camera.height, : camera.width]
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        waves = 0.001 * (np.cos(300 * x) + np.sin(250 * y)) + 3 * (x**2 + y**2)
        left, depth = x < 0, 0.7 + waves
        near = surface_normals(depth, left, camera)
        far = surface_normals(depth + gap, ~left, camera)
        normals = np.where(left[..., None], near, far)
        return Surface(np.where(left, depth, depth + gap), normals).cut(rows)

    capture, truth = render_scene(
        Shape("jump", camera, render),
        make_albedo("pattern"),
        SceneOptions(photographs=8, depth_noise=DepthNoise(rms_mm=1.0), supersampling=1),
    )
    error_mm = 1000 * np.abs(run(capture, **DISTANT).depth - truth.depth)
    return error_mm[:, 46:54].mean(axis=0)


def test_a_depth_jump_is_not_bridged(jump):
    assert jump.max() < 5.0


def test_depth_is_right_up_to_the_last_pixel_beside_a_jump(jump):
    assert jump.max() < 2.0
    assert np.delete(jump, [3, 4]).max() < 0.3


# ---- lights


def test_near_lights_are_found_where_they_are():
    capture, truth = make_scene(lamp_distance_m=0.6)
    result = run(capture)
    middle = back_project(truth.depth, capture.camera)[truth.mask].mean(axis=0)
    distance = np.linalg.norm(result.lights.position_m[:, 0] - middle, axis=1)
    assert 0.53 < np.median(distance) < 0.61
    distant = run(capture, **DISTANT)
    assert distant.lights.position_m is None
    assert scores(result, truth).normals.mae_deg < scores(distant, truth).normals.mae_deg


def test_coloured_lights_on_demand(scene, capture):
    result = run(capture, lights="coloured", **DISTANT)
    assert result.lights.vector.shape == (8, 3, 3)
    assert light_errors_deg(result.lights, scene[1].lights).max() < 3


@pytest.mark.parametrize("differing", ["direction", "gain"])
def test_coloured_lights_are_noticed(scene, differing):
    capture, truth = scene
    if differing == "direction":
        # Each channel of photograph i was taken under the lamp of another one.
        taken = (np.arange(8)[:, None] + np.arange(3)) % 8
        photographs = np.stack([capture.photographs[taken[:, k], ..., k] for k in range(3)], -1)
    else:
        taken = np.repeat(np.arange(8)[:, None], 3, axis=1)
        gain = np.random.default_rng(0).uniform(0.5, 1, (8, 1, 1, 3))
        photographs = np.rint(capture.photographs * gain).astype(np.uint16)
    result = run(replace(capture, photographs=photographs), **DISTANT)
    toward = truth.lights.direction[taken, 0]
    cosine = (result.lights.direction * toward).sum(-1)
    assert result.lights.vector.shape == (8, 3, 3)
    assert np.degrees(np.arccos(cosine.min())) < 4
    assert scores(result, truth).normals.mae_deg < scores_before(result, truth).normals.mae_deg / 4


# ---- energy and repeatability


def test_the_energy_never_rises_and_comes_to_rest(result):
    assert (np.diff(result.energy) <= 0).all()
    assert result.converged
    assert "not-converged" not in codes(result)


def test_too_few_steps_are_told(capture):
    result = run(capture, max_iterations=1)
    assert not result.converged
    assert "not-converged" in codes(result)


def test_lights_and_depth_move_together_but_for_the_first_steps_of_the_finest_level(monkeypatch):
    capture, _ = make_scene()
    pixels, together, stages = int(capture.mask.sum()), [], []
    step = steps.joint_step
    monkeypatch.setattr(
        steps,
        "joint_step",
        lambda level, *rest: together.append((stages[-1], level.mask.sum())) or step(level, *rest),
    )
    options = MultiLight(coarse_pixels=1000)
    refine(capture, "multi-light", options=options, progress=lambda now: stages.append(now.stage))
    sizes = {size for stage, size in together if stage.startswith("refine")}
    assert len(sizes) == 3
    assert max(sizes) == pixels
    last = ["refine", "try near lights", "refine, weighed", "refine, depth"]
    assert {stage for stage, size in together if size == pixels} == set(last[1:3])
    assert [k for k, _ in groupby(stages)][-4:] == last


def test_the_last_steps_end_where_strides_find_nothing_either(capture, monkeypatch):
    monkeypatch.setattr(
        steps, "extrapolated", lambda level, before, fit: replace(fit, energy=0.9 * before.energy)
    )
    assert not run(capture, max_iterations=3).converged


def test_two_runs_are_identical(capture, result):
    again = run(capture)
    for name in ("depth", "normals", "albedo", "confidence", "depth_sigma", "normal_sigma"):
        np.testing.assert_array_equal(getattr(again, name), getattr(result, name))
    np.testing.assert_array_equal(again.lights.vector, result.lights.vector)


# ---- poor captures


def test_three_photographs_are_enough(scene):
    capture, truth = scene
    result = run(capture.select(range(3)), **DISTANT)
    assert scores(result, truth).normals.mae_deg < scores_before(result, truth).normals.mae_deg / 2


def test_two_photographs_are_refused(capture):
    with pytest.raises(MethodError, match="too few photographs for multi-light") as error:
        run(capture.select(range(2)))
    assert error.value.seen == "2"


def test_one_photograph_repeated_keeps_the_depth(scene):
    capture, truth = scene
    result = run(told_apart(capture.select([0] * 6)))
    before, after = scores_before(result, truth), scores(result, truth)
    assert "one-lamp-position" in codes(result)
    assert after.normals.mae_deg < 1.02 * before.normals.mae_deg
    assert after.depth.rmse_mm < 1.02 * before.depth.rmse_mm


def test_lights_in_one_plane_are_told():
    # Of many lights those that happen to stand on an arc from left to right.
    capture, truth = make_scene(photographs=120, tilt_deg=(0.0, 40.0))
    beside = np.abs(truth.lights.direction[:, 0, 1])
    result = run(capture.select(np.argsort(beside)[:8]), **DISTANT)
    assert "lights-in-one-plane" in codes(result)
    assert scores(result, truth).depth.rmse_mm < scores_before(result, truth).depth.rmse_mm


def test_neighbours_do_not_part_where_lights_in_one_plane_leave_a_slope_open():
    # 3.6 % of them without the Laplacian in the energy
    capture, truth = render_draw(draw(2021, shape="steps"))
    result = run(capture)
    assert "lights-in-one-plane" in codes(result)
    off_mm = 1000 * np.where(truth.mask & capture.mask, result.depth - truth.depth, np.nan)
    steps_mm = np.concatenate([np.diff(off_mm, axis=axis).ravel() for axis in (0, 1)])
    assert np.mean(np.abs(steps_mm[np.isfinite(steps_mm)]) > 3) < 0.025


@pytest.fixture(scope="module")
def with_a_black_one(capture):
    photographs = capture.photographs.copy()
    photographs[3] = 0
    return run(replace(capture, photographs=photographs), **DISTANT)


def test_a_black_photograph_does_no_harm(scene, result, with_a_black_one):
    error, usual = (scores(each, scene[1]).normals.mae_deg for each in (with_a_black_one, result))
    assert error < 1.2 * usual


def test_a_black_photograph_is_named(capture, with_a_black_one):
    told = {finding.code: finding.message for finding in with_a_black_one.findings}
    assert capture.names[3] in told["dark-photographs"]


# ---- jumps that a sharp sensor shows


def test_bars_whose_sides_a_sharp_sensor_shows_do_not_bend_the_lights():
    # 24 degrees where the bars are linked to one another at their sides
    bars = draw(2143, 0.6, depth_factor=1, shape="bars", easy=True)
    capture, truth = render_draw(bars)
    result = run(capture, **DISTANT)
    assert scores(result, truth).normals.mae_deg < 6
    assert np.median(light_errors_deg(result.lights, truth.lights)) < 5


# ---- options


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("depth_weight", value) for value in (0.0, -1.0, np.nan, np.inf, 1e308)),
        ("max_iterations", 0),
        *(("tolerance", value) for value in (0.0, -1e-3, np.nan)),
        ("coarse_pixels", 99),
        ("lights", "green"),
        ("distance", "far"),
    ],
)
def test_impossible_options_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        MultiLight(**{name: value})


# ---- whether distances are those of lights


@pytest.mark.parametrize(
    ("radii", "expected"), [(0.7, True), (1.5, True), (20.0, True), (40.0, False)]
)
def test_lights_are_near_up_to_33_radii(radii, expected):
    level = finest_level(prepare(make_scene()[0]))
    radius = np.linalg.norm(level.points[level.mask], axis=-1).max()
    inverse_distance = np.full((9, 1), 1 / (radii * radius))
    lights = LightParameters(np.ones((9, 1, 3)), np.zeros((9, 1)), inverse_distance)
    assert are_near(level, lights) == expected


def test_known_exposures_give_back_the_relief_that_automatic_exposure_takes():
    cloth = make_shape("cloth")
    options = SceneOptions(camera=cloth.camera.scaled(0.25), depth_noise=CORRELATED)
    capture, truth = render_scene(cloth, make_albedo("pattern"), options)
    light = capture.photographs / capture.white
    exposures = 0.15 / light[:, truth.mask].mean(axis=(1, 2))  # all are as bright then
    values = np.round(65535 * light * exposures[:, None, None, None]).astype(np.uint16)
    changed = replace(capture, photographs=values)

    def error_mm(capture):
        return scores(run(capture, **DISTANT), truth).depth.rmse_mm

    same = error_mm(capture)
    known = replace(changed, exposures=tuple(exposures.tolist()))
    assert error_mm(known) == pytest.approx(same, rel=0.05)
    assert error_mm(changed) > 1.2 * same
