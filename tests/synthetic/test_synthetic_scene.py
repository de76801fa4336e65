"""Laws of the rendering, on small scenes without noise unless noise is the matter."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import area_mean
from rakelight.model import Camera, RigidTransform
from rakelight.photometry.forward import arriving
from rakelight.prepare import prepare
from rakelight.prepare.linear import to_linear
from rakelight.prepare.sensor import depth_camera_of
from rakelight.synthetic import (
    Albedo,
    DepthNoise,
    SceneOptions,
    Shape,
    Surface,
    make_albedo,
    make_shape,
    render_scene,
)
from rakelight.synthetic.shapes import VIEW

SMALL = VIEW.scaled(0.25)
SPHERE = make_shape("sphere")
QUIET = SceneOptions(camera=SMALL, image_noise=0, exposure=0.6, photographs=3)
STEP = 0.5 / 65535 + 1e-7
"""Rounding of 16-bit values."""


def painted(reflectance):
    return Albedo("paint", lambda camera, rows: np.full((*camera.shape, 3), reflectance)[rows])


def photographs(shape=SPHERE, albedo=None, **options):
    """Linear photographs (N, H, W, 3), mask and truth of a quiet scene."""
    capture, truth = render_scene(shape, albedo or painted(0.5), replace(QUIET, **options))
    return capture.photographs / 65535, capture.mask, truth


def first_order(truth, i, mask):
    """(M, C) shading of photograph i under the truth's lights."""
    lights = truth.lights
    cosine = truth.normals[mask].astype(float) @ lights.vector[i].T
    return np.maximum(cosine, 0) + lights.ambient[i]


@pytest.mark.parametrize("lighting", ["moving-lamp", "rgb-leds", "ambient"])
def test_photographs_follow_from_the_truth(lighting):
    images, mask, truth = photographs(
        albedo=make_albedo("pattern"), lighting=lighting, supersampling=1, exposure_spread=0.2
    )
    for i, image in enumerate(images):
        expected = truth.albedo[mask] * first_order(truth, i, mask)
        assert np.abs(image[mask] - expected).max() < STEP + 1e-6


def test_supersampled_photographs_differ_only_where_the_surface_bends():
    images, mask, truth = photographs(supersampling=2)
    expected = truth.albedo[mask] * first_order(truth, 0, mask)
    off = np.abs(images[0][mask] - expected)
    assert np.median(off) < 1e-4
    assert off.max() < 0.05


def test_doubling_the_albedo_doubles_the_photograph():
    dark, mask, _ = photographs(albedo=painted(0.4))
    bright, _, _ = photographs(albedo=painted(0.8))
    assert np.abs(bright - 2 * dark)[:, mask].max() < 3 * STEP
    assert bright[:, mask].max() > 0.4


def test_doubling_the_exposure_doubles_the_photograph_and_the_lights():
    dim, mask, truth = photographs(exposure=0.3)
    bright, _, brighter = photographs(exposure=0.6)
    assert np.abs(bright - 2 * dim)[:, mask].max() < 3 * STEP
    assert np.allclose(brighter.lights.vector, 2 * truth.lights.vector, rtol=1e-12)
    assert np.allclose(brighter.lights.ambient, 2 * truth.lights.ambient, rtol=1e-12)


def test_attached_shadows_see_only_the_ambient_light():
    images, mask, truth = photographs(tilt_deg=(80, 80), ambient=0.2)
    shadow = mask & (truth.normals @ truth.lights.vector[0, 0] < -0.05)
    assert np.count_nonzero(shadow) > 200
    assert np.abs(images[0][shadow] - 0.5 * 0.6 * 0.2).max() < STEP
    assert (images[0][mask] > 0.5 * 0.6 * 0.2 - STEP).all()


def test_no_light_beside_the_object():
    images, _, _ = photographs()
    outside = ~np.isfinite(SPHERE.render(SMALL).depth)
    core = outside & np.roll(outside, 2, 0) & np.roll(outside, -2, 0)
    core &= np.roll(outside, 2, 1) & np.roll(outside, -2, 1)
    assert images[:, core].max() == 0


