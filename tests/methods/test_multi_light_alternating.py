"""The alternating multi-light method: accuracy, symmetries, what it leaves out, when it ends."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.errors import InputError, MethodError
from rakelight.geometry.normals import normals_from_gradient
from rakelight.methods.levels import finest_level
from rakelight.methods.multi_light_alternating import (
    HORIZON_ROUNDS,
    MultiLightAlternating,
    light_and_albedo,
    lights_at_camera,
    multi_light_alternating,
)
from rakelight.metrics import evaluate_depth, evaluate_maps
from rakelight.model import Camera, silent
from rakelight.photometry.forward import lit, shading
from rakelight.photometry.images import LightParameters
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene
from tests.capture.capture_builder import told_apart
from tests.solve.stalling import stalling_solver

# Close to the object, as at full resolution, but only a small window of it.
CAMERA = make_shape("cloth").camera.cropped(slice(140, 200), slice(200, 280))
# More rounds than a good surface needs: the lights creep to their place.
PATIENT = MultiLightAlternating(max_iterations=40, tolerance=5e-3)


def make_scene(**changes):
    options = SceneOptions(
        camera=CAMERA, photographs=6, depth_noise=DepthNoise(rms_mm=3.0), image_noise=0.005
    )
    return render_scene(make_shape("cloth"), make_albedo("pattern"), replace(options, **changes))


def run(capture, **settings):
    return refine(capture, "multi-light-alternating", **settings)


def largest_change_mm(depth, other):
    np.testing.assert_array_equal(np.isnan(depth), np.isnan(other))
    return 1000 * np.nanmax(np.abs(depth.astype(float) - other))


def moved_mm(result):
    return largest_change_mm(result.depth, result.prepared_depth)


def rms_mm(result, truth):
    return 1000 * np.sqrt(np.nanmean((result.depth - truth.depth) ** 2))


# ---- accuracy


@pytest.mark.parametrize("factor", [1, 2])
def test_normals_are_three_times_better_than_the_prepared_ones(factor):
    noise = DepthNoise(rms_mm=2.5, correlation_length_px=6.0)
    capture, truth = make_scene(depth_factor=factor, depth_noise=noise, photographs=8)
    result = run(capture, options=replace(MultiLightAlternating(), max_iterations=40))
    first = evaluate_depth(result.prepared_depth, result.camera, truth)
    last = evaluate_maps(result.depth, result.normals, truth)
    assert last.normals.mae_deg < first.normals.mae_deg / 3
    assert last.depth.rmse_mm < first.depth.rmse_mm
    assert result.converged


def test_lights_are_found(scene):
    result, truth = run(scene[0], options=PATIENT), scene[1].lights
    angle = np.degrees(np.arccos((result.lights.direction * truth.direction).sum(axis=-1)))
    assert angle.max() < 8
    # intensities up to the common factor that albedo and light share
    ratio = result.lights.intensity / truth.intensity
    assert ratio.std() / ratio.mean() < 0.1


def test_albedo_has_its_brightest_at_one(result):
    inside = result.albedo[result.mask]
    assert np.percentile(inside, 99) == pytest.approx(1, abs=1e-6)
    assert (result.albedo[~result.mask] == 0).all()


def test_the_image_is_explained_to_its_noise(capture, result):
    errors = []
    for i in range(len(capture.photographs)):
        s, phi = result.lights.vector[i, 0], result.lights.ambient[i, 0]
        predicted = result.albedo * shading(result.normals, s, phi)[..., None]
        errors.append((predicted - capture.photographs[i] / 65535)[capture.mask])
    assert np.sqrt(np.mean(np.square(errors))) < 3 * 0.005


# ---- the terms of one depth step


def rough_fit(capture, seed=0):
    """A prepared capture, its level, and a rough surface with the albedo and lights that fit it."""
    prepared = prepare(capture)
    level = finest_level(prepared)
    rng = np.random.default_rng(seed)
    log_depth = level.prior + 1e-3 * rng.normal(size=level.mask.shape)
    fit = light_and_albedo(
        level, log_depth, np.ones((*level.mask.shape, 3)), lights_at_camera(len(prepared))
    )
    return prepared, level, light_and_albedo(level, log_depth, fit.linearization.albedo, fit.lights)


def normals_of(fit, level):
    """Normals (P, 3) and |m| (P,) on the mask."""
    g = fit.surface.gradient
    both = normals_from_gradient(g[..., 0], g[..., 1], level.photographs.camera)
    return tuple(each[level.mask] for each in both)


def lagged_squares(prepared, level, fit, gradient):
    """(P,) squared residuals of the image model at `gradient` (P, 2), |m| and shadows lagged."""
    inner = level.photographs.active[level.mask]
    normals, length = normals_of(fit, level)
    albedo = fit.linearization.albedo[level.mask]
    rows, columns = np.nonzero(level.mask)
    camera = prepared.camera
    x, y = columns - camera.cx, rows - camera.cy
    p_u, p_v = gradient.T
    m = np.stack([camera.fx * p_u, camera.fy * p_v, -(1 + x * p_u + y * p_v)], axis=-1)
    total = np.zeros(len(m))
    for i in range(len(prepared)):
        image, good = prepared.pixels(i)
        s, phi = fit.lights.vector[i, 0], fit.lights.ambient[i, 0]
        model = albedo * (lit(normals, s) * (m @ s) / length + phi)[:, None]
        total += ((model - image) ** 2 * good * inner[:, None]).sum(axis=1)
    return total


def test_depth_terms_are_the_lagged_squares(capture):
    mask = capture.mask.copy()
    mask[20, 30:50] = False
    mask[19:22, 40] = True  # pixels without a neighbour along u
    prepared, level, fit = rough_fit(replace(capture, mask=mask))
    tensor, rhs = (each[level.mask] for each in fit.linearization.normal_equations(fit.surface))
    uu, uv, vv = tensor.T

    def quadratic(g):
        u, v = g.T
        return uu * u * u + 2 * uv * u * v + vv * v * v - 2 * (rhs * g).sum(axis=1)

    rng = np.random.default_rng(1)
    at = fit.surface.gradient[level.mask]
    here = lagged_squares(prepared, level, fit, at)
    for size in (1e-3, 0.1):
        other = at + size * rng.normal(size=at.shape)
        change = lagged_squares(prepared, level, fit, other) - here
        np.testing.assert_allclose(
            quadratic(other) - quadratic(at), change, atol=1e-9 * np.abs(change).max()
        )


def test_depth_terms_are_the_derivative(capture):
    prepared, level, fit = rough_fit(capture)
    slope = -2 * fit.linearization.rhs[level.mask]
    at, step = fit.surface.gradient[level.mask], 1e-4
    for axis in (0, 1):
        ahead, behind = at.copy(), at.copy()
        ahead[:, axis] += step
        behind[:, axis] -= step
        difference = lagged_squares(prepared, level, fit, ahead) - lagged_squares(
            prepared, level, fit, behind
        )
        np.testing.assert_allclose(
            slope[:, axis], difference / (2 * step), atol=1e-6 * np.abs(slope).max()
        )


def test_noise_is_the_rms_of_what_is_counted(capture):
    prepared, level, fit = rough_fit(capture)
    squares = lagged_squares(prepared, level, fit, fit.surface.gradient[level.mask]).sum()
    counted = fit.linearization.observations
    assert counted == sum(prepared.pixels(i)[1].sum() for i in range(6))
    assert fit.noise == pytest.approx(np.sqrt(squares / counted), rel=1e-9)


def plain_lights(prepared, normals, albedo, lights):
    """(N, 4) the light of each photograph in plain numpy, by least squares without bounds."""
    solved = []
    for i in range(len(prepared)):
        image, good = prepared.pixels(i)
        light = np.append(lights.vector[i, 0], lights.ambient[i, 0])
        for _ in range(HORIZON_ROUNDS):
            shown = lit(normals, light[:3])[:, None]
            rows = np.concatenate([normals * shown, np.ones((len(normals), 1))], axis=1)
            matrix = (albedo[..., None] * rows[:, None])[good]
            light = np.linalg.lstsq(matrix, image[good], rcond=None)[0]
        solved.append(light)
    return np.array(solved)


def test_light_and_albedo_are_the_plain_ones(capture):
    prepared, level, fit = rough_fit(capture)
    assert level.photographs.active.sum() == level.mask.sum()
    normals, _ = normals_of(fit, level)
    albedo = fit.linearization.albedo
    found = light_and_albedo(level, fit.log_depth, albedo, fit.lights)

    lights = plain_lights(prepared, normals, albedo[level.mask], fit.lights)
    seen = [prepared.pixels(i) for i in range(len(lights))]
    images, good = (np.stack(part) for part in zip(*seen, strict=True))
    shades = np.stack([shading(normals, light[:3], light[3]) for light in lights])[..., None]
    best = (good * shades * images).sum(axis=0) / (good * shades**2).sum(axis=0)
    scale = np.percentile(best, 99)
    assert np.abs(found.lights.vector - fit.lights.vector).max() > 1e-3
    np.testing.assert_allclose(found.lights.vector[:, 0], scale * lights[:, :3], atol=1e-6)
    np.testing.assert_allclose(found.lights.ambient, scale * lights[:, 3:], atol=1e-6)
    np.testing.assert_allclose(found.linearization.albedo[level.mask], best / scale, atol=1e-6)


def synthetic(prepared, level, fit, lights, ambient):
    """The level with clean photographs of the fit's surface and albedo under other lights."""
    normals, _ = normals_of(fit, level)
    albedo = np.clip(fit.linearization.albedo[level.mask], 0.2, 0.9)
    photographs = np.zeros((len(ambient), *level.mask.shape, 3), np.uint16)
    for photograph, vector, phi in zip(photographs, lights, ambient, strict=True):
        light = np.maximum(albedo * (np.maximum(normals @ vector, 0) + phi)[:, None], 0)
        assert light.max() < 0.98
        photograph[level.mask] = np.rint(65535 * light)
    scene = finest_level(replace(prepared, photographs=photographs))
    return scene, np.clip(fit.linearization.albedo, 0.2, 0.9)


