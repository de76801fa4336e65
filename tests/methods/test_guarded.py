"""Captures that say nothing, or lie: the prepared depth stays, odd photographs are left out."""

import sys
from pathlib import Path

import numpy as np
import pytest

from rakelight import CaptureError, refine
from rakelight.geometry.normals import surface_normals
from rakelight.metrics import evaluate

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "check"))
import wrong_captures as wrong


def errors(result, truth):
    """(mean angle in degrees, depth RMSE in mm)."""
    found = evaluate(result.depth, result.normals, truth)
    return found.normals.mae_deg, found.depth.rmse_mm


def prepared_errors(result, truth):
    depth = result.prepared_depth.astype(float)
    normals = surface_normals(np.nan_to_num(depth, nan=1.0), np.isfinite(depth), result.camera)
    found = evaluate(result.prepared_depth, normals, truth)
    return found.normals.mae_deg, found.depth.rmse_mm


def warnings(result):
    return [finding.code for finding in result.findings if finding.severity == "warning"]


@pytest.mark.parametrize("shape", wrong.SOLIDS)
@pytest.mark.parametrize("change", [wrong.one_lamp, wrong.noise_alone])
@pytest.mark.parametrize("method", ["multi-light", "multi-light-alternating"])
def test_without_information_the_prepared_depth_stays(shape, change, method):
    capture, truth = wrong.sound(shape)
    result = refine(change(capture), method)
    assert "photographs-say-nothing" in warnings(result)
    np.testing.assert_array_equal(result.depth, result.prepared_depth)
    np.testing.assert_allclose(errors(result, truth), prepared_errors(result, truth), rtol=1e-6)
    assert result.confidence.max() == 0


@pytest.mark.parametrize("shape", wrong.SOLIDS)
def test_a_sound_capture_is_refined(shape):
    capture, truth = wrong.sound(shape)
    result = refine(capture)
    assert warnings(result) == []
    assert errors(result, truth)[0] < 0.3 * prepared_errors(result, truth)[0]


@pytest.mark.parametrize("kind", wrong.ODD)
@pytest.mark.parametrize("shape", wrong.SOLIDS)
def test_one_odd_photograph_is_named_and_left_out(shape, kind):
    capture, truth = wrong.sound(shape)
    without = refine(capture.select([0, 1, 2, 4, 5, 6, 7]))
    result = refine(wrong.with_photograph(capture, 3, wrong.ODD[kind]))
    (finding,) = (each for each in result.findings if each.code == "odd-photographs")
    assert finding.message.endswith(": 003.png")
    assert result.photograph_names == tuple(f"{i:03d}.png" for i in (0, 1, 2, 4, 5, 6, 7))
    assert len(result.lights) == len(result.prediction_errors) == 7
    np.testing.assert_array_equal(result.depth, without.depth)
    assert errors(result, truth) == errors(without, truth)


@pytest.mark.parametrize("shape", wrong.SOLIDS)
def test_turned_photographs_and_disparity_are_refused(shape):
    capture, _ = wrong.sound(shape)
    with pytest.raises(CaptureError, match="turned"):
        refine(wrong.with_turned_photographs(capture, lambda image: image[::-1, ::-1]))
    with pytest.raises(CaptureError, match="inside out"):
        refine(wrong.disparity(capture))


@pytest.mark.parametrize("shape", wrong.SOLIDS)
def test_confidence_falls_as_the_depth_worsens(shape):
    capture, _ = wrong.sound(shape)
    noisier, _ = wrong.sound(shape, noise=wrong.DepthNoise(rms_mm=50.0, correlation_length_px=5.0))
    before = refine(capture)
    level = before.confidence[before.mask].mean()
    for worse in (noisier, wrong.flat_depth(capture)):
        result = refine(worse)
        assert result.confidence[result.mask].mean() < 0.8 * level
