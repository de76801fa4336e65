"""Random captures: what is drawn, and that captures are as their draws say.  All small."""

from collections import Counter
from dataclasses import asdict, replace

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.geometry.averaging import Averaging
from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import surface_normals
from rakelight.metrics import evaluate_maps
from rakelight.pipeline import refine
from rakelight.prepare.sensor import SensorGrid
from rakelight.synthetic import SHAPES
from rakelight.synthetic.draws import OneOf, Range, distributions
from rakelight.synthetic.random_capture import (
    MOST_RMS_PX,
    Draw,
    draw,
    random_capture,
    render_draw,
)
from rakelight.synthetic.reliefs import RELIEFS

DRAWS = [draw(seed) for seed in range(300)]
TABLE = distributions(Draw)
PLAIN = {
    "easy": True,
    "paint": "grey",
    "ambient": 0.1,
    "image_noise": 0.0,
    "bits": 16,
    "encoding": "linear",
    "photographs": 3,
    "light_spread": 0.0,
}
STEP = 0.5 / 65535 + 1e-6
"""Rounding of 16-bit values."""
PERFECT = {
    "depth_rms_mm": 0.0,
    "depth_white_mm": 0.0,
    "depth_step_mm": 0.0,
    "depth_bend_mm": 0.0,
    "depth_maps": 1,
    "depth_factor": 1,
}
PERFECT_MAPS = {name: value for name, value in PERFECT.items() if name != "depth_factor"}


def linear(capture):
    """(N, H, W, 3) of 16-bit linear photographs."""
    return capture.photographs / 65535


# ---- what is drawn


def test_a_seed_gives_the_same_bytes_and_another_seed_other_ones():
    one, same, other = (random_capture(seed, 0.2, shape="folds") for seed in (3, 3, 4))
    for name in ("photographs", "depth_m", "mask"):
        assert getattr(one[0], name).tobytes() == getattr(same[0], name).tobytes()
        assert getattr(one[0], name).tobytes() != getattr(other[0], name).tobytes()
    for name in ("depth", "normals", "albedo"):
        assert getattr(one[1], name).tobytes() == getattr(same[1], name).tobytes()


@pytest.mark.parametrize("name", TABLE)
def test_every_value_is_one_of_its_distribution(name):
    for each in DRAWS:
        assert TABLE[name].holds(getattr(each, name)), getattr(each, name)


@pytest.mark.parametrize("name", [name for name, each in TABLE.items() if isinstance(each, OneOf)])
def test_every_kind_occurs(name):
    assert {getattr(each, name) for each in DRAWS} == set(TABLE[name].weights)


@pytest.mark.parametrize("name", [name for name, each in TABLE.items() if isinstance(each, Range)])
def test_numbers_fill_their_range(name):
    of = TABLE[name]
    values = np.array([getattr(each, name) for each in DRAWS if not each.easy], float)
    if of.absent:
        assert np.mean(values == of.none) == pytest.approx(of.absent, abs=0.12)
        values = values[values != of.none]
    if name in ("depth_rms_mm", "photographs"):
        return  # bounded by others, see below
    low, high = of.low, of.high
    if of.log:
        values, low, high = np.log(values), np.log(low), np.log(high)
    share = (values - low) / (high - low)
    assert share.min() < 0.2
    assert share.max() > 0.8
    # standard error of a mean of 50 uniform numbers: 0.04
    assert abs(share.mean() - 0.5) < 0.13


def test_a_third_is_easy_and_has_no_difficulty():
    easy = [each for each in DRAWS if each.easy]
    assert len(easy) == pytest.approx(100, abs=25)
    for each in easy:
        for name, of in TABLE.items():
            value = getattr(each, name)
            if isinstance(of, Range) and of.absent:
                assert value == of.none, name
            if isinstance(of, OneOf) and of.plain is not None:
                assert value == of.plain, name


def test_the_median_draw_has_about_fifteen_photographs():
    assert 11 <= np.median([each.photographs for each in DRAWS]) <= 18