VECTOR = np.array([[0.3, 0.1, -0.6], [-0.2, 0.4, -0.5], [0.1, -0.3, -0.7]])


def test_light_and_albedo_come_back_from_a_clean_image(capture):
    # From the true albedo one step finds the true lights, and the albedo stays.
    prepared, level, fit = rough_fit(capture)
    ambient = np.array([0.05, 0.1, 0.02])
    clean, albedo = synthetic(prepared, level, fit, VECTOR, ambient)
    true = LightParameters.distant(VECTOR[:, None], ambient[:, None])
    found = light_and_albedo(clean, fit.log_depth, albedo, true)
    scale = np.percentile(albedo[level.mask], 99)
    np.testing.assert_allclose(found.lights.vector, scale * true.vector, atol=2e-4)
    np.testing.assert_allclose(found.lights.ambient, scale * true.ambient, atol=2e-4)
    np.testing.assert_allclose(
        found.linearization.albedo[level.mask], albedo[level.mask] / scale, atol=1e-3
    )


def test_where_ambient_light_would_be_negative_the_rest_is_the_best_without(capture):
    # A black level set too high: the best fit by far would be -0.1.
    prepared, level, fit = rough_fit(capture)
    dark, albedo = synthetic(prepared, level, fit, VECTOR, np.full(3, -0.1))
    start = LightParameters.distant(VECTOR[:, None], np.zeros((3, 1)))
    found = light_and_albedo(dark, fit.log_depth, albedo, start)
    assert (found.lights.ambient == 0).all()
    # at the optimum no change of a light's vector lowers the squares
    normals, _ = normals_of(fit, level)
    values = dark.photographs.values[:, level.mask]
    for i in range(3):
        good = (values[i] >= dark.photographs.low) & (values[i] <= dark.photographs.high)
        shown = lit(normals, found.lights.vector[i, 0])[:, None]
        matrix = (albedo[level.mask][..., None] * (normals * shown)[:, None])[good]
        best = np.linalg.lstsq(matrix, values[i][good] / 65535, rcond=None)[0]
        direction = found.lights.vector[i, 0] / np.linalg.norm(found.lights.vector[i, 0])
        np.testing.assert_allclose(direction, best / np.linalg.norm(best), atol=0.01)


