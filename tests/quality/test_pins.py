"""Every method keeps its errors and iteration counts on three small captures.

A change that is meant: python tests/quality/pins.py --write, and say in the commit what moved.
"""

import pytest

from rakelight.methods import METHODS
from tests.quality.pins import CAPTURES, measure, pinned

TOLERANCE = 0.01
TO_HALVE = [name for name in METHODS if name.startswith("multi-light")]

_measured = {}


def measured(method, name):
    if (method, name) not in _measured:
        _measured[method, name] = measure(method, name)
    return _measured[method, name]


def test_every_method_is_pinned_and_nothing_else():
    pins = pinned()
    assert set(pins) == {"input", *METHODS}
    assert all(set(pins[method]) == set(CAPTURES) for method in pins)


@pytest.mark.parametrize("name", CAPTURES)
@pytest.mark.parametrize("method", ["input", *METHODS])
def test_errors_within_one_percent_and_iterations_exact(method, name):
    now, pin = measured(method, name), pinned()[method][name]
    assert now["rmse_mm"] == pytest.approx(pin["rmse_mm"], rel=TOLERANCE)
    assert now["mae_deg"] == pytest.approx(pin["mae_deg"], rel=TOLERANCE)
    assert now.get("iterations") == pin.get("iterations")


@pytest.mark.parametrize("name", CAPTURES)
@pytest.mark.parametrize("method", TO_HALVE)
def test_several_photographs_halve_the_angle(method, name):
    """The depth may lose a little: the published procedure bends steep sides and jumps."""
    before, after = measured("input", name), measured(method, name)
    assert after["mae_deg"] <= before["mae_deg"] / 2
    assert after["rmse_mm"] <= 1.15 * before["rmse_mm"]