def test_a_near_lamp_far_away_is_a_distant_one():
    distant, mask, truth = photographs()
    near, _, near_truth = photographs(lamp_distance_m=1000.0)
    assert np.abs(near - distant)[:, mask].max() < 3e-4 + STEP
    nearer, _, _ = photographs(lamp_distance_m=0.5)
    assert np.abs(nearer - distant)[:, mask].max() > 0.05
    assert np.allclose(near_truth.lights.vector, truth.lights.vector)
    assert truth.lights.position_m is None


def test_near_lights_fade_with_the_square_of_their_distance():
    images, mask, truth = photographs(lamp_distance_m=0.3, supersampling=1)
    points = back_project(truth.depth.astype(float), SMALL)[mask]
    lights = truth.lights
    for i, position in enumerate(lights.position_m[:, 0]):
        from_center = np.linalg.norm(position - points.mean(axis=0))
        assert from_center == pytest.approx(0.3, rel=1e-6)
        power = lights.intensity[i, 0] * from_center**2
        way = position - points
        s = power * way / np.linalg.norm(way, axis=1, keepdims=True) ** 3
        lit = np.maximum(np.sum(truth.normals[mask] * s, axis=1), 0) + lights.ambient[i, 0]
        assert np.abs(images[i][mask] - np.minimum(0.5 * lit, 1)[:, None]).max() < STEP + 1e-6


def test_near_leds_have_a_place_each():
    images, mask, truth = photographs(lighting="rgb-leds", lamp_distance_m=0.5, supersampling=1)
    points = back_project(truth.depth.astype(float), SMALL)[mask]
    dot = np.einsum("npck,pk->npc", arriving(truth.lights, points), truth.normals[mask])
    lit = np.maximum(dot, 0) + truth.lights.ambient[:, None]
    assert truth.lights.position_m.shape == (1, 3, 3)
    assert np.abs(images[:, mask] - np.minimum(0.5 * lit, 1)).max() < STEP + 1e-6


def test_each_channel_sees_its_own_led():
    images, mask, truth = photographs(lighting="rgb-leds")
    assert images.shape[0] == 1
    assert truth.lights.vector.shape == (1, 3, 3)
    directions = truth.lights.direction[0]
    angles = np.degrees(np.arctan2(directions[:, 1], directions[:, 0]))
    assert angles == pytest.approx([-90, 30, 150])
    assert np.degrees(np.arccos(-directions[:, 2])) == pytest.approx(40)
    rows, columns = np.nonzero(mask)
    for channel, (x, y) in enumerate(((0, -1), (1, 1), (-1, 1))):
        brightest = np.argmax(images[0, ..., channel][mask])
        side = columns[brightest] - SMALL.cx, rows[brightest] - SMALL.cy
        assert np.dot(side, (x, y)) > 5
    _, _, white = photographs()
    assert white.lights.vector.shape == (3, 1, 3)


def test_natural_light_is_broad():
    images, mask, truth = photographs(lighting="ambient")
    assert images.shape[0] == 1
    assert truth.lights.ambient / truth.lights.intensity == pytest.approx(0.5)
    assert np.mean(first_order(truth, 0, mask) > truth.lights.ambient[0]) > 0.9


def post(camera, rows):
    """A wall at 0.8 m and a post, 40 mm high, over columns 45 to 50."""
    depth = np.full(camera.shape, 0.8)
    scale = camera.width // 120
    depth[:, 45 * scale : 50 * scale] = 0.76
    normals = np.broadcast_to([0.0, 0.0, -1.0], (*camera.shape, 3)).copy()
    return Surface(depth, normals).cut(rows)


