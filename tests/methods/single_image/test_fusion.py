"""The baselines for one photograph: accuracy, the terms of the depth step, what they warn of."""

from dataclasses import fields, replace

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.geometry.averaging import Averaging
from rakelight.geometry.grid import has_gradient, mean_gradient
from rakelight.geometry.normals import surface_normals
from rakelight.methods.levels import Level
from rakelight.methods.single_image import fusion_like as fusion
from rakelight.methods.single_image import rgbd_fusion as rgbd
from rakelight.methods.single_image.depth_energy import Depth, View, laplacian
from rakelight.methods.single_image.texture import texture_likelihood
from rakelight.metrics import evaluate_maps
from rakelight.model import silent
from rakelight.paper.scenes import paper_scene
from rakelight.photometry.piecewise_albedo import edge_weights
from rakelight.prepare import prepare
from tests.methods.single_image.visible_sky import sky
from tests.solve.stalling import stalling_solver

METHODS = {
    "fusion-like": (fusion.fusion_like, fusion.FusionLike),
    "rgbd-fusion": (rgbd.rgbd_fusion, rgbd.RgbdFusion),
}


@pytest.fixture(scope="module")
def scene():
    capture, truth = paper_scene("pattern", "ambient", size=0.5)
    return prepare(capture), truth


@pytest.fixture(scope="module")
def prepared(scene):
    return scene[0]


@pytest.fixture(scope="module", params=METHODS)
def method(request):
    return METHODS[request.param]


def scores(log_depth, prepared, truth):
    depth_m = np.exp(log_depth)
    normals = surface_normals(depth_m, prepared.mask, prepared.camera)
    both = evaluate_maps(prepared.embed(depth_m, np.nan), prepared.embed(normals, np.nan), truth)
    return both.depth.rmse_mm, both.normals.mae_deg


@pytest.fixture(scope="module")
def estimate(prepared, method):
    run, options = method
    return run(prepared, options(), silent)


# ---- the results


def test_result_does_the_prepared_depth_no_harm_on_patterned_paint(estimate, scene):
    prepared, truth = scene
    before = scores(np.log(prepared.depth_m), prepared, truth)
    after = scores(estimate.log_depth, prepared, truth)
    assert (np.array(after) < 1.02 * np.array(before)).all()


def test_without_smoothness_paint_is_carved_into_the_surface(estimate, method, scene):
    run, options = method
    rough = run(scene[0], options(smooth=False), silent)
    assert scores(rough.log_depth, *scene)[1] > 1.1 * scores(estimate.log_depth, *scene)[1]


def test_energy_never_rises(estimate):
    assert len(estimate.energy) > 1
    assert (np.diff(estimate.energy) <= 0).all()
    assert estimate.energy[1] < estimate.energy[0]


def test_albedo_has_its_brightest_at_one(estimate, prepared):
    assert np.percentile(estimate.albedo[prepared.mask], 99) == pytest.approx(1, abs=1e-9)
    assert (estimate.albedo[~prepared.mask] == 0).all()


def test_lights_and_albedo_explain_the_photograph_on_average(estimate, prepared):
    normals = surface_normals(np.exp(estimate.log_depth), prepared.mask, prepared.camera)
    shade = normals @ estimate.lights.vector[0, 0] + estimate.lights.ambient[0, 0]
    model = (estimate.albedo * shade[..., None])[prepared.mask].mean(axis=0)
    np.testing.assert_allclose(model, prepared.pixels(0)[0].mean(axis=0), rtol=0.05)


def test_confidence_is_modest_and_zero_where_the_depth_stayed(method, prepared):
    run, options = method
    still = run(prepared, options(max_iterations=0), silent)
    np.testing.assert_array_equal(
        still.log_depth[prepared.mask], np.log(prepared.depth_m[prepared.mask])
    )
    assert (still.confidence == 0).all()
    moved = run(prepared, options(max_iterations=1), silent).confidence
    assert 0 < moved.max() <= 0.5
    assert (moved[~prepared.mask] == 0).all()


def test_only_the_first_photograph_counts(method, prepared):
    run, options = method
    once = options(max_iterations=1)
    other = np.roll(prepared.photographs, 5, axis=1)
    several = replace(
        prepared,
        photographs=np.concatenate([prepared.photographs, other]),
        names=("a.png", "b.png"),
    )
    one, two = run(prepared, once, silent), run(several, once, silent)
    np.testing.assert_array_equal(one.log_depth, two.log_depth)
    assert [f.code for f in one.findings] == ["single-photograph"]
    assert [(f.severity, f.code) for f in two.findings] == [
        ("warning", "single-photograph"),
        ("note", "first-photograph"),
    ]
    assert "a.png" in two.findings[1].message


