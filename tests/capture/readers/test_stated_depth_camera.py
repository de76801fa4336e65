"""Intrinsics and pose of the depth camera beside loose photographs: used, or told of."""

import json

import cv2
import numpy as np
import pytest

from rakelight import load_capture
from rakelight.capture.extrinsics import depth_to_color
from rakelight.capture.images import encode_png, encode_tiff
from rakelight.capture.intrinsics import parse_intrinsics
from rakelight.errors import CaptureError
from rakelight.model import Camera, Distortion
from tests.capture.readers.test_photographs import codes, fill

DEPTH = Camera(20, 14, 22.0, 22.5, 9.25, 6.75)
COLOR_FACTS = {"width": 32, "height": 24, "fx": 40, "fy": 40.5, "cx": 15.25, "cy": 11.75}
DEPTH_FACTS = {"width": 20, "height": 14, "fx": 22, "fy": 22.5, "cx": 9.25, "cy": 6.75}
TURN = cv2.Rodrigues(np.array([0.01, -0.02, 0.03]))[0]
SHIFT_M = np.array([0.015, -0.001, 0.0005])
POSE = np.vstack([np.column_stack([TURN, SHIFT_M]), [0, 0, 0, 1]])
ROWS = "\n".join(" ".join(map(repr, row)) for row in POSE.tolist())
MATRIX_C = "40 0 15.25 0 40.5 11.75 0 0 1"
MATRIX = "22 0 9.25 0 22.5 6.75 0 0 1"

SCANNET = """\
colorHeight = 24
colorToDepthExtrinsics = {}
colorWidth = 32
depthHeight = 14
depthWidth = 20
fx_color = 40
fx_depth = 22
fy_color = 40.5
fy_depth = 22.5
mx_color = 15.25
mx_depth = 9.25
my_color = 11.75
my_depth = 6.75
""".format(" ".join(map(repr, np.linalg.inv(POSE).ravel().tolist())))

ENUMERATED = """\
 Intrinsic of "Depth" / 40x28 / {{Z16}}
  Width:      \t40
  Height:     \t28
  PPX:        \t19
  PPY:        \t14
  Fx:         \t44
  Fy:         \t45
  Distortion: \tBrown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t0
  FOV (deg):  \t48.1 x 34.7

 Intrinsic of "Depth" / 20x14 / {{Z16}}
  Width:      \t20
  Height:     \t14
  PPX:        \t9.25
  PPY:        \t6.75
  Fx:         \t22
  Fy:         \t22.5
  Distortion: \tBrown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t0

 Intrinsic of "Color" / 32x24 / {{YUYV/RGB8/BGR8/RGBA8/BGRA8/Y16}}
  Width:      \t32
  Height:     \t24
  PPX:        \t15.25
  PPY:        \t11.75
  Fx:         \t40
  Fy:         \t40.5
  Distortion: \tInverse Brown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t0

Extrinsic from "Depth"\t  To\t  "Color" :
 Rotation Matrix:
{}

 Translation Vector: 0.015  -0.001  0.0005

Extrinsic from "Color"\t  To\t  "Depth" :
 Rotation Matrix:
   1   0   0
   0   1   0
   0   0   1

 Translation Vector: 9  9  9
""".format("\n".join("   ".join(map(repr, row)) for row in TURN.tolist()))


def folder(path, shape=(14, 20), **texts):
    fill(path, depth=False, texts=not any("intrinsics" in name for name in texts))
    (path / "depth.tiff").write_bytes(encode_tiff(np.full(shape, 0.6, np.float32)))
    for name, text in texts.items():
        text = text if isinstance(text, str) else json.dumps(text)
        stem, _, ending = name.rpartition("_")
        (path / f"{stem}.{ending}").write_text(text)
    return path


def assert_posed(capture):
    assert capture.depth_camera == DEPTH
    np.testing.assert_allclose(capture.depth_to_color.rotation, TURN, atol=1e-6)
    np.testing.assert_allclose(capture.depth_to_color.translation_m, SHIFT_M, atol=1e-7)
    assert "depth-camera" in codes(capture)
    assert "ignored-files" not in codes(capture)


TABLES = {
    "rows": {"rotation": TURN.tolist(), "translation": SHIFT_M.tolist()},
    "millimetres": {"R": TURN.tolist(), "T": (1000 * SHIFT_M).tolist()},
    "row_major": {"rotation_row_major": TURN.ravel().tolist(), "translation_m": SHIFT_M.tolist()},
    "column_major": {"rotation_column_major": TURN.T.ravel().tolist(), "t": SHIFT_M.tolist()},
    "matrix": POSE.tolist(),
    "columns": POSE.T.ravel().tolist(),
}