def test_there_are_as_many_photographs_as_methods_need():
    assert all(each.photographs >= each.depth_factor**2 for each in DRAWS)
    assert draw(0, photographs=3, depth_factor=8).photographs == 3


def test_no_sensor_is_put_before_an_object_much_smaller_than_its_errors():
    assert all(each.depth_rms_mm <= MOST_RMS_PX * each.pixel_mm + 1e-9 for each in DRAWS)


def test_an_override_leaves_the_rest_as_it_was():
    plain, other = (
        asdict(draw(11)),
        asdict(draw(11, lights="ring", tilt_deg=33.0)),
    )
    changed = {name for name in plain if plain[name] != other[name]}
    assert changed <= {"lights", "tilt_deg"}
    assert other["tilt_deg"] == 33.0
    before, after = (random_capture(11, 0.2, shape="folds", photographs=n)[0] for n in (3, 5))
    assert before.depth_m.tobytes() == after.depth_m.tobytes()


def test_other_ratios_leave_the_rest_as_it_was():
    ratios = (10, 12.5, 16)
    others = [draw(seed, ratios=ratios) for seed in range(60)]
    for before, other in zip(DRAWS, others, strict=False):
        assert other.depth_factor in ratios
        assert other.photographs <= before.photographs
        changed = {"depth_factor": before.depth_factor, "photographs": before.photographs}
        assert replace(other, **changed) == before
    assert len({other.depth_factor for other in others}) == 3
    assert {other.photographs for other in others} > {3, 4}


@pytest.mark.parametrize("ratio", [7.5, 10, 15.75])
def test_a_coarse_sensor_measures_means_over_its_pixels(ratio):
    capture, truth = random_capture(3, 0.5, shape="folds", ratios=(ratio,), **PLAIN | PERFECT_MAPS)
    grid = SensorGrid(capture.depth_m.shape[1:], capture.camera.shape)
    assert grid.factor == pytest.approx(ratio)
    averaging = Averaging.on(truth.mask, grid.edges(0), grid.edges(1))
    whole = grid.covered(truth.mask)
    assert np.count_nonzero(whole) > 4
    expected = averaging.down(np.nan_to_num(truth.depth))[whole]
    np.testing.assert_allclose(capture.depth_m[0][whole], expected, atol=5e-5)


def test_ratios_that_no_sensor_has_are_refused():
    with pytest.raises(InputError, match=r"seen 0\.5, 2, needed 1 to 100"):
        draw(0, ratios=(0.5, 2))


def test_scans_and_pictures_are_drawn_where_they_are_and_found_by_name(tmp_path):
    scans = [tmp_path / "cup.npz", tmp_path / "dog.npz"]
    pictures = [tmp_path / "wall.png"]
    drawn = [draw(seed, scans=scans, pictures=pictures) for seed in range(100)]
    shapes = Counter(each.shape for each in drawn)
    assert sum(shapes[str(path)] for path in scans) == pytest.approx(25, abs=13)
    assert min(shapes[str(path)] for path in scans) > 0
    assert any(each.paint == str(pictures[0]) for each in drawn)
    assert draw(0, scans=scans, shape="dog").shape == str(scans[1])


@pytest.mark.parametrize(
    ("options", "seen"),
    [
        ({"shape": "dragon"}, "dragon"),
        ({"paint": "gold"}, "gold"),
        ({"colour": "red"}, "colour"),
        ({"size": 0.0}, "size 0"),
        ({"lights": "nope"}, "lights: .*nope.*needed"),
        ({"lighting": "nope"}, "lighting: .*nope"),
        ({"bits": 12}, "bits: .*12"),
        ({"depth_factor": 0}, "depth_factor: .*1 to"),
        ({"photographs": "many"}, "photographs: .*many"),
        ({"photographs": 0}, "photographs: .*a whole number above 0"),
        ({"photographs": 3.5}, "photographs: .*a whole number"),
        ({"photographs": np.array([3, 4])}, "photographs: "),
        ({"depth_maps": 0}, "depth_maps: "),
        ({"distance_m": 0.0}, "distance_m: .*a number above 0"),
        ({"near_spread": -5.0}, "near_spread: .*a number from 0"),
        ({"lights": ["ring"]}, "lights: "),
        ({"size": "a"}, "size a"),
    ],
)
def test_what_cannot_be_drawn_is_refused(options, seen):
    with pytest.raises(InputError, match=seen):
        draw(0, **options)


