"""Depth that has nothing to do with its photographs, or lies a little beside them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rakelight import check_capture, refine
from rakelight.capture import load_capture
from rakelight.check.depth_match import depth_unrelated, matched, predicted
from rakelight.check.depth_shift import depth_shift
from rakelight.check.measured import Measured
from rakelight.model import Camera, Capture
from rakelight.synthetic import random_capture
from tests.check.moved_captures import still_scene
from tests.check.wrong_captures import SOLIDS, noise_alone, one_lamp, sound

CAPTURES = Path(__file__).parents[3] / "shared" / "captures"


def with_plane(capture, noise_m=0.0):
    """The capture with a slanted plane in the place of its depth."""
    height, width = capture.depth_m.shape[1:]
    middle_m = np.nanmedian(capture.depth_m)
    plane = np.tile(np.linspace(0.95, 1.05, width) * middle_m, (1, height, 1))
    noise = noise_m * np.random.default_rng(0).standard_normal(plane.shape)
    return replace(capture, depth_m=(plane + noise).astype(np.float32))


def with_photographs_rolled(capture, right, down):
    """The capture with all photographs moved against depth and mask."""
    rolled = np.roll(capture.photographs, (down, right), axis=(1, 2))
    return replace(capture, photographs=rolled)


def flat_page(lamp_m, relief_m=0.0):
    """A painted page, 0.5 m away and 0.2 m wide, under near lamps, with or without relief."""
    rng = np.random.default_rng(1)
    camera = Camera(160, 120, 400.0, 400.0, 79.5, 59.5)
    y, x = (np.mgrid[:120, :160] - np.array([59.5, 79.5])[:, None, None]) * 0.5 / 400
    paint = 0.2 + 0.6 * (np.sin(400 * x) * np.sin(500 * y) > 0)
    height = relief_m * np.sin(300 * x) * np.sin(300 * y)
    down, right = np.gradient(height, 0.5 / 400)
    photographs = []
    for k in range(10):
        around, tilt = 2.4 * k, np.radians(rng.uniform(25, 55))
        toward = np.array([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around)])
        way = [lamp_m * toward[0] - x, lamp_m * toward[1] - y, lamp_m * np.cos(tilt) - height]
        lit = (way[2] - right * way[0] - down * way[1]) / np.sqrt(1 + right**2 + down**2)
        light = paint * (np.maximum(lit, 0) / np.linalg.norm(way, axis=0) ** 3 + 0.05)
        photographs.append(light)
    values = np.stack(photographs) / np.max(photographs) * 60000
    values = np.repeat(values[..., None], 3, axis=-1).astype(np.uint16)
    depth_m = 0.5 + 0.001 * rng.standard_normal((1, 60, 80))
    return Capture(values, depth_m.astype(np.float32), np.ones((120, 160), bool), camera)


@pytest.mark.parametrize("shape", SOLIDS)
def test_a_sound_capture_belongs_together(shape):
    measured = Measured(sound(shape)[0])
    assert depth_unrelated(measured) == depth_shift(measured) == ()


@pytest.mark.parametrize("shape", SOLIDS)
@pytest.mark.parametrize("noise_m", [0.0, 0.001])
def test_a_plane_in_the_place_of_depth_is_told(shape, noise_m):
    (found,) = depth_unrelated(Measured(with_plane(sound(shape)[0], noise_m)))
    assert (found.severity, found.code) == ("warning", "depth-unrelated")
    assert "do not belong together: the shading varies by" in found.message


def test_depth_of_another_object_is_told():
    cloth, head = still_scene("cloth"), still_scene("head")
    (found,) = depth_unrelated(Measured(replace(head, depth_m=cloth.depth_m)))
    assert found.code == "depth-unrelated"


@pytest.mark.parametrize("change", [one_lamp, noise_alone])
def test_photographs_without_information_say_nothing_of_it(change):
    measured = Measured(with_plane(change(sound("head")[0])))
    assert depth_unrelated(measured) == depth_shift(measured) == ()


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_photographs_say_nothing(count):
    measured = Measured(with_plane(sound("head")[0]).select(range(count)))
    assert depth_unrelated(measured) == depth_shift(measured) == ()


@pytest.mark.parametrize("lamp_m", [0.2, 0.5])
@pytest.mark.parametrize("relief_m", [0.0, 0.0001])
def test_a_flat_page_whose_relief_no_sensor_resolves_is_not_doubted(lamp_m, relief_m):
    """Near lamps shade it by more than a solid object, smoothly."""
    measured = Measured(flat_page(lamp_m, relief_m))
    assert depth_unrelated(measured) == depth_shift(measured) == ()


def test_relief_that_depth_lacks_is_told():
    assert depth_unrelated(Measured(flat_page(0.5, 0.003)))


@pytest.mark.parametrize("seed", [14, 83])
def test_shadows_of_bars_and_coins_with_noisy_depth_are_no_mistakes(seed):
    measured = Measured(random_capture(seed)[0])
    assert depth_unrelated(measured) == depth_shift(measured) == ()


@pytest.mark.parametrize(("right", "down"), [(12, 0), (0, -7), (-8, 9)])
@pytest.mark.parametrize("shape", ["head", "cloth"])
def test_photographs_beside_depth_and_mask_are_told_with_the_shift(shape, right, down):
    capture = with_photographs_rolled(still_scene(shape), right, down)
    found = matched(capture).shift
    assert found.shift == pytest.approx([-right, -down], abs=2)
    assert found.there > found.as_it_is
    (told,) = depth_shift(Measured(capture))
    assert (told.severity, told.code) == ("warning", "depth-shifted")
    assert "its slopes" in told.message
    assert depth_unrelated(Measured(capture)) == ()


def test_refine_and_check_say_so_and_foretell_nothing():
    wrong = with_plane(sound("vase")[0])
    report = check_capture(wrong)
    assert report.findings[0].code == "depth-unrelated"
    assert report.accuracy is None
    assert report.verdict != "good"
    assert "depth-unrelated" in [each.code for each in refine(wrong).findings]


def test_what_chance_explains_is_not_counted():
    rng = np.random.default_rng(0)
    where = np.ones((60, 60), bool)
    smooth = np.kron(rng.normal(size=(6, 6, 5)), np.ones((10, 10, 1))).reshape(3600, 5)
    shade, slope = smooth[:, :3], smooth[:, 3:]
    assert predicted(shade, slope, where).sum() < 0
    along = 0.2 * slope + shade[:, :2]
    common = float((shade[:, :2] ** 2).sum())
    assert predicted(shade, along, where).sum() == pytest.approx(common, rel=0.1)


@pytest.mark.skipif(not CAPTURES.exists(), reason="needs shared/captures")
@pytest.mark.parametrize("name", ["mitten", "uw-cat", "uw-owl", "uw-horse", "android", "monkey"])
def test_real_captures_belong_together(name):
    measured = Measured(load_capture(CAPTURES / name))
    assert depth_unrelated(measured) == depth_shift(measured) == ()


@pytest.mark.skipif(not CAPTURES.exists(), reason="needs shared/captures")
def test_a_plane_and_photographs_beside_a_real_depth_are_told():
    cat = load_capture(CAPTURES / "uw-cat")
    assert depth_unrelated(Measured(with_plane(cat)))
    assert matched(with_photographs_rolled(cat, 15, 0)).shift.shift == pytest.approx(
        [-15, 0], abs=3
    )
