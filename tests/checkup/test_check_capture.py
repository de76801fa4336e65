"""What is said first of captures that are good, and of those that are not."""

import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from rakelight import MultiLight, check_capture, load_capture, refine
from rakelight.check.depth_quality import depth_findings
from rakelight.check.measured import Measured
from rakelight.errors import CaptureError
from rakelight.geometry.grid import area_mean
from rakelight.model import RigidTransform
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene
from tests.capture.capture_builder import told_apart
from tests.check.moved_captures import still_scene, with_depth_moved, with_photographs_moved
from tests.check.wrong_captures import disparity, one_lamp, sound, with_background, with_photograph

CAPTURES = Path(__file__).resolve().parents[3] / "shared" / "captures"
BRIEFLY = MultiLight(lights="white", distance="distant", max_iterations=1, coarse_pixels=1000)
"""What `refine` says of the capture itself it says after the least of refining."""


@pytest.fixture(scope="module")
def head():
    return sound("head")[0]


@pytest.fixture(scope="module")
def head_report(head):
    return check_capture(head)


def first(capture):
    return check_capture(capture).findings[0].code


def white(photograph):
    return np.where(photograph > 6000, 65535, photograph).astype(np.uint16)


def dark(photograph):
    return (photograph // 40).astype(np.uint16)


def blurred(photograph):
    return cv2.GaussianBlur(photograph, (0, 0), 3)


def test_a_good_capture_is_good(head_report):
    report = head_report
    assert (report.verdict, report.headline, report.refusal) == ("good", "good", None)
    assert not [each.marks for each in report.photographs if each.marks]
    assert not [each for each in report.findings if each.severity == "warning"]


def test_the_lights_are_where_they_were_put(head_report):
    true = sound("head")[1].lights.direction[:, 0]
    found = np.array([each.light for each in head_report.photographs])
    off = np.degrees(np.arccos(np.clip((found * true).sum(axis=1), -1, 1)))
    assert np.median(off) < 8


@pytest.mark.parametrize(
    ("change", "code", "mark"),
    [
        (white, "overexposed", "over-exposed"),
        (dark, "underexposed", "under-exposed"),
        (blurred, "blurred", "blurred"),
    ],
)
def test_one_bad_photograph_is_named(head, change, code, mark):
    report = check_capture(with_photograph(head, 3, change))
    assert report.findings[0].code == code
    assert report.verdict == "usable"
    assert report.headline.startswith("usable, with ")
    marked = {each.name: each.marks for each in report.photographs if mark in each.marks}
    assert list(marked) == [head.names[3]]
    assert head.names[3] in report.findings[0].message


def test_a_photograph_of_another_scene_does_not_fit(head):
    other = with_photograph(head, 2, lambda photograph: 65535 - photograph)
    report = check_capture(other)
    assert report.findings[0].code == "odd-photographs"
    assert report.photographs[2].marks == ("does not fit the others",)


def test_a_camera_that_moved_is_told_first():
    report = check_capture(with_photographs_moved(still_scene(photographs=8), [2], 5, 0))
    assert report.findings[0].code == "camera-moved"
    assert report.photographs[2].marks[0] == "moved by 5.0 px"
    assert report.photographs[2].shift_px == pytest.approx((5, 0), abs=0.2)


def lit_from(azimuths_deg, tilt_deg=40.0):
    """A noisy capture of a vase under lights at those azimuths, clockwise from the top."""
    shape = make_shape("vase")
    options = SceneOptions(
        camera=shape.camera.scaled(0.3), photographs=len(azimuths_deg),
        depth_noise=DepthNoise(rms_mm=2.0, correlation_length_px=4.0),
    )  # fmt: skip
    turn, tilt = np.radians(azimuths_deg), np.radians(tilt_deg)
    toward = [np.sin(tilt) * np.sin(turn), -np.sin(tilt) * np.cos(turn),
              np.full(len(turn), -np.cos(tilt))]  # fmt: skip
    return shape, options, np.stack(toward, axis=-1)


def relit(azimuths_deg, tilts_deg):
    """The capture of a painted vase under lights at those azimuths and tilts."""
    shape, options, _ = lit_from(azimuths_deg)
    capture, truth = render_scene(shape, make_albedo("pattern"), options)
    turn, tilt = np.radians(azimuths_deg), np.radians(tilts_deg)
    toward = np.stack(
        [np.sin(tilt) * np.sin(turn), -np.sin(tilt) * np.cos(turn), -np.cos(tilt)], axis=-1
    )
    shading = np.maximum(np.nan_to_num(truth.normals) @ toward.T, 0) + 0.05
    light = 0.8 * np.moveaxis(shading, -1, 0)[..., None] * truth.albedo
    noisy = light + np.random.default_rng(0).normal(0, 0.003, light.shape)
    photographs = np.clip(65535 * noisy, 0, 65535).astype(np.uint16)
    return replace(capture, photographs=photographs)


def test_lights_from_one_side_are_told_with_the_other_side():
    capture = relit(np.linspace(20, 160, 9), np.tile([25, 40, 50], 3))
    report = check_capture(capture)
    assert report.findings[0].code == "lights-on-one-side"
    assert "from the right" in report.findings[0].message
    assert report.next_lights[0].direction[0] < 0
    assert "left" in report.findings[0].remedy


def test_low_lights_are_told():
    capture = relit(np.arange(0, 360, 30), np.full(12, 78))
    warned = [each for each in check_capture(capture).findings if each.severity == "warning"]
    assert warned[0].code == "lights-low"
    assert "15 to 60 degrees" in warned[0].remedy


def test_two_lights_are_too_few(head):
    report = check_capture(head.select([0, 4]))
    assert report.findings[0].code == "too-few-photographs"
    assert (report.verdict, report.refusal.exit_code) == ("not usable", 2)
    assert report.headline.startswith("not usable because too few photographs")


def test_lights_at_two_places_lie_in_a_plane():
    capture = relit(np.array([90, 90, 90, 270, 270, 270, 270, 90]), np.full(8, 40))
    assert first(capture) == "lights-in-one-plane"


def test_one_lamp_position_gains_nothing(head):
    report = check_capture(one_lamp(head))
    assert report.findings[0].code in ("one-lamp-position", "photographs-say-nothing")
    assert report.verdict == "not usable"
    assert report.refusal.exit_code == 2


def test_lights_in_nearly_one_place_that_gain_something_are_usable():
    cloth = make_shape("cloth")
    options = SceneOptions(
        camera=cloth.camera.scaled(0.2), tilt_deg=(2.0, 5.0), depth_noise=DepthNoise()
    )
    report = check_capture(render_scene(cloth, make_albedo("pattern"), options)[0])
    assert report.findings[0].code == "one-lamp-position"
    assert (report.verdict, report.refusal) == ("usable", None)


def test_few_lit_photographs_that_gain_something_are_usable():
    vase = make_shape("vase")
    options = SceneOptions(camera=vase.camera.scaled(0.3), depth_noise=DepthNoise())
    capture, truth = render_scene(vase, make_albedo("pattern"), options)
    photographs = capture.photographs[:4].copy()
    photographs[2:] = 0
    capture = told_apart(replace(capture, photographs=photographs, names=()))
    report = check_capture(capture)
    said = {each.code: each.message for each in report.findings}
    assert report.verdict == "usable"
    assert said["few-lights"] == "the lamp reaches the object in only 2 of 4 photographs"
    result = refine(capture)
    error, prepared = (
        np.abs(each - truth.depth)[truth.mask].mean()
        for each in (result.depth, result.prepared_depth)
    )
    assert error < 0.5 * prepared


def test_one_photograph_is_said_to_be_one(head):
    report = check_capture(replace(head.select([0]), lighting="ambient"))
    assert report.findings[0].code == "single-photograph"
    assert report.verdict == "usable"
    assert report.accuracy is None


def test_the_methods_warnings_are_said_and_its_notes_are_not(head, head_report):
    lit = still_scene("vase", lighting="rgb-leds").select([0])
    limit = np.quantile(lit.photographs[0][lit.mask], 0.9)
    bright = with_photograph(lit, 0, lambda light: np.where(light > limit, 65535, light))
    assert "highlights" in {each.code for each in check_capture(bright).findings}
    assert "depth-weight" in {each.code for each in refine(head, BRIEFLY).findings}
    assert "depth-weight" not in {each.code for each in head_report.findings}


def test_shifted_depth():
    assert first(with_depth_moved(still_scene(), 3, 0)) == "depth-shifted"


def test_shifted_depth_is_not_taken_for_turned():
    # A vase moved down looks nearly as it does upside down.
    shape = make_shape("vase")
    options = SceneOptions(
        camera=shape.camera.scaled(0.4), depth_factor=2, depth_noise=DepthNoise(rms_mm=1.0)
    )
    capture = render_scene(shape, make_albedo("pattern"), options)[0]
    report = check_capture(with_depth_moved(capture, 0, 5))
    warned = [each for each in report.findings if each.severity == "warning"]
    assert warned[0].code == "depth-shifted"
    assert "register = true" in warned[0].remedy
    assert "depth-turned" not in [each.code for each in warned]
    assert report.accuracy is None
    # `refine` corrects the pose, so the check looks at the capture with the right one.
    moved = replace(with_depth_moved(capture, 0, 5), register=True)
    report = check_capture(moved)
    assert report.verdict == "good"
    registered = next(each.message for each in report.findings if each.code == "registered")
    found_px = float(registered.removeprefix("depth camera moved by ").split()[0])
    assert found_px == pytest.approx(5, abs=0.2)
    assert report.accuracy is not None


def test_depth_of_another_place_is_not_usable():
    report = check_capture(with_depth_moved(still_scene(), 10, 0))
    assert report.findings[0].code == "depth-shifted"
    assert report.verdict == "not usable"


def test_depth_beside_the_object_is_told_what_put_it_there(head):
    h, w = head.depth_m.shape[1:]
    beside = RigidTransform(np.eye(3), np.array([0.9, 0.0, 0.0]))
    capture = replace(head, depth_camera=head.camera.resized(w, h), depth_to_color=beside)
    with pytest.raises(CaptureError, match=r"seen \d+ depth pixels.*depth_to_color: they put the"):
        depth_findings(Measured(capture))


def test_mirrored_depth(head):
    turned = replace(head, depth_m=np.ascontiguousarray(head.depth_m[:, :, ::-1]))
    report = check_capture(turned)
    assert report.findings[0].code == "depth-turned"
    assert report.verdict == "not usable"
    assert "mirrored left to right" in report.findings[0].remedy


def test_depth_inside_out():
    vase = sound("vase")[0]
    report = check_capture(disparity(with_background(vase, 0.3)))
    assert report.verdict == "not usable"
    assert report.findings[0].code == "depth-inside-out"
    assert "depth-inside-out" in [each.code for each in check_capture(disparity(vase)).findings]


def test_depth_with_holes(head):
    rows, columns = np.indices(head.depth_m.shape[1:])
    holes = (rows % 12 < 5) & (columns % 12 < 5)
    report = check_capture(replace(head, depth_m=np.where(holes, np.nan, head.depth_m)))
    assert report.findings[0].code == "depth-holes"
    assert report.depth.holes == pytest.approx(25 / 144, abs=0.02)


def test_places_of_holes_are_those_in_the_photographs(head):
    """Of depth of half the resolution, too; as `refine` names them."""
    coarse = area_mean(head.depth_m[0], 2)
    rows, columns = np.indices(coarse.shape)
    middle_row, middle_column = (int(np.median(each)) // 2 for each in np.nonzero(head.mask))
    left_out = (abs(rows - middle_row) < 20) & (abs(columns - middle_column) < 20)
    holed = replace(head, depth_m=np.where(left_out, np.nan, coarse)[None].astype(np.float32))
    (told,) = (f for f in check_capture(holed).findings if f.code == "holes-left-out")
    (again,) = (f for f in refine(holed, BRIEFLY).findings if f.code == "holes-left-out")
    places = [re.search(r"\((\d+) pixels at \((\d+), (\d+)\)", f.message) for f in (told, again)]
    ours, theirs = (np.array([int(n) for n in place.groups()]) for place in places)
    assert abs(ours[1:] - theirs[1:]).max() <= 2
    assert ours[0] == pytest.approx(theirs[0], rel=0.2)


def test_depth_of_one_value_is_told_and_not_the_lamp_blamed(head):
    """By check and by refine; of a placeholder whose photographs are sound."""
    flat = replace(head, depth_m=np.full_like(head.depth_m, 0.75))
    report = check_capture(flat)
    assert report.findings[0].code == "depth-one-value"
    assert report.accuracy is None
    blamed = {"one-lamp-position", "lights-in-one-plane", "lights-on-one-side"}
    assert not blamed & {finding.code for finding in report.findings}
    assert "depth-one-value" in [finding.code for finding in refine(flat, BRIEFLY).findings]


def scaled_depth(capture, factor):
    return replace(capture, depth_m=(capture.depth_m * factor).astype(np.float32))


def test_an_unlikely_unit_is_doubted_and_an_impossible_one_refused(head):
    middle_m = float(np.nanmedian(head.depth_m))
    assert first(scaled_depth(head, 0.08 / middle_m)) == "depth-unit"
    with pytest.raises(CaptureError, match="unit looks wrong"):
        check_capture(scaled_depth(head, 1000.0))


def test_the_json_has_its_keys(head_report):
    told = json.loads(json.dumps(head_report.as_dict()))
    assert list(told) == [
        "schema", "capture", "verdict", "headline", "method", "findings", "photographs", "depth",
        "accuracy", "next_lights", "timings_s",
    ]  # fmt: skip
    assert list(told["photographs"][0]) == [
        "name", "saturated", "black", "brightness", "edge_px", "shift_px", "light", "marks",
    ]  # fmt: skip
    assert list(told["next_lights"][0]) == [
        "direction", "tilt_deg", "azimuth_deg", "words", "gain",
    ]  # fmt: skip
    assert list(told["depth"]) == ["median_m", "width_m", "height_m", "holes", "noise_mm", "pixels"]
    assert told["accuracy"]["depth_mm"][0] < told["accuracy"]["depth_mm"][1]


def test_names_that_are_missing_or_twice_are_given(head):
    report = check_capture(replace(head, names=("a",) * len(head.photographs)))
    assert report.photographs[3].name == "photograph 3"


@pytest.mark.parametrize(("name", "verdict"), [("mitten", "good"), ("uw-cat", "usable")])
def test_real_captures(name, verdict):
    if not (CAPTURES / name).exists():
        pytest.skip("the real captures are not here")
    report = check_capture(load_capture(CAPTURES / name))
    assert report.verdict == verdict
    if name == "uw-cat":  # whose lights were all above the object
        assert report.findings[0].code == "lights-on-one-side"