@pytest.mark.parametrize("pose", TABLES.values(), ids=TABLES)
def test_intrinsics_and_pose_in_one_file(tmp_path, pose):
    facts = {"color": COLOR_FACTS, "depth": DEPTH_FACTS, "extrinsics": {"depth_to_color": pose}}
    assert_posed(load_capture(folder(tmp_path, intrinsics_json=facts)))


@pytest.mark.parametrize(
    "texts",
    [
        {"depth_intrinsics_json": DEPTH_FACTS, "intrinsics_json": COLOR_FACTS,
         "depth_to_color_txt": ROWS},
        {"calib_ir_txt": MATRIX, "calib_color_json": COLOR_FACTS, "color2depth_txt":
         " ".join(map(repr, np.linalg.inv(POSE).ravel().tolist())), "intrinsics_json": COLOR_FACTS},
        {"intrinsics_txt": SCANNET},
        {"intrinsics_txt": ENUMERATED},
    ],
    ids=["files", "inverse", "ScanNet", "rs-enumerate-devices"],
)  # fmt: skip
def test_intrinsics_and_pose_in_several_ways(tmp_path, texts):
    assert_posed(load_capture(folder(tmp_path, **texts)))


@pytest.mark.parametrize(
    "pose",
    [
        {},
        {"extrinsics_json": {"rotation": TURN.tolist(), "translation": [0.015, 0, 0]}},
        {"depth_to_color_json": {"rotation": TURN.ravel().tolist(), "translation": [0, 0, 0]}},
        {"depth_to_color_json": {"rotation": (2 * TURN).tolist(), "translation": [0, 0, 0]}},
    ],
    ids=["none", "of what", "rows or columns", "no rotation"],
)  # fmt: skip
def test_without_a_clear_pose_a_warning_says_what_was_assumed(tmp_path, pose):
    made = folder(tmp_path, depth_intrinsics_json=DEPTH_FACTS, K_txt=MATRIX_C, **pose)
    capture = load_capture(made)
    assert capture.depth_camera == DEPTH
    np.testing.assert_array_equal(capture.depth_to_color.rotation, np.eye(3))
    (warning,) = [f for f in capture.findings if f.code == "depth-pose-assumed"]
    assert warning.severity == "warning"
    assert "depth_intrinsics.json" in warning.message
    for name in pose:
        assert name.replace("_json", ".json") in warning.message


def test_extrinsics_of_no_motion_are_a_pose(tmp_path):
    """ScanNet's folders have them, of both cameras."""
    same = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
    texts = {"extrinsic_depth_txt": same, "extrinsic_color_txt": same}
    made = folder(tmp_path, intrinsic_depth_txt=MATRIX, intrinsic_color_txt=MATRIX_C, **texts)
    (tmp_path / "intrinsics.txt").unlink()
    assert "depth-camera" in codes(load_capture(made))
    (tmp_path / "extrinsic_color.txt").write_text(ROWS)
    assert "depth-pose-assumed" in codes(load_capture(made))


@pytest.mark.parametrize(
    ("texts", "says"),
    [
        ({"depth_intrinsics_json": {**DEPTH_FACTS, "width": 40, "height": 28}}, "for 40x28"),
        (
            {"depth_intrinsics_json": {**DEPTH_FACTS, "cx": 90, "width": 16, "height": 12}},
            "principal point",
        ),
        ({"depth_intrinsics_json": "{"}, "not valid JSON"),
        ({"depth_calibration_txt": "to be done"}, "no intrinsics found"),
        ({"depth_to_color_txt": ROWS}, "no depth intrinsics"),
        ({"depth_camera_txt": MATRIX, "calib_ir_txt": "21" + MATRIX[2:]}, "several"),
    ],
    ids=["size", "nonsense", "damaged", "no numbers", "a pose alone", "several"],
)
def test_what_is_not_used_is_named(tmp_path, texts, says):
    capture = load_capture(folder(tmp_path, (12, 16), K_txt=MATRIX_C, **texts))
    assert capture.depth_camera is None
    (warning,) = [f for f in capture.findings if f.code == "ignored-files"]
    assert warning.severity == "warning"
    assert says in warning.message
    for name in texts:
        assert name.rpartition("_")[0] in warning.message


