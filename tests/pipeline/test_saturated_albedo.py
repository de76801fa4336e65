"""Albedo where a channel is saturated in every photograph."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.methods.base import Estimate
from rakelight.model import SATURATED, Lights
from rakelight.pipeline import refine
from rakelight.pipeline.saturated_albedo import bounded_albedo
from rakelight.prepare import prepare
from rakelight.prepare.linear import usable
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene

GAIN = 3.0


def overexposed(distance_m=None, gain=GAIN, **changes):
    """A capture with the brightest paint saturated in all photographs, and its truth."""
    sphere = make_shape("sphere")
    settings = {"camera": sphere.camera.scaled(0.2), "photographs": 5, "image_noise": 0.0}
    options = SceneOptions(**settings, lamp_distance_m=distance_m, **changes)
    capture, truth = render_scene(sphere, make_albedo("pattern"), options)
    brighter = np.minimum(gain * capture.photographs.astype(float), capture.white)
    capture = replace(capture, photographs=brighter.astype(capture.photographs.dtype))
    lights = truth.lights
    brighter = replace(lights, vector=gain * lights.vector, ambient=gain * lights.ambient)
    return capture, replace(truth, lights=brighter)


def given_truth(capture, truth, lights):
    """Albedo before and after, and the findings, from the true surface and these lights."""
    prepared = prepare(capture)
    window = prepared.rows, prepared.columns
    known = usable(prepared.photographs).any(axis=0)
    albedo = np.where(known, truth.albedo[window], 0.0) * prepared.mask[..., None]
    still = np.zeros(prepared.mask.shape)
    estimate = Estimate(still, albedo, still, lights)
    depth = np.nan_to_num(truth.depth[window], nan=1.0)
    normals = np.nan_to_num(truth.normals[window])
    return prepared, albedo, *bounded_albedo(prepared, depth, normals, estimate)


@pytest.mark.parametrize("distance_m", [None, 0.6], ids=["distant", "near"])
def test_the_bound_is_below_the_truth_and_not_far(distance_m):
    capture, truth = overexposed(distance_m)
    prepared, before, after, _ = given_truth(capture, truth, truth.lights)
    right = truth.albedo[prepared.rows, prepared.columns]
    filled = after != before
    assert filled.sum() > 100
    assert (after[filled] <= 1.01 * right[filled]).all()
    assert np.median(after[filled] / right[filled]) > 0.5
    assert not before[filled].any()


def test_an_albedo_below_0_is_no_part_of_the_bound():
    """A method of one's own may give one."""
    capture, truth = overexposed()
    prepared, before, after, _ = given_truth(capture, truth, truth.lights)
    window = prepared.rows, prepared.columns
    below = np.where(after != before, -0.5, before)
    estimate = Estimate(np.zeros(prepared.mask.shape), below, 0 * below[..., 0], truth.lights)
    depth, normals = truth.depth[window], truth.normals[window]
    again, _ = bounded_albedo(
        prepared, np.nan_to_num(depth, nan=1.0), np.nan_to_num(normals), estimate
    )
    np.testing.assert_array_equal(again, after)


def test_the_darkest_photograph_is_just_saturated():
    capture, truth = overexposed()
    prepared, before, after, _ = given_truth(capture, truth, truth.lights)
    normals = truth.normals[prepared.rows, prepared.columns]
    cosine = np.einsum("hwk,nk->nhw", normals, truth.lights.vector[:, 0])
    shading = np.maximum(cosine, 0) + truth.lights.ambient[:, 0, None, None]
    row, column, channel = np.argwhere(after != before)[0]
    darkest = shading[:, row, column].min()
    assert after[row, column, channel] * darkest == pytest.approx(SATURATED, abs=1e-3)


def test_the_note_says_how_much():
    capture, truth = overexposed()
    prepared, before, after, notes = given_truth(capture, truth, truth.lights)
    share = (after != before).any(axis=-1).sum() / prepared.mask.sum()
    assert [note.code for note in notes] == ["albedo-bound"]
    assert notes[0].message.startswith(f"{share:.1%} of the object")


def test_without_light_there_is_no_bound():
    capture, truth = overexposed()
    count = len(capture.photographs)
    dark = Lights(np.zeros((count, 1, 3)), np.zeros((count, 1)))
    _, before, after, notes = given_truth(capture, truth, dark)
    assert (after == before).all()
    assert notes == ()


def test_values_in_shadow_are_a_bound():
    # Whoever left all of a pixel's values out for a shadow left no albedo.
    capture, truth = overexposed(gain=1.0)
    prepared, known, *_ = given_truth(capture, truth, truth.lights)
    window = prepared.rows, prepared.columns
    gone = np.zeros_like(prepared.mask)
    gone.flat[np.flatnonzero(usable(prepared.photographs).all(axis=(0, 3)))[::5]] = True
    gone &= prepared.mask
    assert gone.sum() > 50
    albedo = np.where(gone[..., None], 0.0, known)
    lost = Estimate(np.zeros(gone.shape), albedo, np.zeros(gone.shape), truth.lights)
    depth, normals = np.nan_to_num(truth.depth[window]), np.nan_to_num(truth.normals[window])
    half = replace(prepared, photographs=prepared.photographs // 2)
    for shown, expected in ((prepared, 1.0), (half, 0.5)):
        found, (note,) = bounded_albedo(shown, depth, normals, lost)
        share = found[gone] / truth.albedo[window][gone]
        assert np.median(share) == pytest.approx(expected, rel=0.02)
        assert note.code == "albedo-bound"


def test_refine_leaves_no_hole_in_the_paint():
    capture, truth = overexposed()
    result = refine(capture, "multi-light")
    assert "albedo-bound" in {finding.code for finding in result.findings}
    lost = truth.mask[..., None] & (capture.photographs == capture.white).all(axis=0)
    assert lost.sum() > 100
    assert result.albedo[lost].min() > np.median(result.albedo[truth.mask]) / 2
