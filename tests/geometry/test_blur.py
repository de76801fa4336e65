"""Gaussian means over a mask."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rakelight.geometry.blur import blurred

SHAPE = (96, 120)
ROW, COLUMN = np.mgrid[: SHAPE[0], : SHAPE[1]]
DISC = np.hypot(ROW - 40, COLUMN - 60) < 30


def test_blurring_leaves_a_constant_on_the_mask():
    constant = blurred(np.where(DISC, 2.0, np.nan), 4.0, DISC)
    np.testing.assert_allclose(constant[DISC], 2.0)


@pytest.mark.parametrize("channels", [(), (1,), (3,), (6,)])
def test_it_is_the_gaussian_mean_over_the_mask(channels):
    image = np.random.default_rng(0).normal(size=(*SHAPE, *channels))
    mask = DISC.reshape(*SHAPE, *[1] * len(channels))
    total, weight = (
        gaussian_filter(each, 1.5, axes=(0, 1), mode="constant")
        for each in (np.where(mask, image, 0.0), 1.0 * mask)
    )
    found = blurred(image, 1.5, DISC)
    assert found.shape == image.shape
    np.testing.assert_allclose(found[DISC], (total / np.maximum(weight, 1e-6))[DISC], atol=1e-12)
