"""What light from all sides says of fine relief, against the visible sky of whole surfaces."""

import numpy as np
import pytest

from rakelight.geometry.blur import blurred
from rakelight.methods.single_image.ambient_occlusion import occlusion_height
from rakelight.methods.single_image.texture import AFAR_PX
from tests.methods.single_image.visible_sky import gradient, sky

SIDE = 72
ALL = np.ones((SIDE, SIDE), bool)
ROW, COLUMN = np.mgrid[:SIDE, :SIDE]
FACING = np.tile([0.0, 0.0, -1.0], (SIDE, SIDE, 1))
FROM_ALL_SIDES = np.array([0.0, 0.0, 0.0, 1.0])


def relief(kind, period_px, slope):
    """A periodic height (h, w) in pixels with that root mean square slope."""
    if kind == "fourth_difference":
        wave = 2 * np.pi / period_px
        height = np.cos(wave * (ROW + COLUMN) / 2**0.5) * np.cos(wave * (ROW - COLUMN) / 2**0.5)
    else:
        frequency = np.hypot(np.fft.fftfreq(SIDE)[:, None], np.fft.fftfreq(SIDE))
        ring = np.exp(-((frequency * period_px - 1) ** 2) / 0.08)
        noise = np.random.default_rng(0).normal(size=(SIDE, SIDE))
        height = np.fft.ifft2(np.fft.fft2(noise) * ring).real
    return height * slope / np.hypot(*gradient(height)).std()


@pytest.mark.parametrize("kind", ["fourth_difference", "random"])
@pytest.mark.parametrize("period_px", [6, 9, 12])
@pytest.mark.parametrize("slope", [0.6, 1.2])
def test_a_relief_is_found_from_occlusion_under_the_sky(kind, period_px, slope):
    height = relief(kind, period_px, slope)
    light = sky(height, 1.5 * period_px)
    contrast = light / blurred(light, AFAR_PX, ALL) - 1
    found, explained = occlusion_height(contrast, FROM_ALL_SIDES, FACING, ALL)
    np.testing.assert_allclose(explained, contrast)
    inner = (slice(12, -12), slice(12, -12))
    # The best height that the light tells, in least squares, is about the one found.
    scale = (found * height)[inner].sum() / (found**2)[inner].sum()
    assert 0.6 < scale < 1.7
    assert np.corrcoef(found[inner].ravel(), height[inner].ravel())[0, 1] > 0.5


def test_an_open_slope_has_no_occlusion():
    lean = sky(0.0 * ROW, 3)
    np.testing.assert_allclose(lean, 1.0, atol=0.01)


def test_the_height_of_a_wave_goes_with_its_length():
    tall = [
        occlusion_height(0.1 * np.cos(ROW * 2 * np.pi / px), FROM_ALL_SIDES, FACING, ALL)[0][
            20:-20
        ].std()
        for px in (8, 16)
    ]
    assert tall[1] / tall[0] == pytest.approx(2, rel=0.15)


def test_light_from_one_side_explains_what_it_can():
    contrast = 0.1 * np.cos(ROW * 2 * np.pi / 8)
    strong, weak = np.array([0.0, -0.6, -0.6, 0.4]), np.array([0.0, -0.05, -0.3, 0.7])
    shares = [
        occlusion_height(contrast, light, FACING, ALL)[1].std() / 0.0707 for light in (strong, weak)
    ]
    assert shares[0] < 0.05
    assert 0.85 < shares[1] < 1


def test_light_along_the_view_is_no_light_from_the_side():
    contrast = 0.1 * np.cos(ROW * 2 * np.pi / 8)
    _, explained = occlusion_height(contrast, np.array([0.0, 0.0, -0.5, 0.5]), FACING, ALL)
    np.testing.assert_allclose(explained, contrast)


@pytest.mark.parametrize("ambient", [0.0, -0.2])
def test_without_light_from_all_sides_there_is_no_cue(ambient):
    light = np.array([0.0, 0.0, -1.0, ambient])
    height, explained = occlusion_height(0.1 * np.cos(ROW), light, FACING, ALL)
    assert (height == 0).all()
    assert (explained == 0).all()
