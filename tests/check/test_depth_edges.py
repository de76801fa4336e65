"""The warnings of depth that is blurred across the object's outline, or into its holes."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rakelight import Capture, check_capture, refine
from rakelight.check.depth_edges import depth_edges
from rakelight.check.measured import Measured
from rakelight.methods.multi_light import MultiLight
from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene


@pytest.fixture(scope="module")
def before_a_wall() -> Capture:
    """A sphere that is lit from eight sides, a wall 0.3 m behind it."""
    sphere = make_shape("sphere")
    options = SceneOptions(camera=sphere.camera.scaled(0.5), photographs=8, depth_factor=2)
    capture, truth = render_scene(sphere, make_albedo("pattern"), options)
    wall = np.float32(np.nanmax(truth.depth) + 0.3)
    return replace(capture, depth_m=np.where(np.isfinite(capture.depth_m), capture.depth_m, wall))


def softened(capture, sigma_px):
    soft = cv2.GaussianBlur(capture.depth_m[0], (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)
    return replace(capture, depth_m=soft[None])


def test_blurred_depth_is_said_with_its_width(before_a_wall):
    (finding,) = depth_edges(Measured(softened(before_a_wall, 2.0)))
    assert (finding.code, finding.severity) == ("depth-blurred", "warning")
    assert any(f"over about {pixels} depth pixels" in finding.message for pixels in (5, 6))
    assert depth_edges(Measured(before_a_wall)) == ()


def test_nothing_is_said_of_a_depth_camera_with_another_view(before_a_wall):
    soft = softened(before_a_wall, 2.0)
    own = replace(soft, depth_camera=soft.camera.resized(*soft.depth_m.shape[:0:-1]))
    assert depth_edges(Measured(own)) == ()


def test_refine_and_check_say_it_and_refine_leaves_the_background_out(before_a_wall):
    soft = softened(before_a_wall, 2.0)
    assert "depth-blurred" in {finding.code for finding in check_capture(soft).findings}
    options = MultiLight(max_iterations=3)
    result, sharp = refine(soft, options), refine(before_a_wall, options)
    assert "depth-blurred" in {finding.code for finding in result.findings}
    off_mm = 1000 * np.abs(result.depth - sharp.depth)
    assert np.nanmedian(off_mm) < 5
    assert np.nanquantile(off_mm, 0.9) < 15


def test_depth_that_was_resized_with_its_holes_as_0_is_said_and_left_out(before_a_wall):
    depth = before_a_wall.depth_m[0].copy()
    rows, columns = depth.shape
    middle = np.s_[rows // 2 - 2 : rows // 2 + 2, columns // 2 - 2 : columns // 2 + 2]
    depth[middle] = 0
    ramps = cv2.resize(depth, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    capture = replace(before_a_wall, depth_m=np.where(ramps > 0, ramps, np.nan)[None])
    (finding,) = depth_edges(Measured(capture))
    assert (finding.code, finding.severity) == ("depth-mixed-with-holes", "warning")
    assert "INTER_NEAREST" in finding.remedy
    options = MultiLight(max_iterations=3)
    result, sharp = refine(capture, options), refine(before_a_wall, options)
    assert "depth-mixed-with-holes" in {finding.code for finding in result.findings}
    assert np.nanmax(1000 * np.abs(result.depth - sharp.depth)) < 15