# ---- how it ends


def test_the_best_iterate_is_returned(capture):
    # Whatever the number of rounds, the answer is that of the round of least energy.
    estimates = [
        multi_light_alternating(
            prepare(capture), MultiLightAlternating(max_iterations=rounds, tolerance=-1.0), silent
        )
        for rounds in range(9)
    ]
    last = estimates[-1]
    assert len(last.energy) == 9
    best = int(np.argmin(last.energy))
    np.testing.assert_array_equal(last.log_depth, estimates[best].log_depth)
    np.testing.assert_array_equal(last.lights.vector, estimates[best].lights.vector)
    for rounds, estimate in enumerate(estimates):
        assert estimate.energy == last.energy[: rounds + 1]
        assert min(estimate.energy) >= min(last.energy)


def test_a_rising_energy_is_never_returned(capture, monkeypatch):
    # A solver that goes astray in the second round.
    from rakelight.methods import multi_light_alternating as module

    calls, real = [], module.solve

    def astray(system, **options):
        calls.append(1)
        solution = real(system, **options)
        if len(calls) > 1:
            noise = np.random.default_rng(0).normal(0, 0.01, system.mask.shape)
            return replace(solution, value=solution.value + noise)
        return solution

    one = multi_light_alternating(prepare(capture), MultiLightAlternating(max_iterations=1), silent)
    monkeypatch.setattr(module, "solve", astray)
    estimate = multi_light_alternating(prepare(capture), MultiLightAlternating(), silent)
    assert len(calls) == 2
    assert estimate.energy[2] > estimate.energy[1]
    assert not estimate.converged
    np.testing.assert_array_equal(estimate.log_depth, one.log_depth)