@pytest.mark.parametrize("seed", [-1, 0.5, None, "a"])
def test_what_is_no_seed_is_refused(seed):
    with pytest.raises(InputError, match=f"seed {seed}, .*a whole number from 0"):
        draw(seed)


def test_a_draw_says_all_its_values_on_a_line():
    text = str(draw(5))
    assert "\n" not in text
    assert all(name in text for name in TABLE)


# ---- captures are as their draws say


@pytest.mark.parametrize("shape", [*SHAPES, *RELIEFS])
def test_every_shape_fills_its_view_as_it_should(shape):
    options = {"object_px": 12_000.0, "shape": shape, **PLAIN}
    capture, truth = random_capture(1, 0.5, **options)
    # Only the pixels that it covers whole: bars and the ring, all rim, lose a tenth.
    assert 0.9 < np.count_nonzero(truth.mask) / (0.25 * 12_000) < 0.99
    assert all(side % 24 == 0 for side in capture.camera.shape)
    rim = np.ones(truth.mask.shape, bool)
    rim[1:-1, 1:-1] = False
    assert not (rim & truth.mask).any()
    middle_m = np.nanmedian(truth.depth)
    # the image is half as large, so its pixels are not
    assert 1000 * middle_m / capture.camera.fx == pytest.approx(draw(1).pixel_mm / 0.5, rel=0.02)


@pytest.mark.parametrize("hollow", [False, True])
@pytest.mark.parametrize("turn", range(8))
def test_normals_are_those_of_the_depth_however_it_is_turned(turn, hollow):
    _, truth = random_capture(
        2, 0.5, shape="folds", turn=turn, hollow=hollow, depth_scale=0.5, **PLAIN
    )
    camera = draw_camera(2, turn=turn)
    off = np.sum(surface_normals(truth.depth, truth.mask, camera) * truth.normals, axis=-1)
    assert np.degrees(np.arccos(np.nanmedian(off))) < 1.2


def draw_camera(seed, **options):
    return random_capture(seed, 0.5, shape="folds", **{**PLAIN, **options})[0].camera


@pytest.mark.parametrize("near_radii", [0.0, 4.0])
@pytest.mark.parametrize("colour_spread", [0.0, 0.3])
@pytest.mark.parametrize("lights", ["ring", "cone", "one-side"])
def test_plain_photographs_follow_from_the_truth(lights, colour_spread, near_radii):
    capture, truth = random_capture(
        3,
        0.4,
        **{**PLAIN, "light_spread": 0.3, "shape": "sphere", "lights": lights},
        colour_spread=colour_spread,
        near_radii=near_radii,
        near_spread=0.1,
    )
    off = linear(capture) - expected_light(capture, truth)
    assert np.median(np.abs(off[:, truth.mask])) < 1e-3
    assert np.quantile(np.abs(off[:, truth.mask]), 0.95) < 0.01


def expected_light(capture, truth):
    """(N, H, W, 3) of the plain image model at the truth's normals."""
    points = back_project(truth.depth, capture.camera)
    lights, images = truth.lights, []
    for i in range(len(lights)):
        s = lights.vector[i]
        if lights.position_m is not None:
            way = lights.position_m[i] - points[..., None, :]
            length = np.linalg.norm(way, axis=-1, keepdims=True)
            middle = np.linalg.norm(lights.position_m[i] - lights.middle_m, axis=-1)[..., None]
            s = lights.intensity[i][:, None] * way / length * (middle / length) ** 2
        cosine = np.sum(s * truth.normals[..., None, :], axis=-1)
        images.append(truth.albedo * (np.maximum(cosine, 0) + lights.ambient[i]))
    return np.minimum(images, 1)


