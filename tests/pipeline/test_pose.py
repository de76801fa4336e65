"""The depth camera's pose, corrected by what the photographs show."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rakelight.geometry.camera import back_project
from rakelight.methods.multi_light import MultiLight
from rakelight.metrics import evaluate_maps
from rakelight.model import RigidTransform
from rakelight.pipeline import refine
from rakelight.pipeline.pose import image_motion, registered, rotated
from rakelight.prepare.register import project
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

CAMERA = make_shape("head").camera.scaled(0.25)
HERE = RigidTransform(np.eye(3), np.zeros(3))
MIDDLE = np.array([0.0, 0.0, 0.76])
PIXEL_M = MIDDLE[2] / CAMERA.fx
NOISE = DepthNoise(rms_mm=1.5, correlation_length_px=2.0)
FINE = replace(NOISE, rms_mm=0.5)
BRIEFLY = MultiLight(max_iterations=3)
"""Three steps a round find a pose as six do."""


def off_by(px=(0.0, 0.0), roll_deg=0.0):
    """A depth camera whose picture of the object is shifted and turned by so much."""
    image_motion = [0, 0, np.radians(roll_deg), px[0] * PIXEL_M, px[1] * PIXEL_M, 0]
    return rotated(HERE, np.array(image_motion), MIDDLE)


def scene(pose=None, shape="head", noise=NOISE):
    """A capture, its true pose known, and the truth."""
    options = SceneOptions(camera=CAMERA, photographs=8, depth_noise=noise, depth_to_color=pose)
    return render_scene(make_shape(shape), make_albedo("pattern"), options)


def unaware(capture):
    """The capture when nobody knows of the shift."""
    return replace(capture, depth_to_color=HERE, register=True)


def left(found, true):
    """What is left of the shift (2,), depth pixels, and of the rotation (3,), degrees."""
    there = MIDDLE @ found.rotation.T + found.translation_m
    target = MIDDLE @ true.rotation.T + true.translation_m
    turn = Rotation.from_matrix(true.rotation @ found.rotation.T).as_rotvec()
    return ((there - target) / PIXEL_M)[:2], np.degrees(turn)


def codes(findings):
    return {finding.code: finding for finding in findings}


def errors(result, truth):
    scores = evaluate_maps(result.depth, result.normals, truth)
    return np.array([scores.normals.mae_deg, scores.depth.rmse_mm])


@pytest.fixture(scope="module")
def shifted():
    """(true pose, capture, truth, the registered result) for depth that is 4 pixels off, rolled."""
    pose = off_by((2.5, -3.0), 1.0)
    capture, truth = scene(pose)
    return pose, capture, truth, refine(unaware(capture), BRIEFLY)


@pytest.fixture(scope="module")
def right(shifted):
    """The result under the true pose."""
    return refine(shifted[1], BRIEFLY)


def test_four_pixels_and_a_degree_of_roll_are_found(shifted):
    pose, _, _, result = shifted
    found = result.capture["depth_to_color"]
    shift, turn = left(
        RigidTransform(np.array(found["rotation"]), np.array(found["translation"])), pose
    )
    assert np.linalg.norm(shift) < 0.2
    assert np.abs(turn).max() < 0.15
    assert "registration-doubtful" not in codes(result.findings)


def test_errors_are_those_of_the_right_pose(shifted, right):
    _, capture, truth, result = shifted
    wrong = refine(replace(unaware(capture), register=False), BRIEFLY)
    assert (errors(result, truth) < 1.1 * errors(right, truth)).all()
    assert (errors(wrong, truth) > np.array([1.3, 3.0]) * errors(right, truth)).all()


def test_the_result_says_so(shifted):
    *_, result = shifted
    note = codes(result.findings)["registered"]
    assert note.severity == "note"
    assert "left as given: pitch, yaw, forward" in note.message
    assert result.timings_s["register"] > 0


def test_depth_in_the_colour_cameras_view_gets_a_camera_of_its_own():
    pose = off_by((4, 0), -1.0)
    capture, _ = scene(pose, "cloth", FINE)
    bare = replace(capture, depth_camera=None, depth_to_color=None, register=True)
    found = registered(bare, BRIEFLY)
    assert found.depth_camera == CAMERA
    shift, turn = left(found.depth_to_color, pose)
    assert np.linalg.norm(shift) < 0.05
    assert np.abs(turn).max() < 0.05
    assert "registration-doubtful" not in codes(found.findings)


def test_depth_that_lies_right_stays_there(shifted, right):
    _, capture, truth, _ = shifted
    result = refine(replace(capture, register=True), BRIEFLY)
    assert (errors(result, truth) < 1.05 * errors(right, truth)).all()


def test_what_shows_no_shift_is_left_and_told():
    # A plane is the same wherever it is.
    capture, _ = scene(HERE, "cloth")
    z = np.full((1, *CAMERA.shape), 0.8, np.float32)
    flat = replace(capture, depth_m=z, photographs=np.full_like(capture.photographs, 30000))
    found = registered(replace(flat, register=True), BRIEFLY)
    assert codes(found.findings)["registration-doubtful"].severity == "warning"
    shift, turn = left(found.depth_to_color, HERE)
    assert np.abs(shift).max() < 0.05
    assert np.abs(turn).max() < 0.05


def test_other_methods_say_that_they_do_not(shifted):
    _, capture, *_ = shifted
    result = refine(unaware(capture).select([0]), "fusion-like")
    assert codes(result.findings)["not-registered"].severity == "warning"
    assert "depth_to_color" not in result.capture


def test_the_motion_of_points_is_that_of_the_pose():
    depth = 0.7 + 0.1 * np.random.default_rng(0).random(CAMERA.shape)
    points, middle, xi = back_project(depth, CAMERA), np.array([0.01, 0.02, 0.7]), np.zeros(6)
    before = project(points, HERE, CAMERA)
    u, v, ahead = image_motion(depth, CAMERA, middle)
    for k in range(6):
        xi[:] = 0
        xi[k] = 1e-6
        after = project(points, rotated(HERE, xi, middle), CAMERA)
        np.testing.assert_allclose(u[..., k], (after - before)[..., 0] / 1e-6, atol=0.05)
        np.testing.assert_allclose(v[..., k], (after - before)[..., 1] / 1e-6, atol=0.05)
        np.testing.assert_allclose(
            ahead[..., k], np.log(after[..., 2] / before[..., 2]) / 1e-6, atol=1e-4
        )


@cache
def coarse_sensed():
    """A capture whose depth has half the resolution."""
    sphere = make_shape("sphere")
    options = SceneOptions(
        camera=CAMERA, photographs=4, depth_noise=NOISE, depth_factor=2, supersampling=1
    )
    return render_scene(sphere, make_albedo("pattern"), options)[0]


def thin_capture(width):
    """A capture whose mask is a bar, `width` colour pixels wide, at half-resolution depth."""
    capture = coarse_sensed()
    rows, columns = (int(np.median(each)) for each in np.nonzero(capture.mask))
    bar = np.zeros_like(capture.mask)
    bar[rows - 10 : rows + 10, columns : columns + width] = True
    return replace(capture, mask=bar & capture.mask, register=True)


@pytest.mark.parametrize("width", [1, 3])
def test_a_thin_object_keeps_its_pose(width):
    # One pixel holds no block of the depth's, three hold one: neither has a normal there.
    capture = thin_capture(width)
    result = refine(capture, BRIEFLY)
    found = codes(result.findings)
    assert "nowhere two depth pixels wide" in found["registration-doubtful"].message
    assert "registered" not in found
    assert ("too-thin" in found) == (width == 1)
    assert np.isfinite(result.depth[result.mask]).all()
