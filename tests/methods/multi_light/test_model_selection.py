"""What multi-light decides at its coarsest level: the depth weight, lights, ambient light."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rakelight.geometry.camera import back_project
from rakelight.methods.multi_light import (
    FIRST_DEPTH_WEIGHTS,
    MultiLight,
    coarsest_level,
    first_levels,
)
from rakelight.methods.multi_light.energy import first_fit
from rakelight.methods.multi_light.equal_intensity import equal_intensity_energy
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.methods.multi_light.light_model import LightModel
from rakelight.methods.multi_light.model_selection import (
    MOST_VARIED_DISTANCES,
    Search,
    cost,
    sensor_cost,
    try_near_lights,
    variation_of_distances,
    with_coloured_lights,
)
from rakelight.methods.multi_light.notes import notes_of
from rakelight.methods.multi_light.steps import Descent, descend
from rakelight.metrics import evaluate_maps
from rakelight.model import silent
from rakelight.photometry.images import LightParameters
from rakelight.pipeline import refine
from rakelight.pipeline.given_lights import angles_deg
from rakelight.prepare import prepare
from rakelight.prepare.linear import linear_table
from rakelight.solve.robust import NOTABLE
from rakelight.synthetic import (
    DepthNoise,
    SceneOptions,
    make_albedo,
    make_shape,
    random_capture,
    render_scene,
)

CORRELATED = DepthNoise(rms_mm=3.3, correlation_length_px=14.0)
WHITE = DepthNoise(rms_mm=2.5)


@cache
def scene(noise, name="coin", size=1.0, **settings):
    shape = make_shape(name)
    options = SceneOptions(camera=shape.camera.scaled(size), depth_noise=noise, **settings)
    return render_scene(shape, make_albedo("pattern"), options)


@cache
def coarsest(noise, name="coin", size=1.0, **settings):
    """The coarsest level, and the factor of depth weights there."""
    captured, _ = scene(noise, name, size, **settings)
    return coarsest_level(first_levels(prepare(captured), MultiLight())[0])


@cache
def selected(noise, name="coin", size=1.0, weights=FIRST_DEPTH_WEIGHTS, **options):
    level, factor = coarsest(noise, name, size)
    there = [factor * each for each in weights]
    choice = Search(level, there, MultiLight(**options), silent, "look").select()
    return replace(choice, weight=choice.weight / factor)


def test_the_coarsest_level_takes_the_mean_of_errors_for_as_large_as_one():
    levels, _ = first_levels(prepare(scene(CORRELATED)[0]), MultiLight())
    level, factor = coarsest_level(levels)
    weights = [float(np.median(each.sensor_weight)) for each in (level, levels[0], levels[-1])]
    assert weights[0] == pytest.approx(weights[1])
    assert factor == pytest.approx(2 ** (len(levels) - 1) * weights[2] / weights[1])
    assert factor > 100


def test_depth_whose_errors_are_correlated_has_less_weight():
    white, correlated = (selected(noise).weight for noise in (DepthNoise(rms_mm=2.5), CORRELATED))
    assert white >= 1 > 50 * correlated


def test_lights_of_equal_intensity_speak_for_less_weight():
    """Of the coin, a flat surface explains photographs half as well, but its lights are unlike."""
    flat, relief = (
        selected(CORRELATED, weights=(weight,), distance="distant").fit for weight in (10.0, 0.01)
    )
    assert relief.linearization.noise_sigma > 0.5 * flat.linearization.noise_sigma
    level, factor = coarsest(CORRELATED)
    costs = [cost(level, fit, factor * weight) for fit, weight in ((flat, 10.0), (relief, 0.01))]
    unequal = [equal_intensity_energy(fit.lights.vector) for fit in (flat, relief)]
    assert costs[1] < costs[0]
    assert unequal[1] < unequal[0] - 10


def test_correlated_errors_of_the_depth_do_not_flatten_a_coin():
    capture, truth = scene(CORRELATED)
    result = refine(capture, "multi-light")
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 1.5


def test_the_cost_counts_each_photograph_once_and_the_depth_as_all_of_them():
    level, fit = coarsest(CORRELATED)[0], selected(CORRELATED).fit
    here, count = cost(level, fit, 1.0), len(level.photographs)
    # So that what photographs say of the depth stays as it is.
    ten = replace(fit.linearization, jtwj=100 * fit.linearization.jtwj, noise_sigma=10 * sigma(fit))
    rougher = replace(fit, linearization=ten, noise=10 * fit.noise)
    more = cost(level, rougher, 1.0) - here
    assert more == pytest.approx(count * np.log(100))
    without = [
        cost(level, each, 1.0) - count * sensor_cost(level, each, 1.0) for each in (fit, rougher)
    ]
    assert without[1] - without[0] == pytest.approx(more)


def sigma(fit):
    return fit.linearization.noise_sigma


def missed(level, fit, deviations, seed=0):
    """The state at the sensor's depth but for white noise, in deviations of the sensor's."""
    noise = deviations * np.random.default_rng(seed).standard_normal(level.mask.shape)
    return replace(
        fit, log_depth=level.unbiased_prior + noise / np.sqrt(level.prior_weight + 1e-300)
    )


def test_the_sensors_cost_is_the_logarithm_of_its_variance():
    """Where photographs know the depth and nothing is held to it, white noise of 1 and 10 times."""
    level, fit = coarsest(WHITE)[0], selected(WHITE).fit
    known = replace(fit.linearization, jtwj=1e12 * fit.linearization.jtwj)
    fit = replace(fit, linearization=known)
    level = replace(level, relative_noise_variance=1.0)
    found = [sensor_cost(level, missed(level, fit, off), 0.0) for off in (0.0, 3.0, 10.0)]
    assert found == pytest.approx([0.0, np.log(10), np.log(101)], abs=0.1)
    finer = replace(level, relative_noise_variance=0.01)
    assert sensor_cost(finer, missed(level, fit, 0.0), 0.0) == pytest.approx(np.log(0.01))


def test_what_photographs_do_not_say_of_the_depth_costs_nothing():
    """Their variance is added to the sensor's: a miss within it is no error of the sensor."""
    level, fit = coarsest(WHITE)[0], selected(WHITE).fit
    vague = replace(fit.linearization, jtwj=1e-12 * fit.linearization.jtwj)
    near, far = (
        sensor_cost(level, missed(level, replace(fit, linearization=vague), off), 0.0)
        for off in (0.0, 3.0)
    )
    assert far == pytest.approx(near, rel=1e-3)