@pytest.mark.parametrize("window", [0.0, 0.6])
def test_a_window_lights_what_faces_it(window):
    options = {**PLAIN, "shape": "sphere", "ambient": 0.3}
    capture, truth = random_capture(3, 0.4, **options, window=window)
    even = expected_light(capture, truth)
    # What is left beside the lamps and even light is the same of every photograph, over the albedo.
    rest = np.median(linear(capture) - even, axis=0)[truth.mask] / truth.albedo[truth.mask]
    rest = rest.mean(axis=-1)
    if not window:
        assert np.median(np.abs(rest)) < 1e-2
        return
    normals = truth.normals[truth.mask]
    bright = np.quantile(rest, 0.99)
    toward = normals[rest > bright].mean(axis=0)
    cosine = np.maximum(normals @ (toward / np.linalg.norm(toward)), 0)
    level = truth.lights.ambient[0, 0]
    assert np.median(np.abs(rest - level * window * (2 * cosine - 1))) < 0.05 * level


def test_channels_of_leds_see_a_lamp_each():
    options = {**PLAIN, "shape": "sphere", "lighting": "rgb-leds"}
    capture, truth = random_capture(4, 0.4, **options)
    assert len(capture.photographs) == 1
    assert capture.lighting == "rgb-leds"
    off = linear(capture) - expected_light(capture, truth)
    assert np.median(np.abs(off[:, truth.mask])) < 1e-3
    assert truth.lights.vector.shape == (1, 3, 3)


def test_the_lamp_above_lights_what_faces_up():
    capture, truth = random_capture(5, 0.4, **{**PLAIN, "shape": "sphere", "photographs": 12})
    above = np.argmin(truth.lights.vector[:, 0, 1])  # y points down
    image = linear(capture)[above].mean(axis=-1)
    rows = np.nonzero(truth.mask)[0]
    top, bottom = np.quantile(rows, [0.25, 0.75]).astype(int)
    up, down = truth.mask.copy(), truth.mask.copy()
    up[top:], down[:bottom] = False, False
    assert truth.lights.vector[above, 0, 1] < 0
    assert image[up].mean() > 1.2 * image[down].mean()


def test_shadows_fall_away_from_the_lamp():
    options = {**PLAIN, "shape": "plates", "hollow": False, "depth_scale": 1.0, "turn": 0}
    lit, _ = random_capture(6, 0.5, **options, tilt_deg=60.0, lights="ring")
    shaded, truth = random_capture(6, 0.5, **options, tilt_deg=60.0, lights="ring", cast_shadows=1)
    count = 0
    for i in range(3):
        dark = truth.mask & (linear(shaded)[i, ..., 0] < 0.5 * linear(lit)[i, ..., 0])
        toward = truth.lights.direction[i, 0, :2]
        toward = toward / np.abs(toward).max()
        rows, columns = np.nonzero(dark)
        count += rows.size
        nearer = np.zeros(rows.size, bool)
        for step in range(1, 25):
            at = (rows + round(step * toward[1]), columns + round(step * toward[0]))
            height, width = truth.mask.shape
            inside = (at[0] >= 0) & (at[0] < height) & (at[1] >= 0) & (at[1] < width)
            at = tuple(np.where(inside, index, 0) for index in at)
            with np.errstate(invalid="ignore"):
                higher = truth.depth[at] < truth.depth[rows, columns] - 1e-4
            nearer |= inside & higher
        assert nearer.mean() > 0.95
    assert count > 20


def test_light_between_surfaces_only_adds_and_most_in_a_mould():
    options = {**PLAIN, "shape": "sphere", "depth_scale": 1.0, "paint": "white", "peak": 0.5}

    def brighter(hollow):
        without, truth = random_capture(7, 0.4, **options, hollow=hollow, bounce=False)
        with_it, _ = random_capture(7, 0.4, **options, hollow=hollow, bounce=True)
        # both are exposed for the brightest pixels: compare the darkest
        return [
            np.quantile(linear(each)[:, truth.mask], 0.02) / np.median(linear(each)[:, truth.mask])
            for each in (without, with_it)
        ]

    outside, inside = brighter(False), brighter(True)
    assert outside[1] == pytest.approx(outside[0], rel=1e-3)  # a ball does not see itself
    assert inside[1] > 1.1 * inside[0]


