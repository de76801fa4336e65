"""The paper's figures: what they show is what their titles say, and comes with its numbers."""

import csv
import io
from dataclasses import astuple, fields, replace

import numpy as np
import pytest

from rakelight.capture.images import decode_image
from rakelight.model import Camera, Lights, RigidTransform
from rakelight.paper.bas_relief import bas_relief_aligned
from rakelight.paper.drawing import turned
from rakelight.paper.figure1 import figure1
from rakelight.paper.figure2 import explanations, figure2
from rakelight.paper.figure3 import SENSOR, figure3
from rakelight.paper.figure4 import figure4
from rakelight.paper.figure5 import _lights, figure5
from rakelight.paper.figure6 import figure6
from rakelight.paper.figure7 import Count, counted, enough
from rakelight.paper.figure8 import figure8, jump_share
from rakelight.paper.rows import ROWS
from rakelight.paper.runs import MAIN, Runs, row_of
from rakelight.paper.scenarios import scenarios
from rakelight.paper.scenes import PAPER_OPTIONS, SCENARIOS, paper_camera
from rakelight.paper.sheet import Sheet
from rakelight.pictures.montage import BACKGROUND
from rakelight.synthetic import DepthNoise, make_albedo, make_shape, render_scene

CAMERA = Camera(60, 40, fx=400.0, fy=400.0, cx=29.5, cy=19.5)
MASK = np.zeros(CAMERA.shape, bool)
MASK[5:35, 10:50] = True


def test_figure_5_pairs_the_photographs_that_were_used_with_their_lamps(runs):
    capture, truth = runs.scene(MAIN, "moving-lamp")
    whole, names = runs.joint(), capture.names
    kept = [i for i in range(len(names)) if i != 2]
    left = replace(
        whole, lights=Lights(whole.lights.vector[kept], whole.lights.ambient[kept]),
        photograph_names=tuple(names[i] for i in kept),
    )  # fmt: skip
    rows = _lights("bust", capture, left, truth.lights)
    every = {row.photograph: row for row in _lights("bust", capture, whole, truth.lights)}
    assert rows == [every[i] for i in kept]


@pytest.fixture(scope="module")
def runs():
    """The scenes at 160 x 120, and a smaller one as somebody's own capture."""
    return Runs(size=0.25, capture=Runs(size=0.1).scene("simple", "moving-lamp")[0])


def check_files(sheet, *, own=False):
    """A sheet's files: a CSV that says what its rows say, a PNG per picture."""
    files = sheet.files()
    head, *lines = csv.reader(io.StringIO(files[f"{sheet.name}.csv"].decode()))
    assert head == [field.name for field in fields(sheet.rows[0])]
    shown = [["" if value is None else str(value) for value in astuple(r)] for r in sheet.rows]
    assert lines == shown
    for suffix, picture in sheet.pictures.items():
        read = decode_image(files[f"{sheet.name}{suffix}.png"])
        np.testing.assert_array_equal(read, picture)
        assert picture.std() > 5
    assert ("_capture" in sheet.pictures) == own


def test_figure1_refined_is_better_than_the_input(runs):
    sheet = figure1(runs)
    check_files(sheet, own=True)
    before, after = sheet.rows
    assert after.mae_deg < before.mae_deg / 2
    assert after.rmse_mm < before.rmse_mm
    surfaces = {sample.depth for sample in sheet.more["_profile"]}
    assert surfaces == {"truth", "input", "refined"}


def test_figure2_three_scenes_give_the_same_pixels():
    surface = make_shape("vase").render(make_shape("vase").camera.scaled(0.2))
    paint, shape, light = explanations(surface.normals[surface.mask])
    pixels = paint.photograph()
    assert np.ptp(pixels) > 20_000
    np.testing.assert_array_equal(shape.photograph(), pixels)
    np.testing.assert_array_equal(light.photograph(), pixels)


