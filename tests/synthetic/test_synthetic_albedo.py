import numpy as np
import pytest

from rakelight.capture.images import encode_png
from rakelight.errors import InputError
from rakelight.geometry.grid import area_mean
from rakelight.synthetic import ALBEDOS, make_albedo, texture_from_file
from rakelight.synthetic.albedo import DARKEST, RED_GREEN_BLUE
from rakelight.synthetic.shapes import VIEW

HALF = VIEW.scaled(0.5)


@pytest.fixture(params=ALBEDOS)
def name(request):
    return request.param


def test_reflectance_is_between_dark_and_white(name):
    paint = make_albedo(name).paint(HALF)
    assert paint.shape == (*HALF.shape, 3)
    assert paint.min() >= np.float32(DARKEST)
    assert paint.max() <= 1


def test_the_seed_decides(name):
    first, again, other = (make_albedo(name, seed).paint(HALF) for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert np.array_equal(first, other) == (name in ("white", "grey"))


def test_two_rays_a_side_sample_enough(name):
    """Averages of 2 x 2 samples per pixel against 4 x 4, at the size of the default view."""
    albedo = make_albedo(name)
    two, four = (area_mean(albedo.paint(VIEW.scaled(n)), n) for n in (2, 4))
    assert np.sqrt(np.mean((two - four) ** 2)) < 0.02


def test_simple_has_three_colors_in_large_areas():
    paint = make_albedo("simple").paint(HALF)
    colors, counts = np.unique(paint.reshape(-1, 3), axis=0, return_counts=True)
    assert len(colors) == 3
    assert np.isin(colors, RED_GREEN_BLUE.astype(np.float32)).all()
    assert counts.min() > 0.2 * counts.sum()
    assert _changing(paint) < 0.06


def test_details_grow_from_simple_to_complicated():
    shares = [_changing(make_albedo(n).paint(HALF)) for n in ("simple", "pattern", "complicated")]
    assert shares[0] * 3 < shares[1] < shares[2]


def _changing(paint):
    """Share of pixels that differ from their right-hand neighbour."""
    return np.mean(np.abs(np.diff(paint, axis=1)).max(axis=-1) > 0.05)


def test_a_photograph_covers_the_view(tmp_path):
    """An sRGB photograph, wider than the view: its middle is used, in linear light."""
    pixels = np.zeros((90, 400, 3), np.uint8)
    pixels[:, 140:260] = 188, 0, 255  # the middle 120 columns are all that a 4:3 view takes
    path = tmp_path / "photo.png"
    path.write_bytes(encode_png(pixels))
    albedo = texture_from_file(path)
    assert albedo.name == "photo"
    for camera in (HALF, VIEW.scaled(0.1)):  # enlarged and reduced
        paint = albedo.paint(camera)
        assert paint.shape == (*camera.shape, 3)
        # (188/255) as linear light; black is lifted to 0.02
        assert np.abs(paint - np.array([0.5029, 0.02, 1.0])).max() < 1e-4


def test_a_16_bit_photograph_is_linear(tmp_path):
    path = tmp_path / "photo.png"
    path.write_bytes(encode_png(np.full((3, 4), 32768, np.uint16)))
    assert np.abs(texture_from_file(path).paint(HALF) - 0.5).max() < 1e-4


def test_wrong_input(tmp_path):
    with pytest.raises(InputError, match="no such albedo"):
        make_albedo("plaid")
    path = tmp_path / "photo.png"
    path.write_bytes(b"<html>")
    with pytest.raises(InputError, match=r"photo\.png"):
        texture_from_file(path)
    with pytest.raises(InputError):
        texture_from_file(tmp_path / "none.png")