@pytest.mark.parametrize("names", [("cam0", "cam1"), ("rgb", "tof"), ("left", "right")])
@pytest.mark.parametrize("size", [(16, 12), (15, 12)])
def test_a_camera_of_the_depths_size_that_is_not_named_depth_is_told_of(tmp_path, names, size):
    facts = {**DEPTH_FACTS, "width": size[0], "height": size[1]}
    cameras = dict(zip(names, (COLOR_FACTS, facts), strict=True))
    folder(tmp_path, (12, 16), cameras_json=cameras)
    capture = load_capture(tmp_path)
    assert (capture.camera.fx, capture.depth_camera) == (40, None)
    said = [f.message for f in capture.findings if f.code == "ignored-files"]
    if size == (16, 12):
        assert said == [
            "depth camera not used, by cameras.json: a camera for 16x12, as the depth is, "
            "that is not named depth"
        ]
    else:
        assert not said


def test_depth_of_the_photographs_size_stays_registered(tmp_path):
    facts = {**DEPTH_FACTS, "width": 32, "height": 24, "cx": 16, "cy": 12}
    capture = load_capture(folder(tmp_path, (24, 32), K_txt=MATRIX_C, depth_camera_json=facts))
    assert capture.depth_camera is None
    assert "ignored-files" in codes(capture)
    (tmp_path / "depth_camera.json").write_text(json.dumps(COLOR_FACTS))
    assert "ignored-files" not in codes(load_capture(tmp_path))


def test_intrinsics_of_the_same_view_change_nothing(tmp_path):
    view = Camera(**COLOR_FACTS).resized(16, 12)
    facts = {key: getattr(view, key) for key in DEPTH_FACTS}
    capture = load_capture(folder(tmp_path, (12, 16), K_txt=MATRIX_C, depth_camera_json=facts))
    assert capture.depth_camera is None
    assert not {"ignored-files", "depth-pose-assumed", "depth-camera"} & set(codes(capture))


def test_several_sizes_without_the_photographs_are_refused(tmp_path):
    text = ENUMERATED.replace("Width:      \t32", "Width:      \t64").replace(
        '"Depth" / 40x28', '"Color" / 40x28'
    )
    with pytest.raises(CaptureError, match=r"several camera matrices.*2 of them"):
        load_capture(folder(tmp_path, intrinsics_txt=text))


def snapshot_metadata(kind, pixels, camera):
    """As the RealSense Viewer writes it."""
    return (
        f"Frame Info: \nType,{kind}\nFormat,{pixels}\nFrame Number,14661\n"
        f"Timestamp (ms),1681849042763.90\nResolution x,{camera.width}\n"
        f"Resolution y,{camera.height}\nBytes per pixel,2\n\nIntrinsic:,\nFx,{camera.fx}\n"
        f"Fy,{camera.fy}\nPPx,{camera.cx}\nPPy,{camera.cy}\nDistorsion,Brown Conrady\n"
    )


def snapshots(path, depth):
    """Four snapshots of the RealSense Viewer; returns the millimetres (h, w) of each."""
    made = fill(path, depth=False, texts=False)
    values = np.arange(550, 550 + depth.width * depth.height).reshape(depth.shape)
    for i in range(4):
        (path / f"img{9 + i}.png").rename(path / f"s{i}_Color.png")
        (path / f"s{i}_Color_metadata.csv").write_text(
            snapshot_metadata("Color", "RGB8", made.camera)
        )
        (path / f"s{i}_Depth.raw").write_bytes(values.astype("<u2").tobytes())
        picture = np.zeros((*depth.shape, 3), np.uint8)
        (path / f"s{i}_Depth.png").write_bytes(encode_png(picture))
        (path / f"s{i}_Depth_metadata.csv").write_text(snapshot_metadata("Depth", "Z16", depth))
    return values


@pytest.mark.parametrize("depth", [DEPTH, Camera(32, 24, 30.0, 30.5, 15.5, 11.5)])
def test_snapshots_of_the_realsense_viewer(tmp_path, depth):
    values = snapshots(tmp_path, depth)
    capture = load_capture(tmp_path)
    np.testing.assert_allclose(capture.depth_m, np.stack([values / 1000] * 4), rtol=1e-6)
    assert capture.names == ("s0_Color.png", "s1_Color.png", "s2_Color.png", "s3_Color.png")
    assert (capture.camera.fx, capture.camera.cx) == (40, 15.25)
    assert capture.depth_camera == depth
    assert "depth-pose-assumed" in codes(capture)
    (tmp_path / "depth_to_color.json").write_text(json.dumps(TABLES["rows"]))
    np.testing.assert_allclose(load_capture(tmp_path).depth_to_color.translation_m, SHIFT_M)