def test_figure2_each_scene_varies_one_thing(runs):
    sheet = figure2(runs)
    check_files(sheet)
    varies = [
        (r.albedo_range > 0.1, r.tilt_range_deg > 10, r.light_range > 0.1) for r in sheet.rows
    ]
    assert varies == [(True, False, False), (False, True, False), (False, False, True)]
    assert [row.largest_difference for row in sheet.rows] == [0, 0, 0]


def test_figure3_shows_the_holes_and_steps_that_the_sensor_makes(runs):
    sheet = figure3(runs)
    check_files(sheet, own=True)
    bust, own = sheet.rows
    assert bust.missing_percent == pytest.approx(100 * SENSOR.hole_fraction, abs=0.2)
    assert bust.step_mm == pytest.approx(SENSOR.step_mm, abs=0.01)
    assert (own.capture, own.missing_percent, own.rmse_mm) == ("capture", 0, None)


def test_figures_3_and_4_show_depth_of_a_camera_of_its_own_as_registered():
    pose = RigidTransform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    options = replace(PAPER_OPTIONS, camera=paper_camera(0.25), depth_to_color=pose)
    beside = Runs(size=0.25)
    noiseless = replace(options, depth_noise=DepthNoise(), photographs=1)
    beside.capture = render_scene(beside.bust, make_albedo("simple"), noiseless)[0]
    sensed, stage = figure3(beside).rows[1], figure4(beside).rows[3]
    assert stage.stage == "measured"
    # What the depth camera does not see of the object, not what lies beside its own picture.
    assert sensed.missing_percent < 10
    assert stage.missing_percent == pytest.approx(sensed.missing_percent, abs=0.1)


def test_figure4_fills_then_smooths(runs):
    sheet = figure4(runs)
    check_files(sheet, own=True)
    measured, inpainted, smoothed = sheet.rows[:3]
    assert measured.missing_percent > 2
    assert inpainted.missing_percent == smoothed.missing_percent == 0
    assert inpainted.roughness_mm > 1.2 * smoothed.roughness_mm
    assert measured.rmse_mm > inpainted.rmse_mm


def test_figure5_finds_every_lamp(runs):
    sheet = figure5(runs)
    check_files(sheet, own=True)
    bust = [row for row in sheet.rows if row.capture == "bust"]
    assert len(bust) == len(sheet.rows) / 2 == 12
    assert max(row.off_deg for row in bust) < 9
    assert all(0.05 < row.brightness < 0.9 for row in bust)


def test_figure6_has_every_surface_and_outvotes_highlights(monkeypatch):
    monkeypatch.setattr("rakelight.paper.figure6.OBJECTS", ("head",))
    sheet = figure6(Runs(size=0.15))
    check_files(sheet)
    assert len(sheet.rows) == 6
    angle = {(r.shape, r.photographs, r.surface): r.highlight_mae_deg for r in sheet.rows}
    published = row_of("multi-light-alternating").label
    assert angle["head", 4, published] < 0.95 * angle["head", 4, "input"]
    assert angle["head", 4, published] < 0.95 * angle["head", 4, "RGB-Fusion"]
    assert all(0 < row.highlight_percent < 40 for row in sheet.rows)


def test_figure7_errors_fall_with_the_photographs(runs):
    rows, times = counted(runs, (4, 10), ["multi-light-alternating"])
    four, ten = rows
    assert (four.photographs, ten.photographs) == (4, 10)
    assert ten.mae_deg < four.mae_deg
    assert all(time.seconds > 0 < time.core_seconds_per_iteration for time in times)


def test_enough_is_where_every_larger_count_is_close_to_the_best():
    rows = [Count("m", n, 1.0, mae, 1) for n, mae in ((4, 2.0), (8, 1.05), (12, 1.2), (20, 1.0))]
    assert [enough(rows, part) for part in (0.01, 0.1, 0.3, 2.0)] == [20, 20, 8, 4]