def test_saturated_pixels_say_nothing(method, prepared):
    run, options = method
    white = prepared.photographs.copy()
    white[:] = np.iinfo(white.dtype).max
    blind = run(replace(prepared, photographs=white), options(), silent)
    assert np.abs(blind.log_depth - np.log(prepared.depth_m))[prepared.mask].max() < 1e-9
    assert (blind.confidence == 0).all()


LOOP_PX = 8


def loops(shape):
    """Heights (h, w) in pixels of round loops, as steep as they are wide."""
    row, column = 2 * np.pi / LOOP_PX * np.indices(shape)
    return 2.0 * np.sin(row) * np.cos(column)


def knitted(prepared, lining=None):
    """The object as red yarn in loops under the sky: green and blue are black but for noise."""
    one = sky(loops((LOOP_PX, LOOP_PX)), 1.5 * LOOP_PX)
    height, width = prepared.mask.shape
    light = np.tile(one / one.mean(), (height // LOOP_PX + 1, width // LOOP_PX + 1))
    red = 0.6 * light[:height, :width]
    rng = np.random.default_rng(0)
    photograph = np.stack([red, 0 * red, 0 * red], axis=-1) + 0.02 * rng.normal(
        size=(*red.shape, 3)
    )
    if lining is not None:
        photograph[lining] = 0.8
    values = np.round(255 * np.clip(photograph, 0, 1)).astype(np.uint8)
    return replace(prepared, photographs=values[None], encoding="linear")


def test_loops_of_clipped_yarn_under_light_from_all_sides_stand_out(method, prepared):
    run, options = method
    height, yarn = loops(prepared.mask.shape), knitted(prepared)
    seen = View.of(prepared).seen
    with_sky, as_published = (
        -prepared.camera.fx * (run(yarn, each, silent).log_depth - np.log(prepared.depth_m))[seen]
        for each in (options(), options(smooth=False))
    )
    found = np.corrcoef(with_sky, height[seen])[0, 1]
    assert found > 0.93
    assert abs(np.corrcoef(as_published, height[seen])[0, 1]) < 0.1
    # Loops this steep are found two thirds as high: of them light from all sides is not linear.
    assert 0.55 < (with_sky * height[seen]).mean() / (height[seen] ** 2).mean() < 0.75


def test_a_lining_that_shows_between_loops_is_no_hill(method, prepared):
    run, options = method
    row, column = np.indices(prepared.mask.shape)
    lining = (row % 24 < 2) & (column % 24 < 2) & View.of(prepared).seen
    plain, lined = (
        run(knitted(prepared, gaps), options(), silent).log_depth for gaps in (None, lining)
    )
    raised = prepared.camera.fx * (plain - lined)[lining]
    assert abs(raised.mean()) < 0.5  # of loops 4 pixels high


@pytest.mark.parametrize(
    "wrong", [{"lambda_rho": -1.0}, {"sigma_c": 0.0}, {"sigma_d": np.inf}, {"lambda_z1": 0.0}]
)
def test_impossible_options_are_refused(method, wrong):
    with pytest.raises(InputError, match=next(iter(wrong))):
        method[1](**wrong)


# ---- the terms


@pytest.fixture(scope="module")
def depth(prepared):
    view = View.of(prepared)
    light = np.array([0.1, -0.2, -0.5, 0.3])
    albedo = 0.3 + 0.5 * view.intensity
    shading_weight = view.shading_weight(5.0)
    expected = 1e-2 * np.sin(np.indices(view.mask.shape).sum(axis=0))
    return Depth(view, light, albedo, view.intensity, 1e-4, 1e-2, shading_weight, 1e-6, expected)


def photographed(view, colour):
    return replace(view, colour=colour, texture=texture_likelihood(colour, view.level.links))


def test_light_is_found_again(prepared):
    view = View.of(prepared)
    light = np.array([0.1, -0.2, -0.5, 0.3])
    clean = replace(view, intensity=fusion.shading(view, light))
    np.testing.assert_allclose(fusion.harmonics(clean), light, atol=1e-9)


def test_paint_of_another_kind_does_not_bend_the_light(prepared):
    view = View.of(prepared)
    light = np.array([0.1, -0.2, -0.5, 0.3])
    white = np.arange(view.mask.shape[0])[:, None] < view.mask.shape[0] // 3
    clean = replace(view, intensity=fusion.shading(view, light) * np.where(white, 3.0, 1.0))
    np.testing.assert_allclose(fusion.harmonics(clean), light, atol=1e-3)


def test_linear_residual_is_the_image_model(depth):
    view = depth.view
    gradient = mean_gradient(view.level.prior, view.level.links)
    u, v, miss = depth.linear(view.level.normals(view.level.prior)[1])
    expected = depth.albedo * fusion.shading(view, depth.light) - depth.target
    expected *= np.sqrt(depth.shading_weight)
    found = u * gradient[0] + v * gradient[1] + miss
    np.testing.assert_allclose(found[view.seen], expected[view.seen], atol=1e-12)


def averaged(depth):
    """The same under a sensor whose pixels are twice as wide."""
    mask = depth.view.mask
    edges = [np.append(np.arange(0.0, side, 2.0), side) for side in mask.shape]
    level = replace(depth.view.level, averaging=Averaging.on(mask, *edges))
    return replace(depth, view=replace(depth.view, level=level))


@pytest.mark.parametrize("sensor", [lambda depth: depth, averaged])
def test_step_minimises_the_energy_with_lagged_length(depth, sensor):
    depth = sensor(depth)
    prior = depth.view.level.prior
    best = depth.step(prior).value
    length = depth.view.level.normals(prior)[1]

    class Lagged(Level):
        """Its normals keep the length that they have on the prepared depth."""

        def normals(self, log_depth):
            return Level.normals(self, log_depth)[0], length

    level = depth.view.level
    lagged = Lagged(*(getattr(level, field.name) for field in fields(level)))
    depth = replace(depth, view=replace(depth.view, level=lagged))
    least = depth.energy(best)
    rng = np.random.default_rng(0)
    rough = rng.normal(size=prior.shape) * depth.view.mask
    # Along its own way, a step that is too long or too short shows.
    for change in (1e-4 * rough, 1e-3 * rough, 0.1 * (best - prior)):
        up, down = depth.energy(best + change), depth.energy(best - change)
        assert min(up, down) > least
        assert abs(up - down) < 0.02 * (up + down - 2 * least)


def test_shading_is_weighed_where_the_colour_stays_and_not_where_it_changes(prepared):
    view = View.of(prepared)
    shade = fusion.shading(view, np.array([0.1, -0.2, -0.5, 0.3]))
    grey = np.where(view.level.usable, shade[..., None], 0.0)
    assert photographed(view, grey).shading_weight(30.0)[view.mask].min() > 0.99
    stripes = 1 + 0.3 * np.sin(np.arange(view.mask.shape[1]) / 2)[None, :, None] * [1, 0, -1]
    assert (
        replace(view, colour=grey * stripes, texture=0 * shade)
        .shading_weight(30.0)[view.mask]
        .max()
        < 0.25
    )
    assert (view.shading_weight(0.0) == 1).all()


def test_a_border_is_not_seen(prepared):
    view = View.of(prepared)
    inside = np.pad(prepared.mask, 1)
    inner = inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    assert not (view.seen & ~inner).any()
    assert view.seen.mean() > 0.9 * inner.mean()


def test_exposure_changes_nothing_but_the_lights(method, prepared):
    run, options = method
    half = replace(prepared, photographs=prepared.photographs // 4 * 2)
    full = replace(prepared, photographs=prepared.photographs // 4 * 4)
    one, two = (run(each, options(max_iterations=1), silent) for each in (half, full))
    np.testing.assert_allclose(one.log_depth, two.log_depth, atol=1e-6)
    np.testing.assert_allclose(2 * one.lights.vector, two.lights.vector, rtol=0.01)


def test_detail_within_a_sensor_pixel_is_not_held(depth):
    fine = 1e-4 * (np.indices(depth.view.mask.shape).sum(axis=0) % 2 * 2 - 1)
    rest = replace(depth, lambda_z2=0.0, shading_weight=0 * depth.shading_weight, lambda_z1=1.0)
    assert averaged(rest).energy(depth.view.level.prior + fine) < 0.1 * rest.energy(
        depth.view.level.prior + fine
    )


def test_what_occlusion_explains_is_not_explained_by_slopes(prepared):
    view = View.of(knitted(prepared))
    light, rho = np.array([0.0, 0.0, 0.0, 1.0]), np.ones(view.mask.shape)
    depth = fusion.depth_energy(view, light, rho, view.intensity, fusion.FusionLike(), 0.1)
    np.testing.assert_allclose(depth.target, view.intensity - view.contrast())
    assert depth.target[view.seen].std() < 0.4 * view.intensity[view.seen].std()
    published = fusion.FusionLike(smooth=False)
    depth = fusion.depth_energy(view, light, rho, view.intensity, published, 0.1)
    np.testing.assert_array_equal(depth.target, view.intensity)
    assert (depth.expected == 0).all()


def test_a_hollow_may_be_black_but_no_ridge_is_lit_from_more_than_all_sides(prepared):
    view = View.of(knitted(prepared))
    row, column = np.argwhere(view.seen)[np.count_nonzero(view.seen) // 2]
    found = []
    for gain in (0.3, 1.0, 1.7):
        intensity = view.intensity.copy()
        intensity[row, column] = gain
        found.append(replace(view, intensity=intensity).contrast()[row, column])
    assert found[0] < -0.6
    assert found[2] < 2.5 * np.abs(view.contrast()[view.seen]).mean()


def test_smoothness_is_of_what_differs_from_the_occlusion_cue(depth):
    alone = replace(depth, lambda_z1=1e-9, shading_weight=0 * depth.shading_weight, accuracy=1e-9)
    moved = alone.step(depth.view.level.prior).value - depth.view.level.prior
    inner = depth.view.seen
    change, wanted = (laplacian(each, depth.view.mask)[inner] for each in (moved, depth.expected))
    np.testing.assert_allclose(change, wanted, atol=0.05 * np.abs(wanted).max())


def test_no_normal_is_taken_across_a_step(prepared):
    # In log depth, a factor leaves everything but the step as it was.
    middle = prepared.mask.shape[1] // 2
    step = np.where(np.arange(prepared.mask.shape[1]) < middle, 1.0, 1.3)
    views = [
        View.of(each) for each in (prepared, replace(prepared, depth_m=prepared.depth_m * step))
    ]
    one, two = (view.level.normals(view.level.prior)[0] for view in views)
    both = has_gradient(views[0].level.links) & has_gradient(views[1].level.links)
    beside = slice(middle - 1, middle + 1)
    turned = np.linalg.norm(two - one, axis=-1)[:, beside][both[:, beside]]
    assert len(turned) > 100
    assert np.quantile(turned, 0.9) < 0.3


def test_ambient_is_the_minimiser(prepared):
    view, options = View.of(prepared), rgbd.RgbdFusion(lambda_beta1=0.7, lambda_beta2=0.4)
    edges = view.edges(0.1, 0.01, 0.05)
    rng = np.random.default_rng(0)
    left = np.where(view.mask, rng.normal(size=view.mask.shape), 0.0)
    beta = rgbd.ambient(view, left, edges, options)

    def energy(b):
        right, down = (b[:, :-1] - b[:, 1:]) ** 2, (b[:-1] - b[1:]) ** 2
        smooth = (edges[0][:, :-1] * right).sum() + (edges[1][:-1] * down).sum()
        inside = ((b - left) ** 2 * view.seen + 0.4 * b**2)[view.mask].sum()
        return inside + 0.7 * smooth

    for _ in range(3):
        change = 0.01 * rng.normal(size=beta.shape) * view.mask
        up, down = energy(beta + change), energy(beta - change)
        assert abs(up - down) < 0.01 * (up + down - 2 * energy(beta))


def test_paint_of_another_intensity_is_not_linked(prepared):
    view = replace(View.of(prepared), texture=np.zeros(prepared.mask.shape))
    color = view.intensity[..., None]
    linked = view.edges(1.0, 1.0, tau=0.05)[0]
    free = edge_weights(color, np.exp(view.level.prior), view.mask, sigma_c=1.0, sigma_d=1.0)[0]
    apart = np.abs(np.diff(view.intensity, axis=1)) > 0.05
    assert (linked[:, :-1][apart] == 0).all()
    np.testing.assert_allclose(linked[:, :-1][~apart], free[:, :-1][~apart], rtol=1e-4)


# ---- a solver that stalls


def test_a_step_that_the_solver_does_not_find_is_refused(depth):
    depth = replace(depth, accuracy=1e-2)
    start, one = depth.view.level.prior, depth.fixed_point(1, 0.0, silent)
    for after, expected in ((0, start), (1, one.log_depth)):
        with stalling_solver(after) as solved:
            fit = depth.fixed_point(5, 0.0, silent)
        assert solved == [True] * after + [False]
        np.testing.assert_array_equal(fit.log_depth, expected)
        assert fit.energies == one.energies[: after + 1]
        assert not fit.converged
