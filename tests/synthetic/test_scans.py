"""Laser scans as truth: they render to captures that `refine` improves, and survive the disk.

The scans lie beside the project and are not part of it; without them these tests are skipped.
"""

import pytest

from rakelight.capture import load_capture
from rakelight.capture.truth import load_truth
from rakelight.cli import main
from rakelight.metrics import evaluate_depth, evaluate_maps
from rakelight.pipeline import refine
from rakelight.synthetic import (
    DepthNoise,
    SceneOptions,
    make_albedo,
    render_scene,
    shape_from_file,
)
from tests.scans import for_every_scan


@pytest.mark.parametrize("file", for_every_scan())
def test_refine_improves_a_scan(file):
    shape = shape_from_file(file)
    options = SceneOptions(
        camera=shape.camera.scaled(0.5),
        photographs=6,
        depth_noise=DepthNoise(rms_mm=3.3, correlation_length_px=8.0),
    )
    capture, truth = render_scene(shape, make_albedo("pattern"), options)
    result = refine(capture, "multi-light-alternating")
    before = evaluate_depth(result.prepared_depth, capture.camera, truth)
    after = evaluate_maps(result.depth, result.normals, truth)
    assert after.depth.coverage == after.normals.coverage == 1
    assert after.normals.mae_deg < before.normals.mae_deg / 2
    assert after.depth.rmse_mm < 1.1 * before.depth.rmse_mm


@pytest.mark.parametrize("file", for_every_scan())
def test_a_scan_that_synth_wrote_is_read_back_bit_for_bit(file, tmp_path):
    folder = tmp_path / "scan"
    command = ["synth", str(folder), "--shape-file", str(file), "--size", "0.25", "--quiet"]
    with pytest.raises(SystemExit) as left:
        main([*command, "--lights", "3", "--depth-factor", "1", "--holes", "0.02"])
    assert left.value.code == 0
    shape = shape_from_file(file)
    options = SceneOptions(
        camera=shape.camera.scaled(0.25),
        photographs=3,
        depth_noise=DepthNoise(rms_mm=2.5, correlation_length_px=6.0, hole_fraction=0.02),
    )
    made, known = render_scene(shape, make_albedo("pattern"), options)
    capture, truth = load_capture(folder), load_truth(folder)
    for name in ("photographs", "depth_m", "mask"):
        assert identical(getattr(capture, name), getattr(made, name)), name
    assert capture.camera == made.camera
    for name in ("depth", "normals", "albedo"):
        assert identical(getattr(truth, name), getattr(known, name)), name
    assert identical(truth.lights.vector, known.lights.vector)
    assert identical(truth.lights.ambient, known.lights.ambient)


def identical(a, b):
    """Same type, shape and bits; NaN included."""
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