def test_snapshots_beside_what_rs_enumerate_devices_prints(tmp_path):
    """Its numbers have more digits than those of the snapshots."""
    snapshots(tmp_path, DEPTH)
    (tmp_path / "calibration.txt").write_text(ENUMERATED.replace("22.5\n", "22.500000298\n"))
    capture = load_capture(tmp_path)
    np.testing.assert_allclose(capture.depth_to_color.translation_m, SHIFT_M)
    assert not {"depth-pose-assumed"} & set(codes(capture))
    (tmp_path / "calibration.txt").write_text(ENUMERATED.replace("22.5\n", "22.6\n"))
    with pytest.raises(CaptureError, match=r"other proportions.*calibration\.txt: several depth"):
        load_capture(tmp_path)


def test_a_snapshot_that_is_left_out_is_named(tmp_path):
    snapshots(tmp_path, DEPTH)
    (tmp_path / "s3_Depth_metadata.csv").unlink()
    capture = load_capture(tmp_path)
    assert len(capture.depth_m) == 3
    messages = [f.message for f in capture.findings if f.code == "ignored-files"]
    assert any("s3_Depth.raw" in message for message in messages)


def test_snapshots_that_are_damaged_or_without_their_metadata(tmp_path):
    snapshots(tmp_path, DEPTH)
    (tmp_path / "s2_Depth.raw").write_bytes(bytes(100))
    with pytest.raises(CaptureError, match=r"s2_Depth\.raw: .*damaged.*100 bytes for 20x14"):
        load_capture(tmp_path)
    for each in tmp_path.glob("*_Depth_metadata.csv"):
        each.write_text("Format,Z16\nResolution x,wide\n")
    said = r"s0_Depth\.raw: depth of a size that is not known .*s0_Depth_metadata\.csv"
    with pytest.raises(CaptureError, match=said):
        load_capture(tmp_path)
    (tmp_path / "s0_Depth_metadata.csv").write_text("Format,Z16\nResolution x,0\nResolution y,9")
    with pytest.raises(CaptureError, match="a size of 0x9"):
        load_capture(tmp_path)


@pytest.mark.parametrize(("off_m", "clear"), [(-1e-6, True), (0.01, False)])
def test_two_files_of_one_pose(tmp_path, off_m, clear):
    poses = POSE.copy(), POSE.copy()
    poses[0][2, 3], poses[1][2, 3] = 0, off_m
    texts = {
        "depth_to_color_json": {"depth_to_color": poses[0].tolist()},
        "color2depth_txt": "\n".join(" ".join(map(str, row)) for row in np.linalg.inv(poses[1])),
    }
    made = folder(tmp_path, depth_intrinsics_json=DEPTH_FACTS, K_txt=MATRIX_C, **texts)
    assert ("depth-camera" in codes(load_capture(made))) == clear


UNITS = {"m": 1, "cm": 100, "mm": 1000, "Mm": 1000, "in_millimetres": 1000, " (cm)": 100}


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("name", ["translation_{}", "T_{}", "translation"])
def test_the_unit_that_a_translation_names(name, unit):
    """Millimetres of less than one, too, which would be metres where no unit is named."""
    shift = (UNITS[unit] * SHIFT_M).tolist()
    facts = {"rotation": TURN.tolist(), name.format(unit): shift}
    if name == "translation":
        facts["unit"] = unit.strip(" (in_)")
    assert_moved(facts, "depth_to_color", SHIFT_M)
    small = {**facts, name.format(unit): (UNITS[unit] * SHIFT_M / 50).tolist()}
    assert_moved(small, "depth_to_color", SHIFT_M / 50)
    matrix = POSE.copy()
    matrix[:3, 3] = shift
    assert_moved(matrix.tolist(), f"depth_to_color_{unit}", SHIFT_M)
    rows = "\n".join(" ".join(map(repr, row)) for row in matrix.tolist())
    (found,) = depth_to_color(rows.encode(), "a.txt", f"depth2color_{unit}")
    np.testing.assert_allclose(found.translation_m, SHIFT_M)
    assert_moved({"units": unit.strip(" (in_)"), "matrix": matrix.tolist()}, "depth2color", SHIFT_M)


def assert_moved(pose, name, shift_m):
    (found,) = depth_to_color(json.dumps({name: pose}).encode(), "a.json", "a")
    np.testing.assert_allclose(found.translation_m, shift_m)


@pytest.mark.parametrize("pose", [{"T": [1, 0, 0], "unit": "inches"}, {"T_m": [25.0, 0, 0]}])
def test_a_translation_whose_unit_is_not_clear(pose):
    text = json.dumps({"depth_to_color": {"R": TURN.tolist(), **pose}})
    assert depth_to_color(text.encode(), "a.json", "a") == [None]


