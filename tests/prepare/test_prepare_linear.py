"""Linear light and the pixels that can be used."""

import numpy as np
import pytest

from rakelight.model import BLACK, SATURATED
from rakelight.prepare.linear import linear_table, to_linear, usable

DTYPES = [np.uint8, np.uint16]


def srgb_code(light):
    """Linear light 0..1 to sRGB 0..1, IEC 61966-2-1."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("dtype", DTYPES)
def test_srgb_round_trip_of_every_value(dtype):
    values = np.arange(np.iinfo(dtype).max + 1).astype(dtype)
    light = to_linear(values, "srgb").astype(np.float64)
    np.testing.assert_array_equal(np.rint(srgb_code(light) * np.iinfo(dtype).max), values)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("encoding", ["linear", "srgb"])
def test_tables_rise_from_nought_to_one(dtype, encoding):
    table = linear_table(np.dtype(dtype), encoding)
    assert (table[0], table[-1]) == (0, 1)
    assert len(table) == np.iinfo(dtype).max + 1
    assert (np.diff(table) > 0).all()
    assert table.dtype == np.float32


def test_linear_is_proportional():
    values = np.array([[0, 13107, 65535]], np.uint16)
    np.testing.assert_allclose(to_linear(values, "linear"), [[0, 0.2, 1]], rtol=1e-7)


def test_eight_and_sixteen_bits_agree():
    values = np.arange(256).astype(np.uint8)
    wide = (values.astype(np.uint16)) * np.uint16(257)
    for encoding in ("linear", "srgb"):
        np.testing.assert_array_equal(to_linear(values, encoding), to_linear(wide, encoding))


def test_known_srgb_values():
    # 18 % grey is sRGB 118 (119 gives 18.4 %)
    assert to_linear(np.array([118], np.uint8), "srgb")[0] == pytest.approx(0.1812, abs=5e-4)


@pytest.mark.parametrize("dtype", DTYPES)
def test_usable_thresholds(dtype):
    top = np.iinfo(dtype).max
    values = np.arange(top + 1).astype(dtype)
    good = values[usable(values)]
    assert good.min() == np.floor(BLACK * top) + 1
    assert good.max() == np.ceil(SATURATED * top) - 1
    assert usable(values).sum() == int(good.max()) - int(good.min()) + 1


def test_channels_are_judged_one_by_one():
    pixel = np.array([[[65535, 30000, 0]]], np.uint16)
    np.testing.assert_array_equal(usable(pixel), [[[False, True, False]]])
