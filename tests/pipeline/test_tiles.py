"""Large photographs: refined in tiles as when all is refined at once, without a seam."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from rakelight import memory
from rakelight.errors import InputError, MachineError
from rakelight.geometry.grid import bounding_window
from rakelight.methods import load_method
from rakelight.methods.multi_light import METHOD, MultiLight
from rakelight.methods.multi_light.tiles import Whole, agreement, carried
from rakelight.metrics import evaluate_maps
from rakelight.model import GivenLights, RigidTransform
from rakelight.pipeline import lower_resolution, refine, tiles
from rakelight.pipeline.tiles import spans
from rakelight.prepare import prepared_view
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

BRIEFLY = MultiLight(lights="white", distance="distant", coarse_pixels=1000, tolerance=0.02)
"""No search for the kind of lights at the lower resolution, and few steps."""


@cache
def scene(shape="vase", width=240, depth_factor=2, photographs=8, baseline_m=None):
    solid = make_shape(shape)
    pose = baseline_m and RigidTransform(np.eye(3), np.array([baseline_m, 0.0, 0.0]))
    options = SceneOptions(
        camera=solid.camera.scaled(width / 480),
        photographs=photographs,
        depth_factor=depth_factor,
        depth_noise=DepthNoise(rms_mm=2.0, correlation_length_px=3.0),
        depth_to_color=pose,
    )
    return render_scene(solid, make_albedo("pattern"), options)


def too_few_for(capture, shrink=1):
    """Bytes for half of what all at once takes: enough for half the resolution, and for tiles."""
    rows, columns = bounding_window(capture.mask, 1)
    pixels = (rows.stop - rows.start) * (columns.stop - columns.start) / shrink**2
    return 0.5 * METHOD.bytes_per_pixel * pixels


@pytest.fixture
def little(monkeypatch):
    """Small tiles; and a function that leaves so many bytes free, whatever the machine has."""
    monkeypatch.setattr(lower_resolution, "FIXED_BYTES", 0)
    monkeypatch.setattr(tiles, "LARGEST_TILE", 70**2)
    return lambda free: monkeypatch.setattr(memory, "free_memory", lambda: free)


def in_tiles(capture, options=BRIEFLY, **settings):
    result = refine(capture, options, **settings)
    (note,) = (f.message for f in result.findings if f.code == "refined-in-tiles")
    return result, int(note.split()[-2])


def angles(first, second):
    cosine = np.nansum(first.normals * second.normals, axis=-1)[first.mask]
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def test_in_tiles_as_well_as_at_once(little):
    capture, truth = scene()
    little(too_few_for(capture))
    tiled, count = in_tiles(capture)
    assert count > 4
    little(1e12)
    whole = refine(capture, BRIEFLY)
    assert not [f for f in whole.findings if f.code == "refined-in-tiles"]
    (scores, at_once) = (evaluate_maps(each.depth, each.normals, truth) for each in (tiled, whole))
    # At 120 x 90 the whole is coarse; large photographs are as good (docs/explanation/scale.md).
    assert scores.normals.mae_deg < 1.2 * at_once.normals.mae_deg
    assert scores.depth.rmse_mm < 1.3 * at_once.depth.rmse_mm
    np.testing.assert_array_equal(tiled.mask, whole.mask)
    np.testing.assert_allclose(tiled.prepared_depth, whole.prepared_depth, rtol=2e-7)
    assert np.median(angles(tiled, whole)) < 1.0
    inside = tiled.mask
    assert np.median(np.abs(tiled.albedo - whole.albedo)[inside]) < 0.02
    assert np.percentile(tiled.albedo[inside], 99) == pytest.approx(1, rel=0.05)
    for name in ("depth_sigma", "normal_sigma"):
        ratio = getattr(tiled, name)[inside] / getattr(whole, name)[inside]
        assert 0.5 < np.median(ratio) < 2, name
    assert tiled.photograph_names == whole.photograph_names
    assert len(tiled.prediction_errors) == len(whole.prediction_errors)


def test_tiles_agree_where_they_overlap(little, monkeypatch):
    capture, _ = scene("cloth", width=160, photographs=5)
    little(too_few_for(capture))
    small, count = in_tiles(capture)
    monkeypatch.setattr(tiles, "LARGEST_TILE", 1_000_000)
    monkeypatch.setattr(tiles, "TILE_SHARE", 100)
    one, single = in_tiles(capture)
    assert count > single == 1
    # The relief is centimetres, the normals' error degrees.
    assert np.nanmax(np.abs(small.depth - one.depth)) < 6e-5
    assert angles(small, one).max() < 1


def test_sides_that_no_lower_resolution_divides(little):
    capture, truth = scene(depth_factor=4)
    part = slice(0, 179), slice(0, 239)
    odd = replace(
        capture, photographs=capture.photographs[:, *part], mask=capture.mask[part],
        camera=capture.camera.cropped(*part), depth_camera=capture.camera.scaled(1 / 4),
    )  # fmt: skip
    little(too_few_for(capture))
    result, _ = in_tiles(odd)
    assert result.depth.shape == (179, 239)
    truth = replace(
        truth, depth=truth.depth[part], normals=truth.normals[part], albedo=truth.albedo[part]
    )
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 2.5


def test_memory_that_becomes_free_meanwhile_is_enough(monkeypatch):
    capture, _ = scene(depth_factor=4)
    monkeypatch.setattr(lower_resolution, "available_memory", lambda: 0.0)
    monkeypatch.setattr(lower_resolution, "require_memory", lambda *given, **named: None)
    chosen, view = load_method("multi-light"), prepared_view(capture, "auto")
    assert lower_resolution.lower_resolution(capture, view, chosen) == 32


@pytest.mark.parametrize(("depth_factor", "baseline_m"), [(1, None), (1.5, 0.03)])
def test_depth_about_as_fine_as_the_photographs(little, depth_factor, baseline_m):
    capture, truth = scene(depth_factor=depth_factor, baseline_m=baseline_m)
    little(too_few_for(capture))
    result, _ = in_tiles(capture, replace(BRIEFLY, tolerance=0.002))
    scores = evaluate_maps(result.depth, result.normals, truth)
    before = evaluate_maps(result.prepared_depth, result.normals, truth)
    assert scores.normals.mae_deg < 2.4  # at once 2.06 and 2.02
    assert scores.depth.median_mm < 0.6 * before.depth.median_mm


def test_given_lights_and_lower_output_resolution(little):
    capture, truth = scene(width=400, depth_factor=4, photographs=4)
    lights = GivenLights(directions=truth.lights.direction[:, 0], fixed=True)
    little(too_few_for(capture, shrink=2))
    result, _ = in_tiles(replace(capture, lights=lights), scale=2)
    assert result.depth.shape == (150, 200)
    np.testing.assert_allclose(result.lights.direction, truth.lights.direction, atol=1e-6)


def test_photographs_that_say_nothing_keep_the_depth(little):
    capture, _ = scene()
    same = np.repeat(capture.photographs[:1], len(capture.photographs), axis=0)
    random = np.random.default_rng(0)
    noise = random.integers(0, 300, same.shape, dtype=np.uint16)
    little(too_few_for(capture))
    result, _ = in_tiles(replace(capture, photographs=same // 2 + noise))
    assert "photographs-say-nothing" in {f.code for f in result.findings}
    np.testing.assert_allclose(result.depth, result.prepared_depth, rtol=1e-6)
    assert result.confidence.max() == 0
    assert result.albedo[result.mask].mean() > 0.05


def test_too_little_for_any_resolution(monkeypatch):
    capture, _ = scene(width=120)
    monkeypatch.setattr(memory, "free_memory", lambda: 1e6)
    with pytest.raises(MachineError, match="too little memory"):
        refine(capture)
    with pytest.raises(InputError, match="limit of memory"):
        refine(capture, memory=0)


def test_maps_that_do_not_fit_are_refused_before_the_work(little, monkeypatch):
    capture, _ = scene(width=120)
    little(too_few_for(capture))
    monkeypatch.setattr(tiles, "MAP_BYTES", METHOD.bytes_per_pixel)
    steps = []
    with pytest.raises(MachineError, match="too little memory"):
        refine(capture, progress=steps.append)
    assert not any(step.stage.startswith("refine") for step in steps)


def test_shares_of_tiles_add_up_to_one():
    for window, side, shrink, most in ((slice(3, 203), 210, 2, 60), (slice(0, 999), 999, 4, 300)):
        total = np.zeros(side)
        found = spans(window, side, shrink, most)
        assert len(found) > 2
        for each in found:
            total[each.refined] += each.share()
            assert each.refined.start % shrink == 0
        np.testing.assert_allclose(total[window], 1)


def whole_of(shape):
    """The lower resolution, a quarter, of a window that begins at its row 3 and column 5."""
    names = ("depth_sigma_m", "stated", "lights", "middle_m", "outliers", "bas_relief", "log_depth")
    nothing = dict.fromkeys(names)
    return Whole(shrink=4, row=3, column=5, mask=np.ones(shape, bool), **nothing)


def test_an_image_is_carried_to_its_place():
    i, j = np.mgrid[:10, :12]
    image = 100.0 * (4 * (3 + i) + 1.5) + (4 * (5 + j) + 1.5)
    rows, columns = slice(20, 37), slice(32, 51)
    tile = SimpleNamespace(rows=rows, columns=columns, mask=np.ones((17, 19), bool))
    row, column = np.mgrid[rows, columns]
    np.testing.assert_allclose(carried(image, tile, whole_of((10, 12))), 100.0 * row + column)


def test_outside_the_window_there_is_no_object():
    part = whole_of((4, 4)).mask_part(slice(2, 8), slice(4, 10))
    np.testing.assert_array_equal(part, np.pad(np.ones((4, 4), bool), 1))


def test_corrections_fade_over_pixels_of_the_lower_resolution():
    linearization = SimpleNamespace(typical_information=lambda per: 3.0)
    fit = SimpleNamespace(noise=0.01, linearization=linearization)
    assert agreement(fit, 4) == pytest.approx(agreement(fit, 1) / 16)