def test_a_surface_that_follows_the_sensor_does_not_cost_less_for_it():
    """It shows m / (m + w) of what it is off by: the cost does not change where w is counted in."""
    level, fit = coarsest(WHITE)[0], selected(WHITE).fit
    level = replace(level, relative_noise_variance=1e-12)
    known = replace(
        fit, linearization=replace(fit.linearization, jtwj=1e3 * fit.linearization.jtwj)
    )
    free = missed(level, known, 3.0)
    information = known.noise**-2 * known.linearization.typical_information(2.0)
    information *= np.pi**2 / 2 / np.median(level.sensor_weight)  # of single pixels
    held = missed(level, known, 1.5)
    assert sensor_cost(level, held, 0.0) < sensor_cost(level, free, 0.0) - 1
    assert sensor_cost(level, held, information) > sensor_cost(level, free, 0.0)


def test_a_larger_weight_is_tried_while_it_costs_less():
    """Up to the noise from pixel to pixel, and not where a weight was asked for."""
    level, factor = coarsest(WHITE)
    weights = [factor * each for each in FIRST_DEPTH_WEIGHTS]
    best = replace(selected(WHITE), weight=weights[-1])
    bad = replace(best, fit=missed(level, best.fit, 30.0))
    search = Search(level, weights, MultiLight(), silent, "look")
    precise = replace(search, level=replace(level, relative_noise_variance=0.5))
    more = precise.with_larger_weights(bad)
    assert more.weight == pytest.approx(10 * weights[-1])
    assert search.with_larger_weights(bad) is bad
    asked = replace(precise, options=MultiLight(depth_weight=1.0))
    assert asked.with_larger_weights(bad) is bad
    smaller = replace(bad, weight=weights[0])
    assert precise.with_larger_weights(smaller) is smaller


