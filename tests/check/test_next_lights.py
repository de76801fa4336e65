"""Where the next light should be: the mathematics against plain numbers."""

import numpy as np
import pytest

from rakelight.check.next_lights import (
    FARTHEST_DEG,
    NEARBY,
    NEAREST_DEG,
    across,
    gains,
    in_words,
    information,
    low_light_findings,
    next_light_findings,
    next_lights,
    one_side,
    reachable,
    sphere_normals,
    tilt_deg,
)


def ring(azimuths_deg, tilt=40.0):
    turn, off = np.radians(azimuths_deg), np.radians(tilt)
    return np.stack(
        [np.sin(off) * np.sin(turn), -np.sin(off) * np.cos(turn), np.full(len(turn), -np.cos(off))],
        axis=-1,
    )


def variance(M, normals):
    return np.trace(across(normals) @ np.linalg.inv(M), axis1=1, axis2=2).mean()


def test_a_gain_is_what_the_light_takes_off_the_variance():
    normals, lights = sphere_normals(), ring([0, 70, 130])
    M, directions = information(lights, normals), reachable()
    before = variance(M, normals)
    for i in (0, 17, 60):
        with_it = information(np.vstack([lights, directions[i]]), normals)
        assert gains(M, normals, directions)[i] == pytest.approx(
            before - variance(with_it, normals)
        )


def test_the_variance_is_that_of_a_simulated_normal():
    rng = np.random.default_rng(0)
    n, lights = np.array([0.1, -0.2, -1.0]) / np.sqrt(1.05), ring([0, 90, 200, 300])
    M = lights.T @ lights
    noisy = (lights @ n)[None] + 0.01 * rng.standard_normal((20_000, len(lights)))
    b = np.linalg.solve(M, lights.T @ noisy.T).T
    found = b / np.linalg.norm(b, axis=1, keepdims=True)
    squared_angle = np.arccos(np.clip(found @ n, -1, 1)) ** 2
    expected = 0.01**2 * np.trace(across(n[None])[0] @ np.linalg.inv(M))
    assert squared_angle.mean() == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("dark", "side"), [(0, 1), (90, 0), (180, 1), (270, 0)])
def test_the_next_light_is_where_none_was(dark, side):
    lit = [a for a in range(0, 360, 20) if abs((a - dark + 180) % 360 - 180) > 70]
    best = next_lights(ring(lit), sphere_normals(), 1)[0].direction
    assert best @ ring([dark])[0] > 0.75
    assert abs(best[side]) > abs(best[1 - side])


def test_directions_are_in_reach_and_apart():
    found = next_lights(ring([10, 20, 30]), sphere_normals(), 4)
    for i, each in enumerate(found):
        assert np.linalg.norm(each.direction) == pytest.approx(1)
        assert NEAREST_DEG - 1e-6 <= tilt_deg(each.direction) <= FARTHEST_DEG + 1e-6
        assert all(each.direction @ other.direction < NEARBY for other in found[:i])


def test_more_lights_gain_less_and_brightness_does_not_count():
    few, many = (next_lights(ring(np.arange(0, 360, step)), sphere_normals(), 1)[0]
                 for step in (120, 15))  # fmt: skip
    assert few.gain > 2 * many.gain > 0
    brighter = next_lights(7 * ring([0, 120, 240]), sphere_normals(), 1)[0]
    assert brighter.gain == pytest.approx(few.gain)


@pytest.mark.parametrize(
    ("azimuth", "words"),
    [(0, "from above"), (44, "from the upper right"), (181, "from below"), (270, "from the left")],
)
def test_words(azimuth, words):
    assert in_words(ring([azimuth])[0]) == f"{words}, about 40 degrees off the camera axis"


def test_one_side():
    assert one_side(ring([300, 340, 20, 60])) == pytest.approx(0, abs=1e-6)
    assert one_side(ring([0, 90, 180, 270])) is None
    assert one_side(ring([80, 90, 100], tilt=3)) is None  # no side: all from the camera


@pytest.mark.parametrize(("tilt", "said"), [(45, False), (55, False), (70, True), (80, True)])
def test_low_lights_leave_a_sphere_in_shadow(tilt, said):
    # Of the half of a sphere that is seen a share of (1 - cos tilt) / 2 is turned away: 0.15, 0.21,
    # 0.33, 0.41.  Normals are spread evenly over its picture.
    x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(-1, 1, 101)] * 2))
    inside = x**2 + y**2 < 1
    x, y = x[inside], y[inside]
    normals = np.stack([x, y, -np.sqrt(1 - x**2 - y**2)], axis=-1)
    findings = low_light_findings(ring(np.arange(0, 360, 30), tilt=tilt), normals)
    assert [each.code for each in findings] == ["lights-low"] * said
    assert not said or f"{(1 - np.cos(np.radians(tilt))) / 2:.0%}" in findings[0].message


def test_low_lights_over_a_nearly_flat_surface_are_welcome():
    slopes = np.random.default_rng(0).normal(0, 0.05, (500, 2))
    normals = np.column_stack([slopes, np.full(500, -1.0)])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert low_light_findings(ring(np.arange(0, 360, 30), tilt=78), normals) == ()


def test_findings():
    normals = sphere_normals()
    (found,) = next_light_findings(ring([60, 90, 120]), next_lights(ring([60, 90, 120]), normals))
    assert (found.severity, found.code) == ("warning", "lights-on-one-side")
    assert found.message.startswith("all lights come from the right:")
    around = ring(np.arange(0, 360, 15))
    assert next_light_findings(around, next_lights(around, normals)) == ()


def test_the_gain_is_of_the_error_not_its_square():
    normals = np.array([[0.0, 0.0, -1.0]])
    lights = np.array([[-0.6, 0.0, -0.8], [-0.5, 0.2, -0.8], [-0.5, -0.2, -0.8]])
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    found = next_lights(lights, normals, 1)[0]
    before, after = (
        np.trace((across(normals) @ np.linalg.inv(information(each, normals)))[0])
        for each in (lights, np.vstack([lights, found.direction]))
    )
    assert found.gain == pytest.approx(1 - np.sqrt(after / before))
