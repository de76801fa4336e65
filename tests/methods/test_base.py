"""What is said of lights that leave the surface open, and how sure of a normal photographs are."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import spearmanr

from rakelight.errors import InputError, MethodError
from rakelight.geometry.grid import Links, mean_gradient
from rakelight.geometry.normals import normals_from_gradient, surface_normals
from rakelight.methods.base import (
    AMBIGUOUS,
    in_one_plane,
    light_findings,
    photometric_confidence,
    require_photographs,
)
from rakelight.methods.ldr_ps import LdrPs
from rakelight.methods.multi_light import MultiLight
from rakelight.methods.multi_light.confidence import missed_curvature
from rakelight.methods.single_image.fusion_like import FusionLike
from rakelight.metrics import normal_error_map_deg
from rakelight.model import Camera, Lights
from rakelight.pipeline import refine
from rakelight.synthetic import DEMO_OPTIONS, make_albedo, make_shape, render_scene
from tests.methods.remembered import remembered

CAMERA = Camera(9, 9, 50.0, 50.0, 4.0, 4.0)


def lights(tilt_deg, azimuth_deg, strength=1.0):
    tilt, azimuth = np.radians(np.broadcast_arrays(tilt_deg, azimuth_deg))
    toward = np.stack(
        [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)], axis=-1
    )
    vector = toward * np.broadcast_to(strength, tilt.shape)[..., None]
    return Lights(vector[:, None], np.zeros((len(vector), 1)))


AROUND = np.arange(8) * 45.0


def codes(found, names=()):
    return [finding.code for finding in light_findings(found, names)]


# ---- lights


@pytest.mark.parametrize(("tilt_deg", "expected"), [(5.9, ["one-lamp-position"]), (6.1, [])])
def test_lights_within_six_degrees_are_in_one_place(tilt_deg, expected):
    assert codes(lights(tilt_deg, AROUND)) == expected


def test_lights_on_an_arc_through_the_optical_axis_are_in_one_plane():
    arc = lights(np.linspace(-40, 40, 8), 20.0)
    assert codes(arc) == ["lights-in-one-plane"]
    assert in_one_plane(arc)


def test_lights_all_around_need_no_warning():
    assert codes(lights(30.0, AROUND)) == []
    assert not in_one_plane(lights(30.0, AROUND))


def test_two_lights_are_too_few_to_tell_a_plane():
    assert not in_one_plane(lights(30.0, AROUND[:2]))


@pytest.mark.parametrize(("strength", "expected"), [(0.019, ["dark-photographs"]), (0.021, [])])
def test_a_lamp_below_a_fiftieth_of_the_others_is_dark(strength, expected):
    strengths = np.where(np.arange(8) == 2, strength, 1.0)
    assert codes(lights(30.0, AROUND, strengths)) == expected


def test_dark_photographs_are_named_and_left_out():
    # Only the dark lamp is off the plane of the others.
    tilt, azimuth = np.append(np.linspace(-40, 40, 5), 40.0), np.append(np.full(5, 0.0), 90.0)
    strength = np.append(np.ones(5), 1e-3)
    names = tuple(f"{letter}.png" for letter in "abcdef")
    dark, plane = light_findings(lights(tilt, azimuth, strength), names)
    assert in_one_plane(lights(tilt, azimuth, strength))
    assert not in_one_plane(lights(tilt, azimuth))
    assert " in f.png: it does not reach the object, or saturates" in dark.message
    assert plane.code == "lights-in-one-plane"
    assert plane.message.split(" in ")[-1].startswith("a.png, b.png, c.png, d.png and 1 more")


def test_fewer_than_three_lit_photographs_are_told():
    strength = np.array([1.0, 1.0, 1e-3])
    assert codes(lights(30.0, AROUND[:3], strength)) == ["dark-photographs", "few-lights"]
    # Those of a lamp that is off may be most of them.
    strength = np.array([1.0, 0.9, *np.full(6, 1e-3)])
    assert codes(lights(30.0, AROUND, strength)) == ["dark-photographs", "few-lights"]


# ---- confidence


def test_more_noise_or_less_information_is_less_confidence():
    tensor = np.array([[1.0, 0.0, 1.0]])

    def found(factor, noise):
        return photometric_confidence(factor * tensor, noise, np.ones(1), CAMERA)[0]

    assert found(1.0, 0.001) > found(1.0, 0.002) > found(1.0, 0.01)
    # The information is that of squared derivatives: four times it is worth half the noise.
    assert found(4.0, 0.002) == pytest.approx(found(1.0, 0.001), rel=1e-12)


@pytest.mark.parametrize("tensor", [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
def test_an_open_normal_has_next_to_no_confidence(tensor):
    found = photometric_confidence(np.array([tensor]), 0.01, np.ones(1), CAMERA)
    assert found[0] < 1e-9


def test_doubt_is_averaged_inside_the_mask_only():
    mask = np.zeros(CAMERA.shape, bool)
    mask[:, :4] = True
    tensor = np.where(mask[..., None], [1e4, 0.0, 1e4], 0.0)
    even = photometric_confidence(tensor, 0.01, np.ones(mask.shape), CAMERA, mask)
    alone = photometric_confidence(tensor, 0.01, np.ones(mask.shape), CAMERA)
    np.testing.assert_allclose(even[mask], alone[mask], rtol=1e-9)
    tensor[4, 1] = 0
    spoilt = photometric_confidence(tensor, 0.01, np.ones(mask.shape), CAMERA, mask)
    assert spoilt[4, 2] < even[4, 2]


def ranked(name, distance, **changes):
    """How confidence ranks the errors of a result's normals, and of its depth map's.

    At a third of the size, which tells the same in a fraction of the time.
    """
    shape = SHAPES[name]
    options = replace(DEMO_OPTIONS, camera=shape.camera.scaled(0.35), **changes)
    capture, truth = render_scene(shape, make_albedo("pattern"), options)
    result = refine(capture, MultiLight(distance=distance))
    depth = np.where(result.mask, result.depth, 1.0).astype(np.float64)
    plain = surface_normals(depth, result.mask, capture.camera)
    return [
        spearmanr(
            result.confidence[truth.mask],
            -normal_error_map_deg(normals, truth.normals, truth.mask)[truth.mask],
        ).statistic
        for normals in (result.normals, plain)
    ]


SHAPES = {name: remembered(make_shape(name)) for name in ("vase", "head")}
HARD = {"cast_shadows": True, "specular": 0.15, "lamp_distance_m": 0.6}


@pytest.mark.parametrize(
    ("shape", "distance", "changes", "least", "least_fine"),
    [
        ("vase", "distant", {}, 0.59, 0.44),
        ("vase", "auto", HARD, 0.55, 0.46),
        # Its folds are what differences of a depth map miss.
        ("head", "distant", {}, 0.57, 0.475),
    ],
)
def test_confidence_ranks_the_normals(shape, distance, changes, least, least_fine):
    # What is left of the finer normals' errors is more alike everywhere.
    fine, plain = ranked(shape, distance, **changes)
    assert plain >= least
    assert fine >= least_fine


@pytest.mark.parametrize("axis", [0, 1])
def test_what_differences_miss_of_a_bend(axis):
    camera = Camera(60, 60, fx=100.0, fy=100.0, cx=29.5, cy=29.5)
    along = np.indices(camera.shape)[axis] / 4.0
    mask, none = np.ones(camera.shape, bool), np.zeros(camera.shape)
    slopes = [none, 0.002 * np.cos(along) / 4][:: 1 if axis == 0 else -1]
    true, _ = normals_from_gradient(*slopes, camera)
    found, _ = normals_from_gradient(*mean_gradient(0.002 * np.sin(along), mask), camera)
    missed = missed_curvature(found, mask)[2:-2, 2:-2]
    error = ((found - true) ** 2).sum(axis=-1)[2:-2, 2:-2]
    assert missed.sum() == pytest.approx(error.sum(), rel=0.05)


def test_nothing_is_missed_beside_a_jump_or_without_a_normal():
    bent = np.zeros((3, 5, 3))
    bent[:, 2] = 1.0
    mask = np.ones((3, 5), bool)
    assert (missed_curvature(bent, mask)[:, 2] > 0).all()
    whole = Links.of(mask)
    cut = Links(mask, whole.right & (np.arange(5) != 2), whole.down)
    assert not missed_curvature(bent, cut)[:, 2].any()
    bent[:, 3] = np.nan
    assert not missed_curvature(bent, mask)[:, 2:].any()


# ---- options


@pytest.mark.parametrize(
    ("options", "name", "needed"),
    [
        ((MultiLight, {"max_iterations": 4.0}), "max_iterations", "a whole number"),
        ((MultiLight, {"max_iterations": True}), "max_iterations", "a whole number"),
        ((MultiLight, {"depth_weight": "3"}), "depth_weight", "a number or None"),
        ((MultiLight, {"tolerance": None}), "tolerance", "a number"),
        ((MultiLight, {"lights": 3}), "lights", "auto, white or coloured"),
        ((FusionLike, {"smooth": 1}), "smooth", "True or False"),
        ((LdrPs, {"shadow": "0.1"}), "shadow", "a number"),
    ],
)
def test_options_of_another_type(options, name, needed):
    kind, values = options
    with pytest.raises(InputError, match=f"option {name} ") as caught:
        kind(**values)
    assert caught.value.needed == needed


def test_numbers_of_numpy_are_numbers():
    assert MultiLight(max_iterations=np.int64(4), depth_weight=np.float32(3)).depth_weight == 3


# ---- how many photographs


@pytest.mark.parametrize(
    ("factor", "needed"), [(1, 3), (1.7, 3), (1.75, 4), (2, 4), (2.0000000001, 4), (4, 16)]
)
def test_scale_squared_photographs_are_needed(factor, needed):
    for count in range(1, 18):
        prepared = SimpleNamespace(photographs=[0] * count, factor=factor, source="here")
        if count >= needed:
            require_photographs(prepared, "ldr-ps", 3, for_the_scale=True)
            continue
        with pytest.raises(MethodError, match="too few photographs") as error:
            require_photographs(prepared, "ldr-ps", 3, for_the_scale=True)
        assert error.value.needed == f"at least {needed}"
        assert ("smaller --scale" in error.value.remedy) == (needed > 3)
        assert ("method multi-light, which takes 3" in error.value.remedy) == (count >= 3)


def test_three_photographs_are_what_one_is_told_to_become():
    require_photographs(SimpleNamespace(photographs=[0] * 3, factor=2), "multi-light", 3)
    assert "at least 3 photographs" in AMBIGUOUS.remedy


def test_the_joint_method_needs_three_at_any_scale():
    for count, factor in itertools.product((1, 2, 3), (1, 4, 16)):
        prepared = SimpleNamespace(photographs=[0] * count, factor=factor, source="here")
        if count == 3:
            require_photographs(prepared, "multi-light", 3)
            continue
        with pytest.raises(MethodError, match="too few photographs") as error:
            require_photographs(prepared, "multi-light", 3)
        assert error.value.needed == "at least 3"
        assert "--scale" not in error.value.remedy
        assert error.value.remedy.endswith("or use the method fusion-like, which takes one")