def test_the_cost_counts_unequal_lights_but_not_given_ones():
    level, fit = coarsest(CORRELATED)[0], selected(CORRELATED).fit
    vector = fit.lights.vector
    dimmed = np.linspace(1, 2, len(vector))[:, None, None] * vector
    more = equal_intensity_energy(dimmed) - equal_intensity_energy(vector)
    both = [replace(fit, lights=replace(fit.lights, vector=each)) for each in (vector, dimmed)]
    found = [cost(level, each, 1.0) for each in both]
    assert found[1] - found[0] == pytest.approx(more)
    assert more > 1
    directions = vector / np.linalg.norm(vector, axis=-1, keepdims=True)
    given = LightModel(directions=directions)
    held = [cost(level, replace(each, model=given), 1.0) for each in both]
    assert held[0] == held[1]


def test_lights_beside_the_surface_cost_by_how_little_of_them_arrives():
    """Of a plane the cosine of their tilt, where it is next to none; not their strength."""
    level, fit = coarsest(CORRELATED)[0], selected(CORRELATED).fit
    fit = replace(fit, log_depth=np.full_like(fit.log_depth, np.median(fit.log_depth)))
    turn = 2 * np.pi * np.arange(12) / 12

    def at(tilt_deg, strength):
        tilt = np.radians(tilt_deg) * np.ones(12)
        toward = np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)
        vector = strength * np.stack(toward, axis=-1)[:, None]
        return cost(level, replace(fit, lights=replace(fit.lights, vector=vector)), 1.0)

    before = at(30, 1.0)
    more = 12 * np.log(NOTABLE / np.cos(np.radians(85)) ** 2)
    assert at(85, 1.0) - before == pytest.approx(more, rel=1e-3)
    assert at(75, 100.0) == pytest.approx(before)


def test_lights_that_would_be_very_near_are_penalised():
    level, fit = coarsest(CORRELATED)[0], selected(CORRELATED, distance="distant").fit
    radius_m = np.linalg.norm(level.points[level.mask], axis=-1).max()
    far, by_it = (
        cost(
            level,
            replace(fit, lights=replace(fit.lights, inverse_distance=each * np.ones((12, 1)))),
            1.0,
        )
        for each in (0.0, 1 / radius_m)
    )
    assert by_it - far == pytest.approx(12 * np.log(4))


def test_distances_that_vary_more_than_a_hands_are_penalised():
    """As much as residuals that are as many times larger; never refused."""
    level, fit = coarsest(CORRELATED)[0], selected(CORRELATED, distance="distant").fit
    # Where photographs determine the depth, sigma is not in the sensor's cost.
    known = replace(fit.linearization, jtwj=1e12 * fit.linearization.jtwj)
    fit = replace(fit, linearization=known)
    radius_m = np.linalg.norm(level.points[level.mask], axis=-1).max()

    def at(most):  # the middle half of the inverse distances spans as much as the largest differs
        varied = np.linspace(1 - most, 1 + most, 12)[:, None] / (9 * radius_m)
        return replace(fit, lights=replace(fit.lights, inverse_distance=varied))

    alike, plain, wide = (at(most) for most in (0.0, 0.4, 0.9))
    assert variation_of_distances(alike.lights) == variation_of_distances(fit.lights) == 0
    assert cost(level, plain, 1.0) == cost(level, alike, 1.0)
    beyond = variation_of_distances(wide.lights) / MOST_VARIED_DISTANCES
    assert beyond == pytest.approx(1.8)
    rougher = replace(wide.linearization, noise_sigma=beyond * wide.linearization.noise_sigma)
    without = replace(alike, linearization=rougher)
    assert cost(level, wide, 1.0) == pytest.approx(cost(level, without, 1.0))


