"""Clay, montages and colours: what a picture shows is where the data has it."""

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.model import Camera
from rakelight.pictures.clay import clay, shaded
from rakelight.pictures.colors import color_errors, normal_map
from rakelight.pictures.montage import BACKGROUND, in_column, in_row, panel, side_by_side
from rakelight.pictures.shown import object_window
from tests.export.conftest import make_sphere

CAMERA = Camera(60, 40, fx=400.0, fy=400.0, cx=29.5, cy=19.5)
MASK = np.zeros(CAMERA.shape, bool)
MASK[5:35, 10:50] = True


def test_shading_is_lit_from_where_the_lamp_is():
    sphere = make_sphere()
    image = shaded(sphere.normals, sphere.mask, light=(-1.0, 0.0, -0.5)).astype(float)
    rows, columns = np.nonzero(sphere.mask)
    middle = int(np.median(rows))
    on_row = columns[rows == middle]
    assert image[middle, on_row[2]] > 2 * image[middle, on_row[-2]]
    assert (image[~sphere.mask] == 32).all()


def test_clay_is_dark_where_there_is_no_depth():
    depth_m = np.where(MASK, 1.0, np.nan)
    depth_m[20, 20] = np.nan
    picture = clay(depth_m, MASK, CAMERA)
    assert picture[20, 20] == BACKGROUND
    assert (picture[MASK] != BACKGROUND).sum() == MASK.sum() - 1


def test_side_by_side_keeps_the_order():
    left, right = np.full((2, 3), 7, np.uint8), np.full((2, 3), 9, np.uint8)
    assert side_by_side(left, right, gap=1)[0].tolist() == [7, 7, 7, 32, 9, 9, 9]


def test_panels_are_joined_on_a_dark_ground():
    small = panel(np.full((10, 20), 200, np.uint8), "a")
    wide = panel(np.full((10, 20, 3), 200, np.uint8), "b", width=40)
    assert in_row(small, wide).shape == (42, 20 + 8 + 40, 3)
    assert in_column(small, wide).shape == (32 + 8 + 42, 40, 3)
    assert (in_row(small, wide)[-1, 0] == BACKGROUND).all()


def test_normal_map_does_not_wrap_for_vectors_slightly_too_long():
    assert normal_map(np.array([[[1.02, 0, -1.02]]])).tolist() == [[[255, 128, 255]]]


def test_colors_grow_darker_to_the_stated_range_and_stay_there():
    picture = color_errors(np.array([[10.0, 11.0, 1e9, 0.0, np.nan]]), largest=10)
    assert picture.dtype == np.uint8
    assert picture.shape == (1, 5, 3)
    assert (picture[0, 0] == picture[0, 1]).all()
    assert (picture[0, 0] == picture[0, 2]).all()
    assert (picture[0, 0] != picture[0, 3]).any()
    assert (picture[0, 4] == 255).all()


@pytest.mark.parametrize("largest", [0.0, -1.0, np.nan, np.inf])
def test_an_impossible_color_range(largest):
    with pytest.raises(InputError, match="range"):
        color_errors(np.zeros((4, 5)), largest)


def test_object_at_the_border_is_not_cut_off():
    mask = np.ones((5, 7), bool)
    assert object_window(mask) == (slice(0, 5), slice(0, 7))
    assert Camera(7, 5, 1.0, 1.0, 3.0, 2.0).cropped(*object_window(mask)).shape == (5, 7)