@pytest.mark.parametrize("material", ["rough", "shiny", "mixed"])
def test_materials_differ_from_matte(material):
    options = {**PLAIN, "shape": "sphere", "gloss": 0.5, "roughness": 0.8}
    matte, truth = random_capture(8, 0.4, **options)
    other, _ = random_capture(8, 0.4, **options, material=material)
    a, b = (linear(each)[:, truth.mask] for each in (matte, other))
    a, b = a / np.median(a), b / np.median(b)
    assert np.std(a - b) > 0.02


def test_rough_is_flatter_and_shiny_more_peaked_than_matte():
    def contrast(**options):
        capture, truth = random_capture(
            8, 0.4, **{**PLAIN, "shape": "sphere", "gloss": 0.5, "roughness": 0.8, **options}
        )
        values = linear(capture)[:, truth.mask]
        return np.quantile(values, 0.99) / np.median(values)

    assert contrast(material="rough") < contrast() < contrast(material="shiny")


def test_the_lens_darkens_corners_and_blurs():
    options = {**PLAIN, "shape": "plates", "wall": True, "paint": "complicated"}
    sharp, truth = random_capture(9, 0.4, **options)
    soft, _ = random_capture(9, 0.4, **options, blur_px=1.5)
    dark, _ = random_capture(9, 0.4, **options, corner=0.6)
    inner = truth.mask
    detail = [
        np.abs(np.diff(linear(each), axis=2))[:, inner[:, 1:]].mean() for each in (sharp, soft)
    ]
    assert detail[1] < 0.7 * detail[0]
    ratio = np.median(linear(dark) / np.maximum(linear(sharp), 1e-3), axis=(0, 3))
    middle = tuple(side // 2 for side in ratio.shape)
    assert ratio[middle] == pytest.approx(1, abs=0.01)
    corner = tuple(index[0] for index in np.nonzero(truth.mask))
    height, width = ratio.shape
    x, y = 2 * corner[1] / (width - 1) - 1, 2 * corner[0] / (height - 1) - 1
    assert ratio[corner] == pytest.approx(1 - 0.4 * (x**2 + y**2) / 2, abs=0.01)


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_noise_has_its_size(share):
    options = {**PLAIN, "shape": "sphere", "photon_share": share, "peak": 0.7}
    quiet, truth = random_capture(10, 0.4, **options)
    noisy, _ = random_capture(10, 0.4, **{**options, "image_noise": 0.02})
    light = linear(quiet)[:, truth.mask]
    off = (linear(noisy)[:, truth.mask] - light)[light < 0.8]
    size = 0.02 * np.sqrt(1 - share + share * light[light < 0.8])
    kept = light[light < 0.8] > 0.1  # nothing is clipped at black
    assert np.std(off[kept] / size[kept]) == pytest.approx(1, rel=0.05)


def test_a_wrong_gamma_is_not_told():
    options = {**PLAIN, "shape": "sphere"}
    right, truth = random_capture(10, 0.4, **options)
    wrong, _ = random_capture(10, 0.4, **options, gamma=1.05)
    a, b = (linear(each)[:, truth.mask] for each in (right, wrong))
    assert np.abs(a**1.05 - b).max() < 2 * STEP


# ---- the sensor


@pytest.mark.parametrize("length_px", [0.0, 12.0])
def test_the_correlated_depth_error_is_as_drawn(length_px):
    options = {
        **PLAIN, **PERFECT, "shape": "plates", "depth_scale": 0.3, "pixel_mm": 0.5,
        "depth_rms_mm": 2.0, "depth_length_px": length_px, "depth_maps": 8,
    }  # fmt: skip
    capture, truth = random_capture(12, 1.0, **options, depth_common=0.75)
    errors = 1000 * (capture.depth_m - truth.depth)
    known = np.isfinite(errors[0])
    assert np.sqrt(np.mean(errors[:, known] ** 2)) == pytest.approx(2.0, rel=0.1)
    # what the maps share: three quarters of the variance
    mean = errors.mean(axis=0)[known]
    assert np.mean(mean**2) / np.mean(errors[:, known] ** 2) == pytest.approx(
        0.75 + 0.25 / 8, abs=0.06
    )
    lag = 12
    pairs = known[:, lag:] & known[:, :-lag]
    product = (errors[:, :, lag:] * errors[:, :, :-lag])[:, pairs].mean()
    ratio = product / np.mean(errors[:, known] ** 2)
    # 17,000 pixels hold about 40 areas of 12 x 12 times pi
    assert ratio == pytest.approx(np.exp(-1) if length_px else 0.0, abs=0.15)


def test_other_depth_errors_are_as_drawn():
    def errors(**options):
        capture, truth = random_capture(
            13, 0.5, **{**PLAIN, **PERFECT, "shape": "plates", "pixel_mm": 0.5, **options}
        )
        return 1000 * (capture.depth_m - truth.depth)[:, truth.mask], capture

    assert np.nanmax(np.abs(errors()[0])) < 1e-3
    white = errors(depth_white_mm=0.4, depth_maps=2)[0]
    assert np.nanstd(white) == pytest.approx(0.4, rel=0.05)
    assert abs(np.mean(white[0] * white[1])) < 0.01
    bend = errors(depth_bend_mm=1.5)[0]
    assert np.sqrt(np.nanmean(bend**2)) == pytest.approx(1.5, rel=0.05)
    steps = errors(depth_step_mm=2.0)[1].depth_m * 1000 / 2
    assert np.nanmax(np.abs(steps - np.rint(steps))) < 1e-3
    lost = errors(hole_fraction=0.1, hole_px=4.0)[1].depth_m
    full = errors()[1].depth_m
    assert np.isnan(lost[np.isfinite(full)]).mean() == pytest.approx(0.1, abs=0.01)


def test_flying_pixels_lie_between_the_sides_of_jumps():
    options = {**PLAIN, **PERFECT, "shape": "plates", "depth_scale": 1.0}
    clean, truth = random_capture(14, 0.5, **options)
    flying, _ = random_capture(14, 0.5, **options, flying=0.5)
    moved = np.abs(flying.depth_m - clean.depth_m)[0] > 1e-5
    assert 20 < np.count_nonzero(moved) < 0.2 * np.count_nonzero(truth.mask)
    assert np.nanmin(flying.depth_m) >= np.nanmin(clean.depth_m)
    assert np.nanmax(flying.depth_m) <= np.nanmax(clean.depth_m)


def test_a_shifted_depth_map_is_shifted():
    options = {**PLAIN, **PERFECT, "shape": "folds"}
    still, _ = random_capture(15, 0.5, **options)
    moved, _ = random_capture(15, 0.5, **options, shift_x=2.0, shift_y=-2.0)
    a, b = still.depth_m[0, 1:, :-1], moved.depth_m[0, :-1, 1:]
    assert np.array_equal(a, b, equal_nan=True)


def test_the_mask_is_too_large_or_too_small():
    _, truth = random_capture(16, 0.5, shape="sphere")
    sizes = [
        np.count_nonzero(random_capture(16, 0.5, shape="sphere", mask_px=by)[0].mask)
        for by in (-2, 0, 2)
    ]
    exact = np.count_nonzero(truth.mask)
    rim = 2 * np.sqrt(np.pi * exact)
    assert sizes[1] == exact
    assert sizes[0] == pytest.approx(exact - 2 * rim, abs=0.6 * rim)
    assert sizes[2] == pytest.approx(exact + 2 * rim, abs=0.6 * rim)


# ---- a method improves them


def test_an_easy_draw_with_true_depth_is_refined_to_it():
    drawn = replace(
        draw(17, 0.6, shape="folds", **{**PLAIN, "photographs": 9}), **PERFECT, image_noise=0.002
    )
    capture, truth = render_draw(drawn)
    result = refine(capture)
    errors = evaluate_maps(result.depth, result.normals, truth, truth.mask & result.mask)
    assert errors.normals.mae_deg < 2.0
    assert errors.depth.rmse_mm < 0.3 * drawn.pixel_mm / 0.6