def test_the_choice_is_the_least_cost_of_white_and_near_lights():
    (level, factor), free = coarsest(CORRELATED), selected(CORRELATED)
    choices = [free, *(selected(CORRELATED, distance=each) for each in ("near", "distant"))]
    assert [each.fit.model.near for each in choices[1:]] == [True, False]
    choices = [replace(each, weight=factor * each.weight) for each in choices]
    costs = [cost(level, each.fit, each.weight) for each in choices]
    assert costs[0] == min(costs)
    search = Search(level, [1.0], MultiLight(), silent, "look")
    assert search.cheapest(choices[::-1]).fit.energy == free.fit.energy


def test_coloured_lights_are_made_of_white_ones_once():
    level, _ = coarsest(CORRELATED)
    white = first_fit(level, level.prior, lights_of_prior(level))
    coloured = with_coloured_lights(white)
    assert coloured.lights.vector.shape == (12, 3, 3)
    assert with_coloured_lights(coloured) is coloured


def test_low_relief_under_near_lights_keeps_its_height():
    capture, truth = scene(CORRELATED, "cloth", 0.5, lamp_distance_m=0.5, ambient=0.1)
    result = refine(capture, "multi-light")
    slopes = [n[truth.mask][:, 0] / n[truth.mask][:, 2] for n in (result.normals, truth.normals)]
    assert np.polyfit(slopes[1], slopes[0], 1)[0] == pytest.approx(1, abs=0.2)
    assert np.median(result.lights.distance_m) == pytest.approx(0.5, rel=0.05)


def test_near_lights_are_found_over_a_coin():
    """What fall-off makes of a flat object, bent surfaces and lights at random explain as well."""
    noise = DepthNoise(rms_mm=2.5, correlation_length_px=14.0)
    capture, truth = scene(noise, "coin", 0.6, lamp_distance_m=0.6, photographs=16)
    result = refine(capture, "multi-light")
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 5
    assert np.median(result.lights.distance_m) == pytest.approx(0.6, rel=0.1)


def test_strong_highlights_do_not_bend_the_surface():
    glossy = {"specular": 0.6, "lamp_distance_m": 0.6, "photographs": 16}
    capture, truth = scene(CORRELATED, "sphere", 0.4, **glossy)
    result = refine(capture, "multi-light")
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 3


def test_near_lights_are_found_over_a_glossy_coin():
    """Begun at the start of the smallest residuals alone, it stays flat, 12.7 degrees off."""
    glossy = {"specular": 0.15, "cast_shadows": True, "lamp_distance_m": 0.6, "photographs": 16}
    noise = DepthNoise(rms_mm=3.3, correlation_length_px=4.9)
    capture, truth = scene(noise, "coin", 0.35, **glossy, seed=2)
    result = refine(capture, "multi-light")
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 3


def test_near_lights_begin_at_every_start_under_the_largest_and_the_least_weight(monkeypatch):
    near = {"size": 0.4, "name": "vase", "lamp_distance_m": 0.5}
    (level, factor), (exact, _) = (coarsest(noise, **near) for noise in (CORRELATED, DepthNoise()))
    here, there = (first_fit(level, each.prior, lights_of_prior(each)) for each in (level, exact))
    begun = []

    def at_once(level, fit, *_):
        begun.append(fit)
        return Descent(fit, (), converged=True, steps=0)

    monkeypatch.setattr("rakelight.methods.multi_light.model_selection.descend", at_once)
    weights = [factor * each for each in FIRST_DEPTH_WEIGHTS]
    found = Search(level, weights, MultiLight(), silent, "look").near_choices((here, there))
    assert [each.weight for each in found[-2:]] == [weights[0]] * 2
    for first in (begun[:2], begun[-2:]):
        np.testing.assert_array_equal(first[0].log_depth, here.log_depth)
        np.testing.assert_array_equal(first[1].log_depth, there.log_depth)
    assert all((fit.lights.inverse_distance > 0).all() for fit in begun)