def test_figure8_only_the_depth_keeps_the_jumps(runs):
    sheet = figure8(runs)
    check_files(sheet)
    jumps = {row.method: row.jump_percent for row in sheet.rows}
    assert jumps["multi-light, joint"] > 80  # at full size 102
    assert jumps["LDR-PS"] < 60
    joint, _, alone, lambertian = sheet.rows
    assert lambertian.mae_deg < min(12, alone.mae_deg)
    assert alone.aligned_rmse_mm > 1.3 * joint.rmse_mm
    assert all(row.bas_relief_mae_deg < row.mae_deg + 0.5 for row in sheet.rows)
    assert all(row.aligned_rmse_mm <= row.rmse_mm for row in sheet.rows)


def test_jumps_that_are_closed_do_not_count():
    truth = np.where(np.arange(30) < 15, 0.7, 0.8) * np.ones((4, 1))
    mask = np.ones(truth.shape, bool)
    assert jump_share(truth, truth, mask) == pytest.approx(1)
    assert jump_share(0 * truth + 0.7, truth, mask) == 0
    assert jump_share((truth + truth[:, ::-1]) - truth, truth, mask) == pytest.approx(-1)


def test_scenarios_have_paint_and_depth_of_every_row(runs):
    rows = [row for row in ROWS if row.method in ("rgbd-fusion", "multi-light-alternating")]
    sheet = scenarios(runs, rows)
    check_files(sheet)
    assert list(sheet.pictures) == [f"_{scenario}" for scenario in SCENARIOS]
    detail = {(row.method, row.scenario): row.detail for row in sheet.rows}
    many, one = row_of("multi-light-alternating").label, row_of("rgbd-fusion").label
    assert detail[many, "complicated"] > max(0.9, detail[one, "complicated"])


def test_bas_relief_takes_away_bas_relief_and_nothing_else():
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(8, 9, 3)) * [0.4, 0.4, 0.1] - [0, 0, 1]
    truth /= np.linalg.norm(truth, axis=-1, keepdims=True)
    mask = np.ones(truth.shape[:2], bool)
    flat = truth @ np.array([[1, 0, 0], [0, 1, 0], [0.2, -0.1, 2.5]])
    flat /= np.linalg.norm(flat, axis=-1, keepdims=True)
    np.testing.assert_allclose(bas_relief_aligned(flat, truth, mask), truth, atol=1e-9)
    turned_round = truth[..., [1, 0, 2]]
    assert np.abs(bas_relief_aligned(turned_round, truth, mask) - truth).max() > 0.2


# ---- drawing


def test_a_plate_is_narrower_from_the_side():
    plate = np.where(MASK, 1.0, np.nan)
    widths = [(turned(plate, MASK, CAMERA, yaw) != BACKGROUND).any(axis=0).sum() for yaw in (0, 60)]
    assert widths[0] == pytest.approx(40, abs=1)
    assert widths[1] == pytest.approx(20, abs=1)


def test_what_is_near_is_drawn_over_what_is_far():
    """From its left a step shows the near half first: in front of it the far half is hidden."""
    column = np.arange(CAMERA.width)
    depth_m = np.where(MASK, np.where(column < 30, 0.9, 1.1), np.nan)
    front = turned(depth_m, MASK, CAMERA, 0.0)
    assert (front != BACKGROUND).sum() > 0.9 * MASK.sum()
    side = turned(depth_m, MASK, CAMERA, 90.0)
    assert side.shape[1] > 60  # the step of 0.2 m is 80 pixels deep


def test_a_sheet_names_its_files():
    rows = [Count("m", 4, 1.0, 2.0, 3)]
    sheet = Sheet("figure9", "t", rows, {"_x": np.zeros((2, 2), np.uint8)}, {"_seconds": rows})
    names = {"figure9.md", "figure9.json", "figure9.csv", "figure9_seconds.csv", "figure9_x.png"}
    assert set(sheet.files()) == names
    assert sheet.text.splitlines()[-1] == "| m | 4 | 1.00 | 2.00 | 3 |"
    assert replace(sheet, markdown="said").text == "said"
