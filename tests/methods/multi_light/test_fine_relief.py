"""Relief that is hardly wider than the sensor's pixels, and is smoothed away before refining."""

from functools import partial

import numpy as np
import pytest

from rakelight import refine
from rakelight.metrics import evaluate_maps
from rakelight.synthetic import DepthNoise, SceneOptions, Shape, make_albedo, make_shape
from rakelight.synthetic.implicit import Solid, trace
from rakelight.synthetic.scene import render_scene

CAMERA = make_shape("coin").camera.scaled(0.2)
DISTANCE_M = 0.6


def plate(period_m):
    """A plate with waves 1 mm high of a few directions, which fills the view of `CAMERA`."""

    def field(x, y, z):
        waves = (
            np.sin(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / (stretch * period_m) + turn)
            for turn, stretch in ((0.2, 1.0), (1.3, 1.2), (2.4, 0.9), (0.8, 1.4))
        )
        return z - 0.0005 * sum(waves)

    solid = Solid(field, DISTANCE_M, radius_m=0.5, steepness=2.5)
    return Shape("plate", CAMERA, partial(trace, solid), solid)


@pytest.mark.parametrize(("lamp_distance_m", "period_px"), [(None, 12), (0.5, 16)])
def test_its_height_is_the_sensors(lamp_distance_m, period_px):
    pixel_m = DISTANCE_M / CAMERA.fx
    options = SceneOptions(
        camera=CAMERA,
        photographs=8,
        lamp_distance_m=lamp_distance_m,
        depth_factor=2,
        depth_noise=DepthNoise(rms_mm=0.2, correlation_length_px=0.0),
    )
    capture, truth = render_scene(plate(period_px * pixel_m), make_albedo("white"), options)
    result = refine(capture)
    inside = truth.mask & np.isfinite(result.depth)
    true_m, prepared_m, refined_m = (
        (depth[inside] - depth[inside].mean()).astype(float)
        for depth in (truth.depth, result.prepared_depth, result.depth)
    )
    height = true_m @ true_m
    assert prepared_m @ true_m / height < 0.7
    assert refined_m @ true_m / height == pytest.approx(1, abs=0.05)
    assert evaluate_maps(result.depth, result.normals, truth).normals.mae_deg < 1.5
