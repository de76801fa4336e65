"""Where the drawings put their marks."""

import numpy as np
import pytest

from rakelight.model import Lights
from rakelight.report.charts import drawn_lights, energy_curve, error_bars, tilts, viewer_lights


def white(*vectors, **place):
    vector = np.array(vectors, float)[:, None]
    return Lights(vector, np.full(vector.shape[:2], 0.1), **place)


def test_a_lamp_is_drawn_where_the_camera_sees_it():
    # right and down by 30 degrees, then straight above
    drawn = drawn_lights(white([0.5, 0, -np.sqrt(0.75)], [0, -2, 0]), ("a", "b"))
    assert [(round(lamp.x), round(lamp.y)) for lamp in drawn] == [(50, 0), (0, -100)]
    assert [round(lamp.azimuth) for lamp in drawn] == [90, 0]
    assert [round(lamp.elevation) for lamp in drawn] == [60, 0]
    assert tilts(drawn) == pytest.approx((30, 60, 90))
    assert drawn[1].size > drawn[0].size
    assert viewer_lights(drawn)["0"] == pytest.approx({"azimuth": 90, "elevation": 60})


def test_near_lights_have_a_distance_and_dark_ones_are_left_out():
    positions = np.array([[[0.0, 0, 0.1]], [[0, 0, 9]]])
    lights = white([0, 0, -1.0], [0, 0, 0], position_m=positions, middle_m=[0, 0, 0.5])
    (lamp,) = drawn_lights(lights, ())
    assert (lamp.name, lamp.distance_m) == ("photograph 0", pytest.approx(0.4))


def test_coloured_lights_are_three_and_the_viewer_gets_their_middle():
    vector = np.array([[[0.6, 0, -0.8], [0, 0.6, -0.8], [0, 0, -1.0]]])
    drawn = drawn_lights(Lights(vector, np.zeros((1, 3))), ("x",))
    assert [lamp.channel for lamp in drawn] == ["red", "green", "blue"]
    middle = viewer_lights(drawn)["0"]
    assert middle["azimuth"] == pytest.approx(135)
    assert np.cos(np.radians(middle["elevation"])) == pytest.approx(np.hypot(0.2, 0.2))


def test_a_lamp_behind_the_object_is_not_the_viewers():
    drawn = drawn_lights(white([0, 0.5, np.sqrt(0.75)], [0, 0, -1.0]), ())
    assert [round(lamp.tilt) for lamp in drawn] == [150, 0]
    assert list(viewer_lights(drawn)) == ["1"]


@pytest.mark.parametrize(
    "energy",
    [
        (10.056, 10.045),
        (100.56, 100.45),
        (54.9, 54.1),
        (2e7, 1.5e7),
        (2e-5, 1e-5),
        (321.8, 14.6),
        (4e4, 99.0),
        (1.0076868e-06, 1.0076853e-06),
    ],
)
def test_the_energy_s_scale_can_be_read(energy):
    labels = [label for _, label in energy_curve(energy).lines]
    assert 2 <= len(set(labels)) == len(labels) <= 6
    assert all(min(energy) <= float(label) <= max(energy) for label in labels)


def test_equal_energies_have_their_value():
    assert [label for _, label in energy_curve((0.5, 0.5)).lines] == ["0.5"]


def test_the_energy_falls_from_left_to_right():
    curve = energy_curve((1000.0, 100.0, 10.0))
    assert curve.logarithmic
    (x, y) = np.array([dot[:2] for dot in curve.dots]).T
    assert (np.diff(x) > 0).all()
    assert np.diff(y) == pytest.approx([np.diff(y)[0]] * 2, abs=0.2)  # equal factors, equal steps
    assert np.diff(y)[0] > 0
    assert [label for _, label in curve.lines] == ["10", "100", "1000"]
    assert not energy_curve((3.0, 2.0)).logarithmic
    assert energy_curve((3.0, 3.0)) is not None
    assert energy_curve((3.0,)) is energy_curve((3.0, float("nan"))) is None


def test_bars_are_as_long_as_the_errors():
    bars = error_bars((0.01, float("nan"), 0.04), ("a",))
    assert [bar["length"] for bar in bars] == [25, 0, 100]
    assert [bar["percent"] for bar in bars] == [1, None, 4]
    assert [bar["name"] for bar in bars] == ["a", "photograph 1", "photograph 2"]
