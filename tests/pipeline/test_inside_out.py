"""Depth that its outline makes suspicious, and what the photographs say of it."""

import sys

import numpy as np
import pytest

from rakelight import Camera, Capture, CaptureError, check_capture, refine
from rakelight.check.inside_out import inside_out
from rakelight.check.measured import Measured
from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import surface_normals
from rakelight.methods.multi_light import MultiLight
from rakelight.pipeline.inside_out import refuse_inverted
from tests.check.wrong_captures import SOLIDS, disparity, sound, with_background

SIDE, DISTANCE_M, RADIUS_PX = 64, 0.5, 26
MIDDLE = (SIDE - 1) / 2


def painted(relief_m, wall_m, lamp_m=0.3, photographs=6):
    """A disc in a wall, bulging by relief_m towards the camera, under a lamp around it.

    wall_m : how much nearer than its rim the wall is
    """
    rng = np.random.default_rng(1)
    camera = Camera(SIDE, SIDE, 300.0, 300.0, MIDDLE, MIDDLE)
    rows, columns = np.indices((SIDE, SIDE)) - MIDDLE
    r2 = (rows**2 + columns**2) / RADIUS_PX**2
    mask = r2 < 1
    surface_m = DISTANCE_M - relief_m * (1 - r2)
    everywhere = np.ones_like(mask)
    normals = np.nan_to_num(surface_normals(surface_m, everywhere, camera))
    points = back_project(surface_m, camera)
    paint = 0.3 + 0.4 * (np.sin(rows / 3) * np.sin(columns / 4) > 0)
    images = []
    for angle in np.arange(photographs) * 2 * np.pi / photographs:
        towards = np.array([0.6 * np.cos(angle), 0.6 * np.sin(angle), -0.8])
        ray = np.array([0, 0, DISTANCE_M]) + lamp_m * towards - points
        far = np.linalg.norm(ray, axis=-1)
        shading = np.maximum((ray * normals).sum(axis=-1), 0) / far * (lamp_m / far) ** 2
        images.append(0.6 * paint * (shading + 0.1) + rng.normal(0, 0.002, mask.shape))
    linear = np.repeat(np.clip(images, 0, 1)[..., None], 3, axis=-1)
    depth_m = np.where(mask, surface_m, DISTANCE_M - wall_m)
    depth_m = depth_m[None] + rng.normal(0, 0.0005, (3, SIDE, SIDE))
    return Capture.from_arrays(
        (65535 * linear).astype(np.uint16), depth_m.astype(np.float32), camera, mask=mask,
        encoding="linear",
    )  # fmt: skip


def asked(capture):
    """Ask the photographs of a suspicious capture; raises where it is refused."""
    measured = Measured(capture)
    (suspicion,) = inside_out(measured)
    assert suspicion.code == "depth-inside-out"
    refuse_inverted(measured, [suspicion])


def test_a_recess_with_a_side_wall_is_refined_with_a_warning():
    recess = painted(relief_m=-0.03, wall_m=0.01)
    result = refine(recess, MultiLight(max_iterations=3))
    assert "depth-inside-out" in {finding.code for finding in result.findings}


def test_an_inverted_solid_before_a_wall_is_refused():
    inverted = disparity(painted(relief_m=0.03, wall_m=-0.01))
    with pytest.raises(CaptureError, match="photographs fit it better inverted") as error:
        refine(inverted)
    assert "disparity" in error.value.remedy
    report = check_capture(inverted)
    assert report.verdict == "not usable"
    assert [each.code for each in report.findings].count("depth-inside-out") == 1


def test_where_photographs_are_too_few_to_be_asked_the_outline_decides():
    recess = painted(relief_m=-0.03, wall_m=0.01)
    for some in (recess.select([0]), recess.select([0, 2, 4])):
        with pytest.raises(CaptureError, match="what lies beyond is nearer"):
            asked(some)


@pytest.mark.parametrize("shape", SOLIDS)
def test_what_is_nearer_by_more_than_the_width_has_to_be_denied_clearly(shape, monkeypatch):
    inverted = disparity(with_background(sound(shape)[0], 0.3))
    module = sys.modules["rakelight.pipeline.inside_out"]
    monkeypatch.setattr(module, "log_ratios", lambda capture: np.full(8, 0.3))
    with pytest.raises(CaptureError, match="inside out"):
        asked(inverted)
    monkeypatch.setattr(module, "log_ratios", lambda capture: np.full(8, 0.5))
    asked(inverted)


def test_without_suspicion_no_photograph_is_asked(monkeypatch):
    module = sys.modules["rakelight.pipeline.inside_out"]
    monkeypatch.setattr(module, "log_ratios", None)
    capture = sound("vase")[0]
    refuse_inverted(Measured(capture), inside_out(Measured(capture)))