def test_no_rounds_leave_the_prepared_depth(capture):
    result = run(capture, options=MultiLightAlternating(max_iterations=0))
    np.testing.assert_allclose(result.depth, result.prepared_depth, rtol=1e-6)
    assert result.iterations == 0
    assert not result.converged
    assert [f.code for f in result.findings] == ["not-converged"]


@pytest.mark.parametrize(("tolerance", "more"), [(1.0, 1), (1e-4, 4)])
def test_tolerance_decides_when_it_rests(capture, tolerance, more):
    result = run(capture, options=MultiLightAlternating(tolerance=tolerance))
    gains = -np.diff(result.energy)
    assert result.converged or result.iterations == MultiLightAlternating().max_iterations
    assert result.iterations >= more
    assert (gains[:-1] > tolerance).all()


def test_depth_weight_keeps_the_surface(capture, result):
    firm = run(capture, options=MultiLightAlternating(depth_weight=1e9))
    assert moved_mm(firm) < 1e-2
    assert moved_mm(result) > 1


# ---- laws


@pytest.fixture
def exact(monkeypatch):
    """Depth solves to the last digits, so that laws are not blurred by what a solve leaves."""
    from rakelight.methods import multi_light_alternating as module

    real = module.solve
    monkeypatch.setattr(
        module, "solve", lambda system, **how: real(system, **{**how, "tolerance": 1e-8})
    )


def test_the_order_of_the_photographs_does_not_matter(capture, result):
    order = [3, 0, 5, 1, 4, 2]
    other = run(capture.select(order))
    assert largest_change_mm(other.depth, result.depth) < 1e-4
    np.testing.assert_allclose(other.lights.vector, result.lights.vector[order], atol=1e-6)
    assert [other.photograph_names[i] for i in range(6)] == [f"{i:03d}.png" for i in order]