def test_a_name_that_ends_in_a_matrix_states_no_unit():
    text = json.dumps({"depth_to_color_M": (POSE * [1, 1, 1, 1000]).tolist()})
    (found,) = depth_to_color(text.encode(), "a.json", "a")
    np.testing.assert_allclose(found.translation_m, SHIFT_M)


def test_the_lens_of_the_depth_camera_in_a_file_of_its_own(tmp_path):
    texts = {"K_txt": MATRIX_C, "depth_intrinsics_json": DEPTH_FACTS, "depth_to_color_txt": ROWS}
    made = folder(tmp_path, **texts, depth_distortion_txt="0.1 -0.2 0 0 0")
    capture = load_capture(made)
    assert capture.depth_camera.distortion == Distortion("brown-conrady", [0.1, -0.2, 0, 0, 0])
    assert capture.camera.distortion is None
    (tmp_path / "depth_dist.txt").write_text("0.1 0 0 0 0")
    with pytest.raises(CaptureError, match=r"depth_dist\.txt: several files with the distortion"):
        load_capture(tmp_path)


def test_a_lens_without_its_depth_camera_is_named(tmp_path):
    capture = load_capture(
        folder(tmp_path, (12, 16), K_txt=MATRIX_C, depth_distortion_txt="0.1 0 0 0 0")
    )
    (warning,) = [f for f in capture.findings if f.code == "ignored-files"]
    assert "depth_distortion.txt: no depth intrinsics beside it" in warning.message


def test_a_lens_that_is_named_without_its_coefficients(tmp_path):
    """The RealSense Viewer saves the model alone; rs-enumerate-devices prints its coefficients."""
    snapshots(tmp_path, DEPTH)
    capture = load_capture(tmp_path)
    assert capture.camera.distortion is None
    (warning,) = [f for f in capture.findings if f.code == "lens-missing"]
    assert warning.severity == "warning"
    assert "(Brown Conrady)" in warning.message
    assert "s0_Color_metadata.csv" in warning.message
    assert "Depth" not in warning.message
    assert "rs-enumerate-devices -c" in warning.remedy
    (tmp_path / "calibration.txt").write_text(ENUMERATED)
    assert "lens-missing" not in codes(load_capture(tmp_path))
    color, lens = "Inverse Brown Conrady\n  Coeffs:     \t", "-0.05 \t0.06 \t0.001 \t0 \t-0.02"
    zeros = "0  \t0  \t0  \t0  \t0"
    (tmp_path / "calibration.txt").write_text(ENUMERATED.replace(color + zeros, color + lens))
    capture = load_capture(tmp_path)
    assert capture.camera.distortion.model == "inverse-brown-conrady"
    assert "lens-missing" not in codes(capture)


def test_a_model_without_coefficients_and_a_lens_beside_it(tmp_path):
    facts = {**COLOR_FACTS, "distortion_model": "plumb_bob"}
    made = folder(tmp_path, (12, 16), intrinsics_json=facts)
    assert "lens-missing" in codes(load_capture(made))
    (tmp_path / "dist.txt").write_text("0 0 0 0 0")
    assert "lens-missing" not in codes(load_capture(made))
    (tmp_path / "dist.txt").unlink()
    for more in ({"D": []}, {"distortion_model": "none"}, {"distortion": [0] * 5}, {"k1": 0}):
        (tmp_path / "intrinsics.json").write_text(json.dumps({**facts, **more}))
        assert "lens-missing" not in codes(load_capture(made))


def test_the_model_in_lines_of_names_and_numbers():
    """A model that is named in words is that of the coefficients in the other lines."""
    text = "fx = 400\ncx = 160\ncy = 120\ndistortion_model = fisheye\nk1 = 0.1\n"
    assert parse_intrinsics(text.encode()).distortion.model == "kannala-brandt"


@pytest.mark.parametrize(
    ("said", "unit_m"),
    [
        ({"unit": "SI"}, 1.0),
        ({"unit": "rad"}, 1.0),
        ({"units": {"translation": "m", "rotation": "rad"}}, 1.0),
        ({"units": {"rotation": "deg"}}, 1.0),
        ({"units": {"translation": "mm"}}, 1e-3),
        ({"units": {"translation": "inch"}}, None),
        ({"unit": "\u00b5m"}, None),
    ],
)
def test_what_states_no_unit_of_length_changes_nothing(said, unit_m):
    facts = {"R": TURN.tolist(), "T": (SHIFT_M / (unit_m or 1)).tolist(), **said}
    (found,) = depth_to_color(json.dumps({"depth_to_color": facts}).encode(), "a.json", "a")
    assert (found is None) == (unit_m is None)
    if found is not None:
        np.testing.assert_allclose(found.translation_m, SHIFT_M)