def test_near_lights_are_tried_again_at_the_finest_level():
    """From a fit of distant lights, which stays where they are distant, or that was asked for."""
    for lamp_distance_m in (0.5, None):
        capture, _ = scene(CORRELATED, "head", 0.3, lamp_distance_m=lamp_distance_m)
        level = first_levels(prepare(capture), MultiLight())[0][0]
        start = first_fit(level, level.prior, lights_of_prior(level))
        fit = descend(level, start, MultiLight(), silent, "look").fit
        found = try_near_lights(level, fit, MultiLight(), silent)
        asked = try_near_lights(level, fit, MultiLight(distance="distant"), silent)
        assert asked is fit
        if lamp_distance_m is None:
            assert found is fit
        else:
            assert found.model.near
            distance_m = 1 / np.median(found.lights.inverse_distance)
            assert distance_m == pytest.approx(lamp_distance_m, rel=0.2)
            assert found.linearization.noise_sigma < 0.9 * fit.linearization.noise_sigma


def test_a_weight_that_was_asked_for_is_kept():
    capture, _ = scene(CORRELATED, size=0.25)
    result = refine(capture, MultiLight(depth_weight=3.0, max_iterations=2))
    notes = [each.message for each in result.findings if each.code == "depth-weight"]
    assert notes == ["depth weight 3 times white noise's"]


def under_a_torch(capture, truth, seed=0):
    """The capture as if a lamp 0.6 m away, aimed a little beside the object, had a narrow beam."""
    rng = np.random.default_rng(seed)
    points = back_project(np.nan_to_num(truth.depth, nan=np.nanmedian(truth.depth)), capture.camera)
    middle = points[truth.mask].mean(axis=0)
    radius = np.sqrt(2 * ((points[truth.mask] - middle)[:, :2] ** 2).sum(axis=1).mean())
    table = linear_table(capture.photographs.dtype, capture.encoding)
    light = table[capture.photographs]
    for one, toward in zip(light, truth.lights.direction[:, 0], strict=True):
        off = points - middle - rng.normal(0, 0.3 * radius, 3)
        across2 = (off**2).sum(axis=-1) - (off @ toward) ** 2
        one *= np.exp(-across2 / (2 * radius**2))[..., None]
    values = np.round(65535 * light / light.max()).astype(np.uint16)
    return replace(capture, photographs=values, encoding="linear")


def test_a_narrow_beam_is_found_and_does_not_bend_the_surface():
    capture, truth = scene(CORRELATED, "head", 0.4, photographs=12)
    narrow = under_a_torch(capture, truth)
    results = [refine(narrow, MultiLight(beam=beam)) for beam in ("auto", "wide")]
    errors = [evaluate_maps(each.depth, each.normals, truth) for each in results]
    assert errors[0].normals.mae_deg < 0.5 * errors[1].normals.mae_deg
    assert errors[0].depth.rmse_mm < errors[1].depth.rmse_mm
    codes = [{each.code for each in result.findings} for result in results]
    assert "narrow-beam" in codes[0]
    assert "narrow-beam" not in codes[1]
    radius_m = 1 / np.sqrt(2 * results[0].lights.beam[0, 0, 2])
    seen = back_project(results[0].depth, capture.camera)[truth.mask]
    true_m = np.sqrt(2 * ((seen - seen.mean(axis=0))[:, :2] ** 2).sum(axis=1).mean())
    assert radius_m == pytest.approx(true_m, rel=0.25)


