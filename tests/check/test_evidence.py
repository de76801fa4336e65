import numpy as np
import pytest

from rakelight.check.evidence import FEWEST, LIKELY, SURELY, log_likelihood_ratio


def test_the_ratio_is_that_of_the_likelihoods_at_their_maxima():
    figures = np.random.default_rng(1).normal(0.8, 1.0, 12)
    # The variance is profiled; the mean below zero that fits best is zero itself.
    best, other = (np.mean((figures - mean) ** 2) for mean in (figures.mean(), 0.0))
    assert log_likelihood_ratio(figures) == pytest.approx(6 * np.log(other / best))


def test_the_sign_is_that_of_the_mean():
    figures = np.random.default_rng(2).normal(1.0, 0.5, 9)
    assert log_likelihood_ratio(-figures) == pytest.approx(-log_likelihood_ratio(figures))


def test_pixels_that_err_together_count_once():
    blocks = np.random.default_rng(3).normal(0.0, 1.0, 8)
    pixels = np.repeat(blocks, 100)
    assert abs(log_likelihood_ratio(blocks)) < LIKELY / 2
    assert abs(log_likelihood_ratio(pixels)) > LIKELY


def test_weights_and_what_is_no_figure():
    figures = np.array([1.0, 2.0, 1.5, 1.2, np.nan])
    assert log_likelihood_ratio(figures) == log_likelihood_ratio(figures[:4])
    light = log_likelihood_ratio(np.append(figures[:4], -9.0), np.array([1, 1, 1, 1, 1e-6]))
    assert light > log_likelihood_ratio(np.append(figures[:4], -9.0), np.ones(5))
    assert log_likelihood_ratio(figures[: FEWEST - 1]) == 0


def test_how_often_it_is_wrong_about_figures_that_scatter_about_zero():
    rng = np.random.default_rng(4)
    ratios = np.array([log_likelihood_ratio(rng.normal(size=12)) for _ in range(4000)])
    assert np.mean(ratios > LIKELY) == pytest.approx(0.0020, abs=0.0015)
    assert np.mean(ratios > SURELY) < 0.0005