@pytest.mark.parametrize("gain", [0.5, 0.25])
def test_exposure_goes_into_the_light(gain):
    # Clean photographs, so that the darker one does not count as the noisier one.
    capture, _ = make_scene(image_noise=0.0)
    photographs = capture.photographs.copy()
    photographs[2] = np.rint(gain * photographs[2].astype(float))
    first = run(capture, options=PATIENT)
    second = run(replace(capture, photographs=photographs), options=PATIENT)
    ratio = second.lights.intensity / first.lights.intensity
    assert ratio[2] / np.delete(ratio, 2).mean() == pytest.approx(gain, rel=0.03)
    np.testing.assert_allclose(np.delete(ratio, 2), np.delete(ratio, 2).mean(), rtol=0.03)
    assert largest_change_mm(second.depth, first.depth) < 0.4 * moved_mm(first)


@pytest.mark.usefixtures("exact")
def test_twice_the_distance_gives_twice_the_depth():
    # Where the noise is read from the map, it doubles with it, and so does all the rest.  (The
    # sensor's own noise would grow fourfold: at 1.6 m it is 3.6 mm, hence the 5 mm here.)
    capture, _ = make_scene(depth_noise=DepthNoise(rms_mm=5.0))
    near, far = (
        run(capture),
        run(replace(capture, depth_m=2 * capture.depth_m)),
    )
    assert far.prepared_depth[capture.mask] == pytest.approx(2 * near.prepared_depth[capture.mask])
    assert largest_change_mm(far.depth, 2 * near.depth) < 1e-3 * moved_mm(near)
    np.testing.assert_allclose(far.normals, near.normals, atol=1e-3)


def mirrored(capture):
    """The capture seen in a mirror: left and right exchanged."""
    camera = capture.camera
    return replace(
        capture,
        photographs=capture.photographs[:, :, ::-1],
        depth_m=capture.depth_m[:, :, ::-1],
        mask=capture.mask[:, ::-1],
        camera=replace(camera, cx=camera.width - 1 - camera.cx),
    )


def turned(capture):
    """The capture with u and v exchanged."""
    c = capture.camera
    return replace(
        capture,
        photographs=capture.photographs.swapaxes(1, 2),
        depth_m=capture.depth_m.swapaxes(1, 2),
        mask=capture.mask.T,
        camera=Camera(c.height, c.width, c.fy, c.fx, c.cy, c.cx),
    )


@pytest.mark.usefixtures("exact")
@pytest.mark.parametrize("factor", [1, 2])
def test_left_and_right_up_and_down_are_alike(factor):
    # A shift of half a pixel anywhere on the way would break this.
    capture, _ = make_scene(depth_factor=factor)
    if factor == 1:  # finer depth goes on outside from the nearest pixel, and two can be as near
        mask = capture.mask.copy()
        mask[:13, :21] = mask[40:, 60:] = mask[31, 40:50] = False
        capture = replace(capture, mask=mask)
    first = run(capture)
    second, third = (
        run(mirrored(capture)),
        run(turned(capture)),
    )
    assert largest_change_mm(second.depth[:, ::-1], first.depth) < 1e-3
    np.testing.assert_allclose(second.lights.vector * [-1, 1, 1], first.lights.vector, atol=1e-5)
    assert largest_change_mm(third.depth.T, first.depth) < 1e-3
    np.testing.assert_allclose(third.lights.vector[..., [1, 0, 2]], first.lights.vector, atol=1e-5)


# ---- what is left out


@pytest.mark.parametrize("value", [0, 65535, 65000, 200])
def test_a_photograph_that_shows_nothing_changes_nothing(capture, result, value):
    blank = np.full_like(capture.photographs[:1], value)
    photographs = np.concatenate([capture.photographs[:4], blank, capture.photographs[4:]])
    names = (*capture.names[:4], "blank.png", *capture.names[4:])
    other = run(replace(capture, photographs=photographs, names=names))
    assert largest_change_mm(other.depth, result.depth) < 1e-4
    assert other.lights.intensity[4] == 0
    np.testing.assert_allclose(
        np.delete(other.lights.vector, 4, axis=0), result.lights.vector, atol=1e-6
    )