@pytest.mark.parametrize("settings", [{}, {"lamp_distance_m": 0.5}])
def test_lamps_without_a_beam_get_none(settings):
    capture, _ = scene(CORRELATED, "head", 0.4, photographs=12, **settings)
    assert refine(capture, "multi-light").lights.beam is None


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("near", [False, True])
def test_the_jacobian_of_beams_is_what_a_step_does(near, shared):
    level = coarsest(CORRELATED, size=0.25)[0]
    vector = lights_of_prior(level).vector
    size, rng = np.linalg.norm(vector, axis=-1), np.random.default_rng(0)
    beam = np.append(rng.normal(0, 3, (*size.shape, 2)), np.full((*size.shape, 1), 20.0), axis=-1)
    lights = LightParameters(vector, 0.2 * size, np.full_like(size, 0.5), beam=beam)
    model = LightModel(near=near, beam=True, shared_ambient=shared)
    free = model.jacobian(lights)
    own = 3 + near + 2 + (not shared)
    assert free.shape == (8 * size.size, own * size.size + 1 + shared)
    step = 1e-6 * rng.normal(size=free.shape[1])
    after = model.moved(lights, step)
    change = (after.numbers - lights.numbers).ravel()
    np.testing.assert_allclose(change, free @ step, atol=1e-11)
    assert np.ptp(after.beam[..., 2]) == 0
    assert after.beam[0, 0, 2] != 20
    assert (after.inverse_distance != lights.inverse_distance).any() == near


@pytest.mark.parametrize("near", [False, True])
def test_a_shared_ambient_ratio_is_kept_by_a_step(near):
    level = coarsest(CORRELATED, size=0.25)[0]
    vector = lights_of_prior(level).vector
    size = np.linalg.norm(vector, axis=-1)
    lights = LightParameters(vector, 0.2 * size, np.full_like(size, 0.5))
    model = LightModel(near=near, shared_ambient=True)
    free = model.jacobian(lights)
    step = 1e-6 * np.random.default_rng(0).normal(size=free.shape[1])
    after = model.moved(lights, step)
    ratio = after.ambient / np.linalg.norm(after.vector, axis=-1)
    assert np.ptp(ratio) < 1e-12
    linear = LightModel(near=near).moved(lights, free @ step)
    np.testing.assert_allclose(linear.vector, after.vector, atol=1e-12)
    np.testing.assert_allclose(linear.ambient, after.ambient, atol=1e-10)


def beside_a_window(window, seed=4):
    """A drawn capture half as bright by a window, or by light from everywhere, as by its lamp."""
    plain = {"easy": True, "shape": "stone", "photographs": 10, "near_radii": 4.0, "ambient": 0.5}
    return random_capture(seed, 0.5, **plain, lights="cone", tilt_deg=50.0, window=window)


def test_a_window_is_found_and_does_not_turn_the_lamps():
    found, errors = [], []
    for window in (1.0, 0.0):
        capture, truth = beside_a_window(window)
        result = refine(capture, "multi-light")
        angle = angles_deg(result.lights.direction[:, 0], truth.lights.direction[:, 0])
        errors.append(np.median(angle))
        found.append({each.code for each in result.findings})
    assert "room-light" in found[0]
    assert "room-light" not in found[1]
    assert errors[0] < 3


def test_the_direction_of_ambient_light_is_at_most_that_of_one_point():
    lights = LightParameters.distant(np.ones((2, 1, 3)), np.ones((2, 1)))
    far = lights.moved(np.zeros((2, 1, 4)), 0.0, np.array([0.0, -6.0, 8.0]))
    np.testing.assert_allclose(far.ambient_direction, [0, -1.2, 1.6])
    near = lights.moved(np.zeros((2, 1, 4)), 0.0, np.array([0.0, -0.6, 0.8]))
    np.testing.assert_allclose(near.ambient_direction, [0, -0.6, 0.8])


@pytest.mark.parametrize(
    ("direction", "words"),
    [([-0.8, 0.1, -0.5], "the left and the camera"), ([0.1, -1.0, 0.2], "above")],
)
def test_the_side_of_the_room_light_is_said(direction, words):
    lights = LightParameters.distant(np.ones((2, 1, 3)), np.ones((2, 1)))
    level = coarsest(CORRELATED, size=0.25)[0]
    one_side = replace(lights, ambient_direction=np.array(direction))
    notes = {each.code: each.message for each in notes_of(level, one_side, 1.0, 1.0, 0.0)}
    assert f"the room's light is 58 % of the lamp's, most from {words};" in notes["room-light"]
    even = {each.code for each in notes_of(level, lights, 1.0, 1.0, 0.0)}
    assert "room-light" not in even
