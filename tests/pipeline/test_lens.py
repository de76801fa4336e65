"""A capture through a lens that distorts, refined: as good as one through an ideal lens."""

from dataclasses import replace

import pytest
from scipy.ndimage import binary_erosion

from rakelight.errors import InputError
from rakelight.export import load_result, write_result
from rakelight.metrics import evaluate
from rakelight.model import Capture, Distortion
from rakelight.pipeline import refine
from rakelight.synthetic import (
    DepthNoise,
    SceneOptions,
    distorted,
    make_albedo,
    make_shape,
    render_scene,
)

# It moves the object by up to 5 pixels of 336 x 252.
LENS = Distortion("brown-conrady", [-1.2, 3.0, 0.004, -0.003, 0.0])
NONE = Distortion("brown-conrady", [0.0] * 5)
NOISE = DepthNoise(rms_mm=1.5, correlation_length_px=3.0)


@pytest.fixture(scope="module")
def scene():
    """A capture through the lens, the same without, and the truth of the ideal camera."""
    shape, albedo = make_shape("vase"), make_albedo("simple")
    camera = shape.camera.scaled(0.7)
    options = SceneOptions(
        photographs=6, camera=camera, depth_factor=2, image_noise=0.0, supersampling=1
    )
    _, truth = render_scene(shape, albedo, options)
    fine, _ = render_scene(shape, albedo, replace(options, camera=camera.scaled(2)))
    seen = [distorted(fine, lens, 2, image_noise=0.01, depth_noise=NOISE) for lens in (LENS, NONE)]
    return *seen, truth


@pytest.fixture(scope="module")
def results(scene):
    through, without, _ = scene
    ignored = replace(through, camera=replace(through.camera, distortion=None))
    return [refine(capture) for capture in (through, without, ignored)]


def test_normals_are_as_good_as_without(scene, results):
    *_, truth = scene
    inner = binary_erosion(truth.mask, iterations=2)
    assert all(result.mask[inner].all() for result in results[:2])
    through, without, ignored = (evaluate(result, truth, inner).normals for result in results)
    # 1.697 and 1.700 degrees, 1.30 and 1.39 in the median; 9.9 and 3.2 with it ignored.
    assert through.median_deg < 1.05 * without.median_deg
    assert through.mae_deg < 1.05 * without.mae_deg
    assert ignored.mae_deg > 3 * without.mae_deg
    # The outline is the ideal camera's, to half a pixel.
    outline = truth.mask & ~binary_erosion(truth.mask)
    assert (results[0].mask != truth.mask).sum() < 0.7 * outline.sum()


def test_the_result_is_that_of_the_ideal_camera(tmp_path, scene, results):
    through = scene[0]
    result = results[0]
    assert result.camera == replace(through.camera, distortion=None)
    assert result.capture["distortion"] == {"model": LENS.model, "k": list(LENS.coefficients)}
    assert result.capture["depth_checksum"] == through.depth_checksum
    assert "distortion" not in results[2].capture
    assert "depth_to_color" not in result.capture
    assert "undistorted" in [finding.code for finding in result.findings]
    # Distortion of zeros is none.
    assert "undistorted" not in [finding.code for finding in results[1].findings]
    write_result(result, tmp_path / "out")
    assert load_result(tmp_path / "out").camera == result.camera
    with pytest.raises(InputError, match=r"result\.camera: a camera with lens distortion"):
        write_result(replace(result, camera=through.camera), tmp_path / "other")


def test_the_object_is_cut_out_of_the_photographs_as_the_lens_shows_them(scene):
    through = scene[0]
    cut = Capture.from_arrays(
        through.photographs, through.depth_m, through.camera, encoding="linear"
    )
    assert (cut.mask & through.mask).sum() > 0.9 * (cut.mask | through.mask).sum()
