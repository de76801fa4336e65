"""What is told from paint in one photograph, and what is not."""

import numpy as np
import pytest

from rakelight.geometry.grid import Links
from rakelight.methods.single_image.texture import (
    from_afar,
    off_line,
    shading_weight,
    texture_likelihood,
    without_texture,
)

SHAPE = (96, 120)
LINKS = Links.of(np.ones(SHAPE, bool))
ROW, COLUMN = np.mgrid[: SHAPE[0], : SHAPE[1]]
NOISE = 0.01 * np.random.default_rng(0).normal(size=(*SHAPE, 3))


def loops(colour):
    """Yarn whose loops are 6 pixels wide."""
    shade = np.sin(ROW * 2 * np.pi / 6) * np.cos(COLUMN * 2 * np.pi / 6)
    return 1 + 0.4 * shade[..., None] * np.array(colour) + NOISE


def leaves(colours):
    """Large leaves of paint, as in photographs."""
    rng = np.random.default_rng(1)
    image = np.ones((*SHAPE, 3))
    for _ in range(60):
        y, x, radius = rng.uniform(0, SHAPE[0]), rng.uniform(0, SHAPE[1]), rng.uniform(8, 20)
        image[np.hypot(ROW - y, COLUMN - x) < radius] = colours[rng.integers(len(colours))]
    return image + NOISE


@pytest.mark.parametrize("colour", [[1.0, 1.0, 1.0], [1.2, 0.4, 1.2]])
def test_yarn_is_relief_though_its_folds_are_of_another_colour(colour):
    photograph = loops(colour)
    relief = texture_likelihood(photograph, LINKS)
    assert relief.min() > 0.9
    assert shading_weight(photograph, relief, LINKS, colour_weight=26.0).min() > 0.9


def test_noise_of_a_channel_that_the_paint_hardly_reflects_is_no_second_paint():
    photograph = loops([1.0, 0.0, 0.0]) * [1.0, 0.05, 0.1]
    photograph[..., 2] += 0.5 * np.random.default_rng(1).random(SHAPE) ** 4
    assert texture_likelihood(photograph, LINKS).min() > 0.9


def test_leaves_of_paint_are_not():
    photograph = leaves([[0.6, 0.5, 0.6], [1.3, 1.3, 1.0], [0.9, 1.1, 1.4]])
    relief = texture_likelihood(photograph, LINKS)
    assert relief.max() < 0.01
    assert shading_weight(photograph, relief, LINKS, colour_weight=26.0).mean() < 0.6


def test_threads_of_three_paints_are_not():
    colours = np.array([[1.3, 0.7, 0.7], [0.7, 1.3, 0.7], [0.7, 0.7, 1.3]])
    relief = texture_likelihood(colours[(ROW + COLUMN) // 3 % 3] + NOISE, LINKS)
    assert relief.max() < 0.1


def test_one_spot_that_looks_like_yarn_is_an_exception():
    spot = (np.hypot(ROW - 40, COLUMN - 60) < 20)[..., None]
    photograph = np.where(spot, loops([1.0, 1.0, 1.0]), leaves([[0.6, 0.5, 0.6], [1.3, 1.3, 1.0]]))
    assert texture_likelihood(photograph, LINKS).max() < 0.2


def test_a_stain_on_yarn_is_not_relief():
    photograph = loops([1.0, 0.8, 1.0]) * np.where(COLUMN < 60, 1.0, 0.3)[..., None]
    relief = texture_likelihood(photograph, LINKS)
    assert relief[:, 57:63].max() < 0.5
    assert relief[:, :40].min() > 0.9


def test_yarn_is_relief_beside_yarn_of_another_paint_too():
    left = COLUMN < 60
    white = loops([1.0, 1.0, 1.0])
    photograph = np.where(left[..., None], white * [1.0, 0.05, 0.1], white)
    beside = (slice(20, -20), slice(50, 70))
    assert texture_likelihood(photograph, LINKS)[beside].max() < 0.5
    assert texture_likelihood(photograph, LINKS, [left, ~left])[beside].min() > 0.9


def test_what_is_of_no_paint_is_no_relief():
    left = COLUMN < 60
    relief = texture_likelihood(loops([1.0, 1.0, 1.0]), LINKS, [left])
    assert relief[:, :60].min() > 0.9
    assert (relief[:, 60:] == 0).all()


def test_from_afar_each_paint_keeps_its_brightness():
    left = COLUMN < 60
    intensity = np.where(left, 1.0, 3.0)
    np.testing.assert_allclose(from_afar(intensity, [left, ~left]), intensity)
    assert from_afar(intensity, [LINKS.mask])[40, 59] > 1.5
    np.testing.assert_array_equal(from_afar(intensity, []), intensity)


def test_a_weight_of_0_takes_everything_for_shape():
    assert (
        shading_weight(leaves([[0.6, 0.5, 0.6]]), np.zeros(SHAPE), LINKS, colour_weight=0.0) == 1
    ).all()


def test_only_relief_is_taken_from_an_intensity():
    intensity, half = loops([1.0, 1.0, 1.0]).mean(axis=-1), 1.0 * (COLUMN < 60)
    plain = without_texture(intensity, half, [LINKS.mask])
    np.testing.assert_array_equal(plain[:, 60:], intensity[:, 60:])
    assert plain[:, :60].std() < 0.1 * intensity[:, :60].std()


def test_part_off_the_line_is_none_for_one_direction_and_most_for_noise():
    assert off_line(loops([1.0, 0.3, 0.5]) - NOISE, LINKS).max() < 1e-6
    assert off_line(NOISE, LINKS).min() > 0.3