def test_the_shadow_of_a_post_is_as_long_as_it_should_be():
    shape = Shape("post", SMALL, post)
    dark, tilt = 0.5 * 0.6 * 0.1, 35.0
    options = {
        "lighting": "rgb-leds",
        "led_azimuth_deg": (180.0, 0.0, 90.0),
        "led_tilt_deg": tilt,
        "supersampling": 4,
    }
    lit, _, _ = photographs(shape, **options)
    images, mask, _ = photographs(shape, cast_shadows=True, **options)
    assert mask.all()
    # of each pixel in shadow; the outermost rows would be shaded by what is out of the view
    share = ((lit - images) / (lit - dark))[0, 45:46]
    # the red lamp is on the left: from the post's right edge (its top) to the right
    right_edge = (49.5 - SMALL.cx) / SMALL.fx * 0.76 + 0.04 * np.tan(np.radians(tilt))
    end = right_edge / 0.8 * SMALL.fx + SMALL.cx
    assert share[0, 50, 0] == pytest.approx(1, abs=1e-3)
    assert 49.5 + share[0, 50:, 0].sum() == pytest.approx(end, abs=0.5)
    assert share[0, :50, 0].max() < 1e-3
    assert images[0, 45, 51, 0] == pytest.approx(dark, abs=STEP)
    # the green one on the right throws its shadow to the left, the blue one from below along it
    left_edge = (44.5 - SMALL.cx) / SMALL.fx * 0.76 - 0.04 * np.tan(np.radians(tilt))
    start = left_edge / 0.8 * SMALL.fx + SMALL.cx
    assert 44.5 - share[0, :45, 1].sum() == pytest.approx(start, abs=0.5)
    assert np.abs(lit - images)[0, :-5, :45, 2].max() < STEP


def test_a_sphere_casts_no_shadow_on_itself():
    with_shadows, mask, _ = photographs(cast_shadows=True)
    without, _, _ = photographs()
    assert np.abs(with_shadows - without)[:, mask].max() < 0.02


def test_highlights_add_light_where_the_lamp_is_mirrored():
    matte, mask, truth = photographs()
    glossy, _, _ = photographs(specular=0.5, specular_exponent=60.0)
    shine = (glossy - matte)[0, ..., 0]
    assert shine[mask].min() > -2 * STEP
    toward_camera = -back_project(truth.depth.astype(float), SMALL)
    toward_camera /= np.linalg.norm(toward_camera, axis=-1, keepdims=True)
    halfway = truth.lights.direction[0, 0] + toward_camera
    halfway /= np.linalg.norm(halfway, axis=-1, keepdims=True)
    cosine = np.sum(halfway * truth.normals, axis=-1)
    top = np.nanargmax(cosine)
    assert shine.flat[top] == pytest.approx(0.5 * 0.6, rel=0.03)
    assert np.abs(shine - 0.3 * cosine**60)[mask & (cosine > 0.9)].max() < 0.01


def test_exposures_differ_as_asked():
    images, mask, truth = photographs(
        photographs=60, exposure_spread=0.3, tilt_deg=(0, 0), exposure=0.2
    )
    gains = truth.lights.intensity[:, 0] / 0.2
    assert np.std(np.log(gains)) == pytest.approx(0.3, rel=0.1)
    brightness = images[:, mask].mean(axis=(1, 2))
    assert np.abs(brightness / brightness[0] - gains / gains[0]).max() < 1e-3


def test_the_peak_is_where_asked():
    images, mask, _ = photographs(exposure=None, peak=0.8, peak_quantile=0.9)
    assert np.quantile(images[:, mask], 0.9) == pytest.approx(0.8, abs=2 * STEP)
    saturated, mask, _ = photographs(exposure=None, peak=2.0, peak_quantile=0.9)
    assert np.mean(saturated[:, mask] == 1) > 0.5


def test_image_noise_is_as_asked():
    clean, mask, _ = photographs()
    noisy, _, _ = photographs(image_noise=0.02)
    off = (noisy - clean)[:, mask]
    assert np.std(off) == pytest.approx(0.02, rel=0.02)
    assert abs(off.mean()) < 5e-4


