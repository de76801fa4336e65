import numpy as np
import pytest

from rakelight.check.odd_photograph import ODD, odd_finding, odd_photographs

ERRORS = np.array([1.0, 1.2, 0.8, 1.1, 0.9, 1.0, 1.05])


def either(errors):
    """What is said of photographs of one brightness."""
    same = np.ones(len(errors))
    return odd_photographs(errors, 20 * same, 10 * same).either


def test_the_one_that_is_predicted_much_worse_is_odd():
    errors = ERRORS.copy()
    errors[2] = 1.1 * ODD
    assert np.flatnonzero(either(errors)).tolist() == [2]
    errors[2] = 0.9 * ODD
    assert not either(errors).any()


@pytest.mark.parametrize("brightness", [0.25, 5.0])
def test_a_dark_or_a_bright_one_is_not_odd_for_that(brightness):
    light = np.ones(7)
    light[3] = brightness
    bright_errors, noise = ERRORS * light, ERRORS
    assert not odd_photographs(bright_errors, 20 * light, 10 * light).either.any()
    assert not odd_photographs(noise, 20 * light, 10 * light).either.any()


def test_a_dark_one_that_shows_something_else_is_odd():
    light, variation = np.full(7, 20.0), np.full(7, 10.0)
    light[3], variation[3] = 2.0, 1.0
    assert np.flatnonzero(odd_photographs(ERRORS, light, variation).foreign).tolist() == [3]
    assert not odd_photographs(ERRORS, light, variation).suspect.any()


def test_of_few_photographs_none_is_odd():
    assert not odd_photographs(
        np.array([1.0, 1.0, 1.0, 1.0, 9.0]), *np.full((2, 5), 20.0)
    ).either.any()


def test_many_odd_ones_are_no_exceptions():
    errors = np.array([1.0, 1.0, 1.0, 1.0, 9.0, 9.0, 9.0])
    assert not either(errors).any()


def test_what_shows_nothing_is_not_odd():
    errors = ERRORS.copy()
    errors[1] = np.nan
    assert not either(errors).any()
    assert not either(np.full(7, np.nan)).any()


def test_the_finding_names_them():
    odd = np.array([False, True, False])
    assert "b.png" in odd_finding(("a.png", "b.png", "c.png"), odd).message
    assert "photograph 1" in odd_finding((), odd).message