def test_what_saturated_values_hold_does_not_matter(capture):
    where = np.random.default_rng(0).random(capture.photographs.shape) < 0.1
    depths = [
        run(
            replace(capture, photographs=np.where(where, value, capture.photographs)),
        ).depth
        for value in (np.uint16(65535), np.uint16(64300))
    ]
    np.testing.assert_array_equal(*depths)


def test_values_outside_the_mask_do_not_matter(capture):
    mask = capture.mask.copy()
    mask[:, :11] = mask[45:] = False
    bright = np.where(mask[..., None], capture.photographs, 30000).astype(np.uint16)
    first = run(replace(capture, mask=mask))
    second = run(replace(capture, mask=mask, photographs=bright))
    np.testing.assert_array_equal(first.depth, second.depth)


def test_results_are_finite_on_the_mask_and_empty_off_it(capture):
    mask = capture.mask.copy()
    mask[:20, :20] = False
    result = run(replace(capture, mask=mask))
    for name in ("depth", "normals", "prepared_depth"):
        image = getattr(result, name)
        assert np.isfinite(image[mask]).all()
        assert np.isnan(image[~mask]).all()
        assert image.dtype == np.float32
    for name in ("albedo", "confidence"):
        image = getattr(result, name)
        assert np.isfinite(image).all()
        assert (image[~mask] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(result.normals[mask], axis=-1), 1, atol=1e-6)
    assert (result.depth[mask] > 0).all()


# ---- confidence


def test_confidence_is_high_where_seen_and_nought_where_not(capture):
    photographs = capture.photographs.copy()
    photographs[:, 20:35, 30:50] = 0
    photographs[:, 40:50, 10:20] = 65535
    result = run(replace(capture, photographs=photographs))
    unseen = np.zeros(capture.mask.shape, bool)
    unseen[20:35, 30:50] = unseen[40:50, 10:20] = True
    assert (result.confidence >= 0).all()
    assert (result.confidence <= 1).all()
    assert result.confidence[unseen & capture.mask].max() < 1e-6
    assert result.confidence[~unseen & capture.mask].min() > 0.5


def test_confidence_grows_with_the_photographs(capture):
    few, many = (
        run(capture.select(range(4))),
        run(capture),
    )
    assert np.median(few.confidence) < np.median(many.confidence)


@pytest.mark.parametrize("photograph", [0, 3])
def test_one_lamp_seen_many_times_determines_nothing(capture, photograph):
    result = run(told_apart(capture.select([photograph] * 6)))
    assert result.confidence.max() < 0.05


def test_noise_lowers_the_confidence():
    clean, noisy = (run(make_scene(image_noise=noise)[0]).confidence for noise in (0.005, 0.05))
    assert np.median(noisy) < np.median(clean) - 0.1


# ---- thin and separate parts, missing depth


def with_mask(capture, *windows):
    mask = np.zeros(capture.mask.shape, bool)
    for window in windows:
        mask[window] = True
    return replace(capture, mask=mask & capture.mask)


def test_pixels_without_a_normal_keep_the_prepared_depth(capture):
    body = np.s_[:, :40]
    thin = (np.s_[10, 60], np.s_[20, 50:70], np.s_[30:50, 75])
    result = run(with_mask(capture, body, *thin))
    alone = run(with_mask(capture, body))
    for window in thin:
        np.testing.assert_array_equal(result.depth[window], result.prepared_depth[window])
        assert (result.confidence[window] < 1e-9).all()
    # and the body does not feel them: same window of the camera, other prepared depth noise only
    assert largest_change_mm(result.depth[:, :40], alone.depth[:, :40]) < 0.05 * moved_mm(alone)