@pytest.mark.parametrize(("bits", "encoding"), [(8, "linear"), (8, "srgb"), (16, "srgb")])
def test_encodings_hold_the_same_light(bits, encoding):
    linear, mask, _ = photographs()
    options = replace(QUIET, bits=bits, encoding=encoding)
    capture, _ = render_scene(SPHERE, painted(0.5), options)
    assert capture.photographs.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert capture.encoding == encoding
    light = to_linear(capture.photographs, encoding)
    # half a step of the values, times the slope of the curve (2.3 at most)
    slope = 2.3 if encoding == "srgb" else 1.0
    tolerance = 0.5 / capture.white * slope + STEP
    assert np.abs(light - linear)[:, mask].max() < tolerance


def test_lights_are_spread_over_the_ring():
    _, _, truth = photographs(photographs=12, tilt_deg=(15, 40))
    toward = truth.lights.direction[:, 0]
    tilt = np.degrees(np.arccos(-toward[:, 2]))
    assert tilt.min() >= 15 - 1e-9
    assert tilt.max() <= 40 + 1e-9
    apart = np.degrees(np.arccos(np.clip(toward @ toward.T, -1, 1))) + 180 * np.eye(12)
    assert apart.min() > 14
    # any first few are far from coplanar
    for count in (3, 4, 6, 12):
        assert np.linalg.svd(toward[:count])[1][2] > 0.25


