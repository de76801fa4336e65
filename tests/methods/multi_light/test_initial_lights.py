"""LightParameters to start from: near enough to the true ones where the prior misleads."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion
from scipy.spatial.transform import Rotation

from rakelight.geometry.normals import normals_from_depth
from rakelight.methods.levels import finest_level, pyramid
from rakelight.methods.multi_light import MultiLight
from rakelight.methods.multi_light.factored_start import factored_start
from rakelight.methods.multi_light.initial_lights import lights_of_prior
from rakelight.metrics import evaluate_depth
from rakelight.model import Camera, Capture, Truth
from rakelight.pipeline import refine
from rakelight.prepare import prepare
from rakelight.synthetic import DepthNoise, add_depth_noise

CAMERA = Camera(192, 144, fx=365.0, fy=365.0, cx=95.5, cy=71.5)
LAMPS = 12


@cache
def dome(grow=0, rms_mm=2.0, correlation_px=0.0):
    """A dome of 26 cm with waves 1.5 mm high under a ring of lights; its truth; the lights (N, 3).

    grow : pixels by which the mask is too large; dark, and without depth, they are not the object
    """
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    x, y = 0.8 * (u - CAMERA.cx) / CAMERA.fx, 0.8 * (v - CAMERA.cy) / CAMERA.fy
    high = np.sqrt(np.clip(1 - (x**2 + y**2) / 0.02, 0, None))
    waves = 0.0015 * np.sin(220 * x) * np.sin(220 * y)
    whole = x**2 + y**2 < 0.13**2
    depth = np.where(whole, 0.8 - 0.05 * high + waves, np.nan)
    normals = normals_from_depth(np.nan_to_num(depth, nan=1.0), whole, CAMERA)
    object_ = binary_erosion(whole)

    turn = 2 * np.pi * (np.arange(LAMPS) + 0.5) / LAMPS
    tilt = np.radians(20 + 25 * (0.618 * np.arange(LAMPS) % 1))
    lights = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)], -1)
    paint = 0.3 + 0.4 * ((u // 13 + v // 11) % 2)[..., None] * [1.0, 0.8, 0.6]
    shading = np.maximum(np.einsum("hwk,nk->nhw", np.nan_to_num(normals), lights), 0) + 0.1
    light = np.where(object_[..., None], 0.9 * paint * shading[..., None], 0.02)
    noise = 0.002 * np.random.default_rng(0).normal(size=light.shape)
    blocks = depth.reshape(CAMERA.height // 2, 2, CAMERA.width // 2, 2).mean(axis=(1, 3))
    seen = DepthNoise(rms_mm=rms_mm, correlation_length_px=correlation_px)
    capture = Capture(
        photographs=np.rint(65535 * np.clip(light + noise, 0, 1)).astype(np.uint16),
        depth_m=add_depth_noise(blocks, seen)[None],
        mask=binary_dilation(object_, iterations=grow) if grow else object_,
        camera=CAMERA,
    )
    shown = [np.where(object_[..., None], each, np.nan) for each in (depth[..., None], normals)]
    return (
        capture,
        Truth(shown[0][..., 0], shown[1], np.where(object_[..., None], paint, 0)),
        lights,
    )


def wall(slant_deg):
    """A wall with waves, its right side farther away, under lamps around its normal; lights (N, 3).

    The sensor's noise hides the waves: the lights that fit its normals lie along their mean.
    """
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    x, y = (u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy
    waves = 0.0008 * (np.sin(300 * x + 40 * y) + np.sin(-60 * x + 280 * y))
    slant = np.radians(slant_deg)
    depth = 0.8 / (1 - np.tan(slant) * x) + waves
    everywhere = np.ones(depth.shape, bool)
    normals = normals_from_depth(depth, everywhere, CAMERA)

    turn = 2 * np.pi * (np.arange(LAMPS) + 0.5) / LAMPS
    tilt = np.radians(30 + 20 * (0.618 * np.arange(LAMPS) % 1))
    lights = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)], -1)
    lights = lights @ Rotation.from_euler("y", -slant_deg, degrees=True).as_matrix().T
    shading = np.maximum(np.einsum("hwk,nk->nhw", normals, lights), 0) + 0.05
    noise = np.random.default_rng(0).normal(size=(*shading.shape, 3))
    light = 0.6 * shading[..., None] + 0.002 * noise
    blocks = depth.reshape(CAMERA.height // 2, 2, CAMERA.width // 2, 2).mean(axis=(1, 3))
    capture = Capture(
        photographs=np.rint(65535 * np.clip(light, 0, 1)).astype(np.uint16),
        depth_m=add_depth_noise(blocks, DepthNoise(rms_mm=1.0, correlation_length_px=2.0))[None],
        mask=everywhere,
        camera=CAMERA,
    )
    return capture, lights


def coarsest(capture):
    return pyramid(finest_level(prepare(capture)), 4000)[-1]


def off_deg(lights, true):
    size = np.linalg.norm(lights.vector[:, 0], axis=-1, keepdims=True)
    found = lights.vector[:, 0] / np.maximum(size, 1e-12)
    return np.degrees(np.arccos(np.clip((found * true).sum(-1), -1, 1)))


def test_the_photographs_tell_lights_that_a_rough_prior_does_not():
    capture, _, true = dome(rms_mm=5.0, correlation_px=6.0)
    level = coarsest(capture)
    factored = off_deg(factored_start(level)[1], true)
    assert factored.max() < 20
    assert factored.max() < 0.6 * off_deg(lights_of_prior(level), true).max()


def test_a_wall_seen_obliquely_is_as_good_as_one_seen_frontally():
    frontal, oblique = (
        off_deg(lights_of_prior(coarsest(capture)), true) for capture, true in (wall(0), wall(45))
    )
    np.testing.assert_allclose(oblique, frontal, atol=6)


def test_a_generous_mask_does_not_end_in_a_wrong_surface():
    capture, truth, _ = dome(grow=3)
    result = refine(capture, MultiLight(distance="distant"))
    after, before = (
        evaluate_depth(depth, CAMERA, truth).normals
        for depth in (result.depth, result.prepared_depth)
    )
    assert after.median_deg < before.median_deg / 10


def test_the_relief_comes_from_the_prior():
    capture, _, true = dome()
    level = coarsest(capture)
    inside_out = 2 * np.median(level.prior) - level.prior
    hollow = replace(level, prior=inside_out, unbiased_prior=inside_out)
    assert off_deg(factored_start(level)[1], true).max() < 20
    # A hollow lit from the other side looks the same.
    turned = true * [-1, -1, 1]
    assert off_deg(factored_start(hollow)[1], turned).max() < 20


@pytest.mark.parametrize("bright", [0, 65535])
def test_photographs_that_show_nothing_tell_nothing(bright):
    level = coarsest(dome()[0])
    dull = np.full_like(level.photographs.values, bright)
    nothing = replace(level.photographs, values=dull)
    assert factored_start(replace(level, photographs=nothing)) is None


def test_one_lamp_in_all_photographs_tells_nothing():
    capture, _, _ = dome()
    level = coarsest(capture.select([0] * 6))
    assert factored_start(level) is None
