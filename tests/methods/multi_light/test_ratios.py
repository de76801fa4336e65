"""Photographs of many times the depth's resolution, in whole numbers and between them."""

import pytest

from rakelight.errors import MethodError
from rakelight.geometry.grid import area_mean
from rakelight.methods.multi_light import MultiLight
from rakelight.metrics import evaluate_depth, evaluate_maps
from rakelight.model import Capture
from rakelight.pipeline import refine
from rakelight.synthetic import (
    DepthNoise,
    SceneOptions,
    add_depth_noise,
    make_albedo,
    make_shape,
    render_scene,
)
from tests.methods.remembered import remembered

VASE = remembered(make_shape("vase"))
NOISE = DepthNoise(rms_mm=1.5)


def capture_of(sensor, side=(160, 120), photographs=3, noise=NOISE):
    """Photographs of `side` (width, height) of a vase over a depth map of `sensor` pixels."""
    camera = VASE.camera.resized(*side)
    options = SceneOptions(camera=camera, photographs=photographs, supersampling=1)
    scene, truth = render_scene(VASE, make_albedo("pattern"), options)
    rays = 6
    depth = area_mean(VASE.render(camera.resized(*sensor).scaled(rays)).depth, rays)
    depth = add_depth_noise(depth, noise, [0])
    return Capture.from_arrays(scene.photographs, depth, camera, mask=scene.mask), truth


def scores(capture, truth):
    result = refine(capture, MultiLight(distance="distant"))
    before = evaluate_depth(result.prepared_depth, result.camera, truth)
    return before, evaluate_maps(result.depth, result.normals, truth)


@pytest.mark.parametrize(
    ("side", "sensor"),
    [
        ((240, 180), (32, 24)),
        ((252, 189), (16, 12)),
    ],
    ids=["7.5", "15.75"],
)
def test_three_photographs_refine_between_whole_numbers(side, sensor):
    assert_refined(*scores(*capture_of(sensor, side)))


def assert_refined(before, after):
    assert after.normals.mae_deg < before.normals.mae_deg / 2
    assert after.depth.rmse_mm < 1.05 * before.depth.rmse_mm


def test_a_ratio_between_whole_numbers_costs_nothing():
    """Sensors of 3.93, 4 and 4.07 colour pixels, the same noise in millimetres."""
    found = [
        scores(*capture_of(sensor, (220, 165), photographs=6))
        for sensor in ((56, 42), (55, 41), (54, 40))
    ]
    for before, after in found:
        assert_refined(before, after)
    whole = found[1][1]
    for between in (found[0][1], found[2][1]):
        assert between.depth.rmse_mm == pytest.approx(whole.depth.rmse_mm, rel=0.1)
        assert between.normals.mae_deg == pytest.approx(whole.normals.mae_deg, rel=0.25)


def test_the_published_method_keeps_its_rule_between_whole_numbers():
    capture, _ = capture_of((32, 24), (240, 180))
    with pytest.raises(MethodError, match=r"too few photographs .* at scale 7\.5") as error:
        refine(capture, "multi-light-alternating")
    assert error.value.needed == "at least 57"