def test_depth_is_the_block_mean_of_the_truth():
    surface = SPHERE.render(SMALL)
    for factor in (1, 2, 3, 5):
        capture, _ = render_scene(SPHERE, painted(0.5), replace(QUIET, depth_factor=factor))
        assert capture.depth_m.shape == (1, 90 // factor, 120 // factor)
        expected = area_mean(surface.depth, factor).astype(np.float32)
        assert np.array_equal(capture.depth_m[0], expected, equal_nan=True)


def test_depth_frames_differ_in_their_noise():
    options = replace(QUIET, depth_frames=2, depth_noise=DepthNoise(rms_mm=3.0))
    first, second = render_scene(SPHERE, painted(0.5), options)[0].depth_m
    assert np.nanstd(first - second) == pytest.approx(0.003 * np.sqrt(2), rel=0.05)


def test_truth_is_exact_and_inside_the_object():
    surface = SPHERE.render(SMALL)
    capture, truth = render_scene(SPHERE, make_albedo("simple"), QUIET)
    mask = capture.mask
    assert np.array_equal(truth.mask, mask)
    assert np.array_equal(truth.depth[mask], surface.depth[mask].astype(np.float32))
    assert np.array_equal(truth.normals[mask], surface.normals[mask].astype(np.float32))
    assert np.isnan(truth.normals[~mask]).all()
    assert (truth.albedo[~mask] == 0).all()
    fine = SPHERE.render(SMALL.scaled(2)).mask
    assert not (mask & (area_mean(fine, 2) < 1)).any()
    assert 0 < np.count_nonzero(surface.mask & ~mask) < 0.06 * np.count_nonzero(mask)


def test_the_seed_decides_and_its_streams_are_separate():
    options = replace(
        QUIET, image_noise=0.01, depth_noise=DepthNoise(rms_mm=2.0), exposure_spread=0.1
    )
    (first, _), (again, _), (other, _), (more, _) = (
        render_scene(SPHERE, painted(0.5), replace(options, **change))
        for change in ({}, {}, {"seed": 1}, {"photographs": 5})
    )
    assert np.array_equal(first.photographs, again.photographs)
    assert np.array_equal(first.depth_m, again.depth_m, equal_nan=True)
    assert not np.array_equal(first.photographs, other.photographs)
    assert not np.array_equal(first.depth_m, other.depth_m, equal_nan=True)
    assert np.array_equal(first.depth_m, more.depth_m, equal_nan=True)


@pytest.mark.parametrize(
    "options",
    [
        {"lighting": "candle"},
        {"encoding": "gamma"},
        {"bits": 12},
        {"photographs": 0},
        {"photographs": 2.5},
        {"tilt_deg": (40, 10)},
        {"tilt_deg": (0, 90)},
        {"led_tilt_deg": 95.0},
        {"led_azimuth_deg": (0.0, 120.0)},
        {"led_azimuth_deg": (float("nan"), 0.0, 0.0)},
        {"led_azimuth_deg": ("a", 0.0, 0.0)},
        {"depth_noise": None},
        {"lamp_distance_m": 0.0},
        {"ambient": -0.1},
        {"exposure": 0.0},
        {"exposure": np.array([1.0, 2.0])},
        {"peak_quantile": 0.0},
        {"image_noise": float("nan")},
        {"depth_factor": 0},
        {"seed": -1},
        {"seed": "a"},
        {"tilt_deg": 30.0},
        {"depth_factor": None},
        {"camera": "wide"},
    ],
)
def test_impossible_options(options):
    with pytest.raises(InputError, match="not a possible scene") as caught:
        SceneOptions(**options)
    assert next(iter(options)) in str(caught.value)


def test_a_caller_who_wants_errors_for_underflow_gets_a_scene():
    options = SceneOptions(camera=make_shape("vase").camera.scaled(0.1), photographs=3)
    with np.errstate(all="raise"):
        capture, _ = render_scene(make_shape("vase"), make_albedo("simple"), options)
    assert capture.photographs.any()


@pytest.mark.parametrize("factor", [1.5, 3.2, 4.7])
def test_depth_need_not_be_a_whole_fraction_of_the_photographs(factor):
    capture, _ = render_scene(SPHERE, painted(0.5), replace(QUIET, depth_factor=factor))
    width = round(120 / factor)
    assert capture.depth_m.shape == (1, round(90 * width / 120), width)
    assert capture.depth_camera is None
    camera, _ = depth_camera_of(capture)
    depth = capture.depth_m[0]
    radius = np.linalg.norm(back_project(depth, camera)[np.isfinite(depth)] - [0, 0, 0.8], axis=-1)
    assert np.median(radius) == pytest.approx(0.1, abs=3e-4)  # means over pixels of a round thing
    assert prepare(capture).factor == pytest.approx(np.sqrt(120 * 90 / depth.size))


def test_a_camera_that_looks_past_the_object():
    camera = Camera(20, 20, 900.0, 900.0, 5000.0, 0.0)
    with pytest.raises(InputError, match="does not see the object"):
        render_scene(SPHERE, painted(0.5), replace(QUIET, camera=camera))


# ---- a depth camera of its own


BESIDE = RigidTransform(np.eye(3), np.array([0.05, 0.0, 0.0]))


def test_a_depth_camera_sees_the_object_from_its_own_place():
    options = replace(QUIET, depth_factor=1.5, depth_to_color=BESIDE)
    capture, truth = render_scene(SPHERE, painted(0.5), options)
    same, _ = render_scene(SPHERE, painted(0.5), QUIET)
    np.testing.assert_array_equal(capture.photographs, same.photographs)
    assert capture.depth_to_color is BESIDE
    camera, depth = capture.depth_camera, capture.depth_m[0]
    assert camera.shape == depth.shape
    assert camera.width == round(capture.camera.width / 1.5)
    points = back_project(depth, camera)[np.isfinite(depth)] + BESIDE.translation_m
    radius = np.linalg.norm(points - [0, 0, 0.8], axis=-1)
    np.testing.assert_allclose(radius, 0.1, atol=2e-3)  # means over pixels of a round thing
    assert np.median(radius) == pytest.approx(0.1, abs=2e-4)
    assert truth.depth.shape == capture.camera.shape


def test_a_depth_map_is_seen_from_its_own_place_only():
    shape = Shape("scan", SPHERE.camera, SPHERE.render)
    with pytest.raises(InputError, match="colour camera's place only"):
        render_scene(shape, painted(0.5), replace(QUIET, depth_to_color=BESIDE))