def test_parts_are_solved_each(capture):
    result = run(with_mask(capture, np.s_[5:30, 5:35], np.s_[30:58, 45:78]))
    for part in (np.s_[5:30, 5:35], np.s_[30:58, 45:78]):
        assert np.abs(result.depth[part] - result.prepared_depth[part]).max() > 1e-3
        assert result.confidence[part].min() > 0.3


# Strips drift along the bas-relief valley; what is as wide as it is high hardly does.
@pytest.mark.parametrize(
    ("window", "most_mm"),
    [(np.s_[:, 0:2], 2.5), (np.s_[0:2, :], 7.5), (np.s_[-9:, -9:], 1.4), (np.s_[:, :], 1.3)],
)
def test_objects_at_the_frame(scene, window, most_mm):
    capture, truth = scene
    part = with_mask(capture, window)
    result = run(part)
    np.testing.assert_array_equal(result.mask, part.mask)
    assert rms_mm(result, truth) < most_mm


def test_holes_and_a_part_without_depth(scene):
    capture, truth = scene
    part = with_mask(capture, np.s_[5:30, 5:35], np.s_[35:58, 45:78])
    depth = part.depth_m.copy()
    depth[:, 10:20, 10:20] = np.nan
    depth[:, 33:] = np.nan
    result = run(replace(part, depth_m=depth))
    kept = np.zeros(part.mask.shape, bool)
    kept[5:30, 5:35] = True  # what is far from all depth is left out
    np.testing.assert_array_equal(result.mask, kept)
    assert rms_mm(result, truth) < 1.4
    assert np.abs(result.depth - truth.depth)[10:20, 10:20].max() < 0.0012


@pytest.mark.parametrize("window", [np.s_[30, 40], np.s_[30, :], np.s_[:, 40]])
def test_a_mask_without_any_normal(capture, window):
    result = run(with_mask(capture, window))
    np.testing.assert_array_equal(result.depth[window], result.prepared_depth[window])


@pytest.mark.parametrize("value", [0, 65535])
def test_photographs_that_all_show_nothing(capture, value):
    blank = replace(capture, photographs=np.full_like(capture.photographs, value))
    with pytest.raises(InputError):
        run(blank)


def test_photographs_that_show_only_pixels_without_a_normal(capture):
    part = with_mask(capture, np.s_[:, :40], np.s_[10, 60])
    photographs = part.photographs.copy()
    photographs[:, :, :41] = 0
    with pytest.raises(InputError):
        run(replace(part, photographs=photographs))


def test_photographs_without_any_contrast(capture):
    grey = replace(capture, photographs=np.full_like(capture.photographs, 20000))
    result = run(told_apart(grey))
    np.testing.assert_array_equal(result.depth, result.prepared_depth)


# ---- too few photographs


@pytest.mark.parametrize(
    ("count", "factor", "needed"), [(3, 1, 4), (2, 1, 4), (6, 4, 16), (3, 2, 4)]
)
def test_too_few_photographs(count, factor, needed):
    capture, _ = make_scene(photographs=count, depth_factor=factor)
    with pytest.raises(MethodError, match="too few photographs") as error:
        run(capture)
    assert error.value.seen == str(count)
    assert error.value.needed == f"at least {needed}"


def test_at_the_depths_resolution_fewer_suffice():
    capture, _ = make_scene(photographs=4, depth_factor=4)
    assert run(capture, scale=1).depth.shape == (15, 20)
    assert run(capture, scale=2).depth.shape == (30, 40)


# ---- a solver that stalls


def test_a_step_that_the_solver_does_not_find_is_refused(capture):
    prepared = prepare(capture)
    one = multi_light_alternating(prepared, MultiLightAlternating(max_iterations=1), silent)
    with stalling_solver(after=1) as solved:
        estimate = multi_light_alternating(prepared, MultiLightAlternating(), silent)
    assert solved == [True, False]
    np.testing.assert_array_equal(estimate.log_depth, one.log_depth)
    assert estimate.energy == one.energy
    assert not estimate.converged
