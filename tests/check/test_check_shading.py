from dataclasses import replace

import numpy as np
import pytest

from rakelight.check.shading import relative_shading
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene
from tests.check.wrong_captures import noise_alone, sound


def test_distant_lights_need_few_components():
    shading = relative_shading(sound("head")[0])
    share = shading.variances / shading.variances.sum()
    assert share[:3].sum() > 0.95
    assert share[1] > 0.1
    noise = relative_shading(noise_alone(sound("head")[0])).variances
    assert noise[:3].sum() / noise.sum() < 0.6


def test_paint_does_not_matter():
    shape = make_shape("head")
    options = SceneOptions(camera=shape.camera.scaled(0.3), photographs=6, image_noise=0.0)
    plain, painted = (
        relative_shading(render_scene(shape, make_albedo(name), options)[0]).variances
        for name in ("white", "pattern")
    )
    np.testing.assert_allclose(plain[:2], painted[:2], rtol=0.05)


def test_the_small_grid_is_a_window_of_the_image():
    capture, _ = sound("head")
    shading = relative_shading(capture)
    assert shading.components.shape[1:] == shading.seen.shape == shading.camera.shape
    picked = capture.mask[shading.rows, shading.columns][:: shading.step, :: shading.step]
    assert not (shading.seen & ~picked).any()
    # The optical axis is at the same place of the object.
    assert shading.camera.cx * shading.step + shading.columns.start == pytest.approx(
        capture.camera.cx
    )


def test_components_have_unit_variance():
    shading = relative_shading(sound("head")[0])
    np.testing.assert_allclose((shading.components[:, shading.seen] ** 2).mean(axis=1), 1.0)


def test_black_and_saturated_photographs_show_nothing():
    capture, _ = sound("head")
    for value in (0, 65535):
        dull = replace(capture, photographs=np.full_like(capture.photographs, value))
        assert relative_shading(dull) is None
