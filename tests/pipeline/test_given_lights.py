"""Lights that are given and are not those of the photographs are said to be wrong."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight import GivenLights, MultiLight, check_capture, refine
from rakelight.pipeline.given_lights import CODE, MENDED, REMEDY, wrong_lights
from rakelight.prepare import prepare
from tests.check.wrong_captures import sound


def directions():
    return sound("head")[1].lights.direction[:, 0]


def turned(vectors, off_deg):
    """Each by so many degrees, to a side of its own."""
    side = np.cross(vectors, np.random.default_rng(0).standard_normal(vectors.shape))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return np.cos(np.radians(off_deg)) * vectors + np.sin(np.radians(off_deg)) * side


def said(given):
    return wrong_lights(replace(prepare(sound("head")[0]), lights=given))


def around_the_object():
    """(N, 3) metres, places in the lights' directions, 0.8 metres from the object."""
    return [0, 0, np.nanmedian(sound("head")[0].depth_m)] + 0.8 * directions()


@pytest.mark.parametrize("off_deg", [0, 5])
def test_lights_that_are_right_are_not_doubted(off_deg):
    assert said(GivenLights(directions=turned(directions(), off_deg))) == ()
    assert said(GivenLights(positions_m=around_the_object())) == ()
    assert said(None) == ()


@pytest.mark.parametrize(
    ("mistake", "remedy"),
    [
        (lambda each: each * [-1, 1, 1], "x turned round"),
        (lambda each: each * [1, -1, 1], "y turned round"),
        (lambda each: each[:, [1, 0, 2]], "x and y exchanged"),
        (lambda each: each[[3, 6, 0, 5, 1, 7, 2, 4]], REMEDY),
    ],
)
def test_wrong_directions_are_named_with_the_mistake(mistake, remedy):
    (finding,) = said(GivenLights(directions=mistake(directions())))
    assert (finding.severity, finding.code) == ("warning", CODE)
    assert remedy in finding.remedy
    assert "degrees away (the median); those of 00" in finding.message


def test_positions_in_millimetres_are_told():
    (finding,) = said(GivenLights(positions_m=1000 * around_the_object()))
    assert "divided by 1000" in finding.remedy


@pytest.mark.parametrize("fixed", [False, True])
def test_no_photograph_is_blamed_for_wrong_lights(fixed):
    given = GivenLights(directions=directions() * [-1, 1, 1], fixed=fixed)
    capture = replace(sound("head")[0], lights=given)
    findings = refine(capture, MultiLight(max_iterations=3)).findings
    codes = [each.code for each in findings]
    assert CODE in codes
    assert "odd-photographs" not in codes
    assert not any("take photographs" in (each.remedy or "") for each in findings)
    report = check_capture(capture)
    assert CODE in {each.code for each in report.findings}
    assert not any("does not fit" in mark for each in report.photographs for mark in each.marks)


def test_lights_in_reverse_order_are_turned_round_as_a_list():
    vectors = np.arange(9.0).reshape(3, 3)
    reverse = MENDED["they fit in reverse order"]
    np.testing.assert_array_equal(reverse(vectors), vectors[::-1])
