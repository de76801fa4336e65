"""Cast shadows left out and highlights found, at the true surface under the true lights."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from rakelight.methods.levels import Level, finest_level
from rakelight.methods.multi_light import outliers
from rakelight.methods.multi_light.outliers import (
    LitSurface,
    Shadows,
    all_shadows,
    in_shadow,
    predicted_shadows,
    remove_outliers,
)
from rakelight.model import Lights
from rakelight.photometry.forward import arriving
from rakelight.photometry.images import LightParameters
from rakelight.photometry.specular import lobes
from rakelight.prepare import prepare
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene
from tests.methods.remembered import remembered

HEAD = remembered(make_shape("head"))
EXPOSED = {"photographs": 10, "tilt_deg": (30.0, 60.0), "exposure": 0.6, "image_noise": 0.003}


@cache
def make_level(paint="pattern", **changes):
    """A level of the head, its true log depth, and lights."""
    options = SceneOptions(camera=HEAD.camera.scaled(0.25), **(EXPOSED | changes))
    capture, truth = render_scene(HEAD, make_albedo(paint), options)
    prepared = prepare(capture)
    level = finest_level(prepared, cut=True)
    depth = truth.depth[prepared.rows, prepared.columns].astype(float)
    log_depth = np.where(level.mask, np.log(depth, where=depth > 0, out=level.prior.copy()), 0)
    return level, np.where(level.mask, log_depth, level.prior), lights_of(truth.lights, level)


def lights_of(lights: Lights, level):
    if lights.position_m is None:
        return LightParameters.distant(lights.vector, lights.ambient)
    return LightParameters(lights.vector, lights.ambient, 1 / lights.distance_m)


def light(level):
    """(N, P, 3) linear light of pixels with a normal, NaN where it does not count."""
    values = level.photographs.light(level.photographs.active)
    return np.where(values < 0, np.nan, values)


@pytest.mark.parametrize("place", [{}, {"lamp_distance_m": 0.6}], ids=["distant", "near"])
def test_cast_shadows_are_left_out_and_nothing_else(place):
    level, log_depth, lights = make_level(cast_shadows=True, **place)
    plain = light(make_level(**place)[0])
    cleared, glossy = remove_outliers(level, log_depth, lights)
    assert not glossy.gloss.any()
    before, after = light(level), light(cleared)
    shadow = plain - before > 0.1
    assert 0.01 < shadow.mean() < 0.2
    assert np.isnan(after[shadow]).mean() > 0.65
    assert np.isnan(after[~shadow & (before > 0.05)]).mean() < 0.015
    assert np.nanmax(np.abs(after - before)) == 0


@pytest.mark.parametrize("place", [{}, {"lamp_distance_m": 0.6}], ids=["distant", "near"])
@pytest.mark.parametrize("exponent", [8.0, 20.0, 60.0])
def test_highlights_are_left_out_or_explained(place, exponent):
    glossy = {"specular": 0.2, "specular_exponent": exponent, **place}
    level, log_depth, lights = make_level(**glossy)
    plain = light(make_level(**place)[0])
    cleared, glossy = remove_outliers(level, log_depth, lights)
    added, left = light(level) - plain, unexplained(cleared, log_depth, glossy) - plain
    bright, gone = added > 0.05, np.isnan(left)
    assert bright.mean() > 0.01
    # A wide highlight is in too many values to do without these.
    assert gone[bright].mean() > (0.8 if exponent > 8 else 0.6)
    assert gone[added < 0.01].mean() < 0.1
    assert rms(left) < 0.45 * rms(added)
    # In units of the lights, which shine at 0.6 of white.  Of a narrow one the top is not seen.
    assert glossy.gloss.sum() == pytest.approx(0.18 if exponent < 60 else 0.13, rel=0.06)


def unexplained(level, log_depth, lights):
    """(N, P, 3) linear light less the highlights, NaN where it does not count."""
    surface, active = LitSurface(level, log_depth, lights), level.photographs.active
    normals, points = surface.normals[active], surface.points_m[active]
    unit = lobes(normals, points, arriving(surface.lights, points))
    return light(level) - np.tensordot(lights.gloss, unit, 1)


def rms(values):
    return np.sqrt(np.nanmean(np.square(values)))


def test_the_geometry_is_computed_once(monkeypatch):
    level, log_depth, lights = make_level(specular=0.2, cast_shadows=True)
    called = []
    for owner, name in ((Level, "normals"), (outliers, "back_project")):
        function = getattr(owner, name)

        def counted(*arguments, name=name, function=function):
            called.append(name)
            return function(*arguments)

        monkeypatch.setattr(owner, name, counted)
    cleared, glossy = remove_outliers(level, log_depth, lights)
    assert cleared is not level
    assert glossy.gloss.any()
    assert sorted(called) == ["back_project", "normals"]


def test_matte_photographs_without_shadows_stay_as_they_are():
    for paint in ("white", "pattern"):
        level, log_depth, lights = make_level(paint)
        cleared, glossy = remove_outliers(level, log_depth, lights)
        assert cleared is level
        assert not glossy.gloss.any()


def test_coloured_lights_have_coloured_highlights():
    # A wide one, which is explained rather than left out.
    level, log_depth, lights = make_level(specular=0.2, specular_exponent=8.0)
    tint = np.array([1.0, 0.8, 0.5])
    photographs = level.photographs
    tinted = (photographs.values * tint).astype(np.uint16)
    level = replace(level, photographs=replace(photographs, values=tinted))
    lights = LightParameters.distant(lights.vector * tint[:, None], lights.ambient * tint)
    cleared, glossy = remove_outliers(level, log_depth, lights)
    plain = light(make_level()[0]) * tint
    added, left = light(level) - plain, unexplained(cleared, log_depth, glossy) - plain
    for channel in range(3):
        assert rms(left[..., channel]) < 0.35 * rms(added[..., channel])


def test_a_lamp_that_was_off_does_no_harm():
    level, log_depth, lights = make_level(specular=0.2, cast_shadows=True)
    vector = lights.vector.copy()
    vector[3] = 0
    cleared, _ = remove_outliers(level, log_depth, replace(lights, vector=vector))
    assert np.isfinite(light(cleared)).mean(axis=(1, 2)).min() > 0.85


def test_shadows_looked_up_for_some_pixels_lie_where_they_are(monkeypatch):
    level, log_depth, lights = make_level("white", cast_shadows=True)
    surface, active = LitSurface(level, log_depth, lights), level.photographs.active
    exact = np.zeros((len(level.photographs), *active.shape), dtype=bool)
    exact[:, active] = predicted_shadows(surface, active).values[..., 0]

    def agreement(pixels, shift=0):
        monkeypatch.setattr("rakelight.methods.multi_light.outliers.SAMPLE_PIXELS", pixels)
        few = all_shadows(surface)[..., 0] & active
        return (np.roll(few, (shift, shift), axis=(1, 2)) & exact).sum()

    # Cells that stood at their pixel's corner would be a pixel and a half off.
    assert level.photographs.subsampling(100) >= 4
    assert max(range(-3, 4), key=lambda shift: agreement(100, shift)) == 0
    assert agreement(400) > 0.55 * exact.sum()


@pytest.mark.parametrize("room", [0.1, 1.0])
def test_light_of_the_room_hides_no_shadow(room):
    ambient, lit, hidden = np.full((4, 1, 1), room), np.ones((4, 50, 1)), np.zeros((4, 50, 1), bool)
    hidden[0] = True
    dark = np.broadcast_to(0.3 * (np.where(hidden, 0.0, 1.0) + room), (4, 50, 3)).copy()
    shadows = Shadows.of(dark, hidden, lit, ambient)
    assert shadows.shown
    np.testing.assert_array_equal(shadows.values, np.broadcast_to(hidden, dark.shape))
    bright = np.full((4, 50, 3), 0.3 * (1 + room))
    assert not Shadows.of(bright, hidden, lit, ambient).shown


def test_what_is_bright_in_a_predicted_shadow_is_lit():
    # Lights found with the shadows in the photographs stand too low, and cast them too large.
    level, log_depth, lights = make_level(cast_shadows=True)
    plain, before = light(make_level()[0]), light(level)
    lower = lights.vector * [1.6, 1.6, 0.8]
    surface = LitSurface(level, log_depth, replace(lights, vector=lower))
    hidden = in_shadow(surface, level.photographs.active) & np.isfinite(before)
    shadow, lit = plain - before > 0.1, np.abs(plain - before) < 0.02
    assert hidden[lit].sum() > 1.5 * hidden[shadow].sum()  # most values there are lit
    after = light(remove_outliers(level, log_depth, surface.parameters)[0])
    assert np.isnan(after[shadow]).mean() > 0.6
    assert np.isnan(after[lit & hidden & (before > 0.1)]).mean() < 0.1
