"""Folders of loose photographs and depth: what is found in them, and what is refused."""

import io
import json
import os
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from rakelight import MultiLight, evaluate, load_capture, refine
from rakelight.capture.exif import ROUGHNESS, Exif, camera_of, exif_of, roughness_of
from rakelight.capture.images import decode_image, encode_jpeg, encode_png, encode_tiff
from rakelight.capture.intrinsics import parse_intrinsics
from rakelight.capture.readers import find_reader
from rakelight.errors import CaptureError, InputError
from rakelight.model import Distortion
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene
from tests.capture.capture_builder import build, exif, small_capture
from tests.capture.photo_files import dng, exr, heic, heic_of, mosaic_of, pfm

K = b"40 0 15.25\n0 40.5 11.75\n0 0 1\n"


def fill(folder, depth=True, texts=True, dtype=np.uint8):
    """Photographs img1.png ... img4.png of `small_capture`, depth.tiff and intrinsics.txt."""
    capture = small_capture(dtype=dtype)
    folder.mkdir(parents=True, exist_ok=True)
    for i, photograph in enumerate(capture.photographs):
        (folder / f"img{9 + i}.png").write_bytes(encode_png(photograph))
    if depth:
        (folder / "depth.tiff").write_bytes(encode_tiff(capture.depth_m[0]))
    if texts:
        (folder / "intrinsics.txt").write_bytes(K)
    return capture


def codes(capture):
    return [finding.code for finding in capture.findings]


def refusal(folder, *words):
    with pytest.raises(InputError) as caught:
        load_capture(folder)
    line = str(caught.value)
    assert line.startswith(str(folder))
    for word in words:
        assert word in line
    return line


@pytest.mark.parametrize("name", ["mask.png", "mask/000.png", "masks/img9.png"])
def test_photographs_depth_and_a_matrix(tmp_path, name):
    made = fill(tmp_path)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(encode_png(made.mask.astype(np.uint8)))
    assert find_reader(tmp_path).name == "photographs"
    capture = load_capture(tmp_path)
    assert capture.names == ("img9.png", "img10.png", "img11.png", "img12.png")
    assert np.array_equal(capture.photographs, made.photographs)
    assert np.array_equal(capture.depth_m, made.depth_m[:1], equal_nan=True)
    assert np.array_equal(capture.mask, made.mask)
    assert (capture.camera, capture.encoding) == (made.camera, "srgb")
    assert capture.source == str(tmp_path)
    assert load_capture(tmp_path, photographs=[2]).names == ("img11.png",)
    with pytest.raises(InputError, match="no such photographs"):
        load_capture(tmp_path, photographs=[4])


@pytest.mark.parametrize(
    "photographs", [5, [True, False], [0.0, 1.0], "012", [None], np.array([True, False]), [np.nan]]
)
def test_what_is_no_number_of_a_photograph_is_refused(tmp_path, photographs):
    fill(tmp_path)
    with pytest.raises(InputError, match="photographs: these are no numbers of photographs"):
        load_capture(tmp_path, photographs=photographs)
    for numbers in (np.array([2, 0]), (np.int64(2), 0), iter([2, 0])):
        assert load_capture(tmp_path, photographs=numbers).names == ("img11.png", "img9.png")


@pytest.mark.parametrize("memory", ["4GB", 0, -1.0, np.nan, True])
def test_what_is_no_limit_of_memory_is_refused(tmp_path, memory):
    fill(tmp_path)
    with pytest.raises(InputError, match=r"memory: not a limit of memory .*needed bytes, above 0"):
        load_capture(tmp_path, memory=memory)


def as_16_bit(depth_m):
    return np.nan_to_num(1000 * depth_m).astype(np.uint16)


def as_npy(depth_m):
    file = io.BytesIO()
    np.save(file, depth_m)
    return file.getvalue()


@pytest.mark.parametrize("name", ["Z0.npy", "a.pfm", "z.exr", "d.tif", "depth/a.png"])
def test_depth_of_any_format_without_a_name(tmp_path, name):
    depth_m = fill(tmp_path, depth=False).depth_m[0]
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    if name.endswith("exr"):
        exr(path, Z=depth_m)
    else:
        encode = {"npy": as_npy, "pfm": pfm, "tif": encode_tiff}.get(name[-3:])
        path.write_bytes(encode(depth_m) if encode else encode_png(as_16_bit(depth_m)))
    capture = load_capture(tmp_path)
    assert len(capture.photographs) == 4
    assert np.nanmax(np.abs(capture.depth_m[0] - depth_m)) < 0.0011
    assert np.array_equal(np.isnan(capture.depth_m[0]), np.isnan(depth_m))
    assert ("depth-unit-assumed" in codes(capture)) == name.endswith("png")


def test_the_unit_of_integers(tmp_path):
    depth_m = fill(tmp_path, depth=False).depth_m[0]
    (tmp_path / "depth.png").write_bytes(encode_png((as_16_bit(depth_m) // 20).astype(np.uint16)))
    refusal(tmp_path, "the unit of the depth is not known", "depth_scale.txt")
    (tmp_path / "depth_scale.txt").write_text("50\n")
    assert np.nanmedian(load_capture(tmp_path).depth_m) == pytest.approx(0.58, abs=0.001)
    for text in (b"\xef\xbb\xbf50\r\n", b"5e1", b"5.E+01", "50\r\n".encode("utf-16")):
        (tmp_path / "depth_scale.txt").write_bytes(text)
        assert np.nanmedian(load_capture(tmp_path).depth_m) == pytest.approx(0.58, abs=0.001)
    (tmp_path / "depth_scale.txt").write_text("-1")
    refusal(tmp_path, "no depth scale")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("camera.json", '{"fx": 40, "fy": 40.5, "cx": 15.25, "cy": 11.75, "depth_scale": 0.2}'),
        ("scene_camera.json", '{"0": {"cam_K": [40, 0, 15.25, 0, 40.5, 11.75, 0, 0, 1], '
         '"depth_scale": 0.2}}'),
        ("orb.yaml", "Camera.fx: 40\nCamera.fy: 40.5\nCamera.cx: 15.25\nCamera.cy: 11.75\n"
         "DepthMapFactor: 5000.0\n"),
        ("transforms.json", '{"fl_x": 40, "fl_y": 40.5, "cx": 15.75, "cy": 12.25, '
         '"integer_depth_scale": 0.0002}'),
        ("a.json", '{"ppx": 15.25, "ppy": 11.75, "fx": 40, "fy": 40.5, "depth_units": 0.0002}'),
        ("camera.yaml", "fx: 40\nfy: 40.5\ncx: 15.25\ncy: 11.75\n"
         "depth_unit_scale_factor: 0.00019999999494757503\n"),
    ],
)  # fmt: skip
def test_the_unit_that_a_file_of_another_program_states(tmp_path, name, text):
    made = fill(tmp_path, depth=False, texts=False)
    values = np.nan_to_num(5000 * made.depth_m[0]).astype(np.uint16)
    (tmp_path / "depth.png").write_bytes(encode_png(values))
    (tmp_path / name).write_text(text)
    capture = load_capture(tmp_path)
    assert capture.camera == made.camera
    assert np.nanmax(np.abs(capture.depth_m - made.depth_m[0])) < 0.0003
    assert "depth-unit-assumed" not in codes(capture)
    (tmp_path / "more.yaml").write_text("depth_scale: 1000")
    refusal(tmp_path, "depth.png: several scales of the depth", "depth_scale.txt")
    (tmp_path / "depth_scale.txt").write_text("5000")
    assert np.array_equal(load_capture(tmp_path).depth_m, capture.depth_m, equal_nan=True)


@pytest.mark.parametrize("name", ["depth.npy", "depth.tiff", "depth.pfm"])
def test_floating_point_that_is_no_metres_is_told_of_its_scale(tmp_path, name):
    made = fill(tmp_path, depth=False)
    (tmp_path / "mask.png").write_bytes(encode_png(made.mask.astype(np.uint8)))
    encode = {"npy": as_npy, "pfm": pfm}.get(name[-3:], encode_tiff)
    (tmp_path / name).write_bytes(encode(1000 * made.depth_m[0]))
    refusal(tmp_path, f"{name}: the unit of the depth is not known", "depth_scale = 1000 would")
    (tmp_path / "depth_scale.txt").write_text("1000")
    np.testing.assert_allclose(load_capture(tmp_path).depth_m, made.depth_m[:1], rtol=1e-6)
    # A background at any distance says nothing of the unit.
    (tmp_path / "depth_scale.txt").unlink()
    depth_m = np.where(made.mask[::2, ::2], made.depth_m[0], np.float32(500))
    depth_m[0] = 900
    (tmp_path / name).write_bytes(encode(depth_m))
    assert np.nanmedian(load_capture(tmp_path).depth_m[0][made.mask[::2, ::2]]) < 1


@pytest.mark.parametrize("far", [1e10, 65504.0])
def test_what_is_too_far_for_a_renderer_is_no_measurement(tmp_path, far):
    """Blender writes 1e10 where there is nothing, which is 65504 in half floats."""
    depth_m = fill(tmp_path, depth=False).depth_m[0]
    depth_m[:3] = np.nan
    exr(tmp_path / "z.exr", Z=np.nan_to_num(depth_m, nan=far))
    assert np.array_equal(load_capture(tmp_path).depth_m[0], depth_m, equal_nan=True)


def test_a_stated_unit_that_makes_no_distance_is_refused(tmp_path):
    made = fill(tmp_path, depth=False)
    (tmp_path / "depth.png").write_bytes(encode_png(as_16_bit(made.depth_m[0])))
    (tmp_path / "a.json").write_text('{"depth_scale": 20}')
    refusal(tmp_path, "no possible scale of the depth (seen 20", "depth_scale.txt")


def test_poses_of_a_camera_are_no_intrinsics(tmp_path):
    """ScanNet's and 7-Scenes' folders have one beside every photograph."""
    made = fill(tmp_path)
    turned = cv2.Rodrigues(np.array([0.1, 0.2, 0.3]))[0]
    for i, rotation in enumerate((np.eye(3), turned)):
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = 1, 2, 3
        np.savetxt(tmp_path / f"frame-{i:06d}.pose.txt", pose)
    assert load_capture(tmp_path).camera == made.camera


def test_what_is_not_clear_is_refused(tmp_path):
    depth_m = fill(tmp_path, depth=False, dtype=np.uint16).depth_m[0]
    refusal(tmp_path, "no depth map in it", "depth.png")
    (tmp_path / "d.tif").write_bytes(encode_tiff(depth_m))
    assert len(load_capture(tmp_path).photographs) == 4
    for i in range(4):
        grey = small_capture(dtype=np.uint16).photographs[i, ..., 0]
        (tmp_path / f"img{9 + i}.png").write_bytes(encode_png(grey))
    refusal(tmp_path, "not clear which of these is depth", "depth.png")
    (tmp_path / "d.tif").rename(tmp_path / "depth.tif")
    assert len(load_capture(tmp_path).photographs) == 4
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "a.png").write_bytes(encode_png(grey))
    refusal(tmp_path, "photographs in several folders")


def test_other_refusals(tmp_path):
    made = fill(tmp_path)
    for name in ("mask_000.png", "mask_001.png"):
        (tmp_path / name).write_bytes(encode_png(made.photographs[0]))
    refusal(tmp_path, "more than one mask", "give photographs a name without mask")
    for name in ("mask_000.png", "mask_001.png"):
        (tmp_path / name).unlink()
    (tmp_path / "img1.jpg").write_bytes(encode_jpeg(made.photographs[0]))
    refusal(tmp_path, "photographs of several formats")
    (tmp_path / "img1.jpg").unlink()
    (tmp_path / "img1.png").write_bytes(encode_png(made.photographs[0][:12]))
    table = "img1.png 32x12x3 uint8; img9.png 32x24x3 uint8 and 3 more"
    refusal(tmp_path, "images of different kinds", table)
    (tmp_path / "img1.png").unlink()
    (tmp_path / "k.txt").write_bytes(K.replace(b"40.5", b"41"))
    refusal(tmp_path, "several files with intrinsics", "k.txt")
    (tmp_path / "k.txt").unlink()
    (tmp_path / "intrinsics.txt").unlink()
    refusal(tmp_path, "no intrinsics", "intrinsics.txt")


@pytest.mark.parametrize("folders", [["mask"], ["mask_visib"], ["mask", "mask_visib"], ["masks"]])
def test_of_the_masks_of_several_objects_the_one_in_the_folder_itself_is_taken(tmp_path, folders):
    """As BOP has them, in folders beside the photographs."""
    made, of_another = fill(tmp_path), encode_png(np.full((24, 32), 255, np.uint8))
    for name in folders:
        (tmp_path / name).mkdir()
        for number in range(2):
            (tmp_path / name / f"00000{number}_000000.png").write_bytes(of_another)
    refusal(tmp_path, "more than one mask", f"{folders[0]}/000000_000000.png", "as mask.png in")
    mask = made.mask & (np.arange(32) < 16)
    (tmp_path / "mask.png").write_bytes(encode_png(mask.astype(np.uint8)))
    capture = load_capture(tmp_path)
    assert np.array_equal(capture.mask, mask)
    assert len(capture.photographs) == 4
    said = next(f.message for f in capture.findings if f.code == "ignored-files")
    assert f"{folders[0]}/000000_000000.png" in said


def test_a_capture_folder_without_its_table_is_still_one(tmp_path):
    for name in ("rgb", "depth"):
        fill(tmp_path / name, depth=False, texts=False)
    refusal(tmp_path, "no capture.toml")


def test_depth_of_8_bit_is_refused_in_any_format(tmp_path):
    fill(tmp_path, depth=False)
    np.save(tmp_path / "depth.npy", np.full((12, 16), 60, np.uint8))
    refusal(tmp_path, "depth.npy: 256 levels cannot carry millimetres")


def test_a_stated_unit_that_cannot_be(tmp_path):
    depth_m = fill(tmp_path, depth=False).depth_m[0]
    (tmp_path / "depth.png").write_bytes(encode_png(as_16_bit(depth_m)))
    (tmp_path / "depth_scale.txt").write_text("0.001")
    refusal(tmp_path, "not the unit of the depth", "at 0.001 values per metre", "= 1000 would")


def test_depth_in_a_format_that_is_not_read_is_named(tmp_path):
    fill(tmp_path, depth=False)
    (tmp_path / "depth.pgm").write_bytes(b"P5 32 24 65535\n" + bytes(2 * 32 * 24))
    refusal(tmp_path, "no depth map in it (seen depth.pgm, img9.png")


@pytest.mark.parametrize("name", ["depth.npz", "depth.raw", "depth.csv", "scan/depth.bin"])
def test_a_file_of_depth_that_is_not_read_is_named(tmp_path, name):
    fill(tmp_path, depth=False)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(b"PK\3\4")
    refusal(tmp_path, f"no depth map in it (seen {name}, img9.png")


CONFIDENCES = ["confidence.png", "conf_00000.png", "depth/conf.npy", "conf/0.exr", "conf/9.png"]


def write_map(path, values):
    path.parent.mkdir(exist_ok=True)
    if path.suffix == ".exr":
        exr(path, R=values.astype(np.float32))
    else:
        path.write_bytes(as_npy(values) if path.suffix == ".npy" else encode_png(values))


@pytest.mark.parametrize("name", CONFIDENCES)
def test_confidence_is_neither_a_photograph_nor_depth(tmp_path, name):
    made = fill(tmp_path)
    write_map(tmp_path / name, np.full(made.depth_m.shape[1:], 2, np.uint8))
    capture = load_capture(tmp_path)
    assert len(capture.photographs) == len(made.photographs)
    np.testing.assert_array_equal(capture.depth_m, made.depth_m[:1])
    code = "ignored-files" if name.endswith("exr") else "confidence-applied"
    (told,) = [f for f in capture.findings if f.code == code]
    assert told.severity == ("warning" if name.endswith("exr") else "note")
    assert name in told.message


@pytest.mark.parametrize("name", [name for name in CONFIDENCES if not name.endswith("exr")])
def test_depth_is_left_out_where_its_confidence_is_0(tmp_path, name):
    made = fill(tmp_path)
    sure = np.full(made.depth_m.shape[1:], 54, np.uint8)
    sure[:3, :4] = 0
    write_map(tmp_path / name, sure)
    capture = load_capture(tmp_path)
    expected = np.where(sure > 0, made.depth_m[:1], np.nan)
    np.testing.assert_array_equal(capture.depth_m, expected)
    share = 1 - np.isfinite(expected).sum() / np.isfinite(made.depth_m[0]).sum()
    assert any(f"{share:.1%} of the depth left out" in f.message for f in capture.findings)


def test_each_depth_map_has_the_confidence_of_its_number(tmp_path):
    made = fill(tmp_path, depth=False)
    for i in (0, 1):
        (tmp_path / f"depth_{9 + i}.tiff").write_bytes(encode_tiff(made.depth_m[0]))
        sure = np.full(made.depth_m.shape[1:], 2, np.uint8)
        sure[5 + i, 8] = 0
        write_map(tmp_path / f"conf_{9 + i}.png", sure)
    capture = load_capture(tmp_path)
    assert np.isnan(capture.depth_m[:, 5:7, 8]).tolist() == [[True, False], [False, True]]


@pytest.mark.parametrize(
    ("names", "change", "says"),
    [
        (["conf_1.png", "conf_2.png"], lambda sure: sure, "not one for each of 1"),
        (["conf.png"], lambda sure: sure[1:], "16x12 pixels"),
        (["conf.npy"], lambda sure: sure[:, 1:], "16x12 pixels"),
        (["conf.png"], lambda sure: np.dstack([sure] * 3), "16x12 pixels"),
        (["conf.png"], lambda sure: 0 * sure, "no depth would be left"),
    ],
    ids=["several", "size", "size of an array", "colour", "all 0"],
)
def test_confidence_that_does_not_fit_is_told_of(tmp_path, names, change, says):
    made = fill(tmp_path)
    sure = np.full(made.depth_m.shape[1:], 2, np.uint8)
    sure[0] = 0
    for name in names:
        write_map(tmp_path / name, change(sure))
    capture = load_capture(tmp_path)
    np.testing.assert_array_equal(capture.depth_m, made.depth_m[:1])
    (warning,) = [f for f in capture.findings if f.code == "ignored-files"]
    assert warning.severity == "warning"
    assert says in warning.message


def test_a_damaged_map_of_confidence_is_refused(tmp_path):
    fill(tmp_path)
    data = encode_png(np.ones((12, 16), np.uint8))
    (tmp_path / "conf.png").write_bytes(data[:-20])
    refusal(tmp_path, "conf.png", "damaged")


@pytest.mark.parametrize("name", ["disparity.png", "disp_0.npy", "disparities/0.png"])
def test_disparity_is_no_depth(tmp_path, name):
    made = fill(tmp_path, depth=False)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    values = as_16_bit(made.depth_m[0])
    data = as_npy(values) if name.endswith("npy") else encode_png(values)
    (tmp_path / name).write_bytes(data)
    refusal(tmp_path, f"no depth map in it (seen {name}, img9", "baseline (metres) / disparity")
    (tmp_path / "z.tiff").write_bytes(encode_tiff(made.depth_m[0]))
    capture = load_capture(tmp_path)
    np.testing.assert_array_equal(capture.depth_m, made.depth_m[:1])
    assert name in next(f for f in capture.findings if f.code == "ignored-files").message


def test_grey_beside_colour_is_another_camera(tmp_path):
    made = fill(tmp_path)
    alpha = np.full(made.camera.shape, 255, np.uint8)
    (tmp_path / "img9.png").write_bytes(encode_png(np.dstack([made.photographs[0], alpha])))
    assert len(load_capture(tmp_path).photographs) == 4  # alpha is dropped
    for i in range(4):
        (tmp_path / f"ir{i}.png").write_bytes(encode_png(made.photographs[i, ..., 1]))
    refusal(tmp_path, "images of different kinds", "32x24x1 uint8")


@pytest.mark.parametrize(("depth", "other"), [("d.png", "ir.png"), ("depth.png", "depth_raw.png")])
def test_an_image_beside_the_depth_that_is_none_of_it_is_named(tmp_path, depth, other):
    made = fill(tmp_path, depth=False)
    values = np.rint(1000 * np.nan_to_num(made.depth_m[0])).astype(np.uint16)
    (tmp_path / depth).write_bytes(encode_png(values))
    (tmp_path / other).write_bytes(encode_png(5 * values))
    refusal(tmp_path, "contradict each other", f"0.598 m in {depth}, 2.99 m in {other}")


@pytest.mark.parametrize("name", ["K.npy", "calib/intrinsics.NPY"])
def test_a_matrix_as_an_array(tmp_path, name):
    made = fill(tmp_path, texts=False)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(as_npy(made.camera.matrix))
    assert load_capture(tmp_path).camera == made.camera
    (tmp_path / name).write_bytes(as_npy(np.eye(2)))
    refusal(tmp_path, f"{name}: no intrinsics in it")


def test_a_white_card_of_another_kind_than_the_photographs_is_refused(tmp_path):
    """Of 8 bits it counts as sRGB, of 16 as linear."""
    fill(tmp_path)
    for each in tmp_path.glob("img*.png"):
        each.write_bytes(encode_png(257 * decode_image(each.read_bytes()).astype(np.uint16)))
    (tmp_path / "flat.png").write_bytes(encode_png(np.full((24, 32, 3), 200, np.uint8)))
    refusal(tmp_path, "flat.png: photographs of different kinds", "save it as the photographs are")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="a system without them")
@pytest.mark.parametrize("name", ["mask.png", "img20.png"])
def test_what_is_no_file_is_refused_by_its_name(tmp_path, name):
    fill(tmp_path)
    os.mkfifo(tmp_path / name)
    refusal(tmp_path, f"{name}: neither a file nor a folder")


def test_a_mask_of_numbers_where_nothing_is_none(tmp_path):
    made = fill(tmp_path)
    mask = np.where(made.mask, np.float32(1), np.float32("nan"))
    (tmp_path / "mask.tiff").write_bytes(encode_tiff(mask))
    assert np.array_equal(load_capture(tmp_path).mask, made.mask)


def test_four_numbers_as_an_array(tmp_path):
    made = fill(tmp_path, texts=False)
    camera = made.camera
    np.save(tmp_path / "intrinsics.npy", np.array([camera.fx, camera.fy, camera.cx, camera.cy]))
    assert load_capture(tmp_path).camera == camera
    np.save(tmp_path / "intrinsics.npy", np.array([camera.fx, camera.fy]))
    refusal(tmp_path, "intrinsics.npy: no intrinsics in it")


TABLES = {"poses": (4, 4, 4), "timestamps": (4,), "light_directions": (4, 3)}


@pytest.mark.parametrize("depth", ["depth.tiff", "000.npy"])
@pytest.mark.parametrize("name", TABLES)
def test_arrays_that_are_no_images_are_left_out(tmp_path, name, depth):
    made = fill(tmp_path)
    if depth.endswith("npy"):
        (tmp_path / "depth.tiff").unlink()
        np.save(tmp_path / depth, made.depth_m[0])
    np.save(tmp_path / f"{name}.npy", np.zeros(TABLES[name]))
    capture = load_capture(tmp_path)
    assert np.array_equal(capture.depth_m, made.depth_m[:1], equal_nan=True)
    found = [f for f in capture.findings if f.code == "ignored-files"]
    assert all(f"{name}.npy" in f.message for f in found)
    assert ("warning" in [f.severity for f in found]) == (name == "light_directions")


def test_an_array_that_was_meant_for_depth_is_named(tmp_path):
    made = fill(tmp_path, depth=False)
    np.save(tmp_path / "scan.npy", np.stack([made.depth_m[0]] * 3))
    refusal(tmp_path, "no depth map in it", "scan.npy (no array of height x width)")


def test_an_array_beside_named_depth_is_left_out(tmp_path):
    made = fill(tmp_path)
    np.save(tmp_path / "weights.npy", np.ones_like(made.depth_m[0]))
    capture = load_capture(tmp_path)
    assert np.array_equal(capture.depth_m, made.depth_m[:1], equal_nan=True)
    assert any("weights.npy" in f.message for f in capture.findings if f.code == "ignored-files")


@pytest.mark.parametrize("word", ["conf", "depth_of_field_"])
def test_photographs_whose_names_say_something_else(tmp_path, word):
    fill(tmp_path)
    for each in tmp_path.glob("img*.png"):
        each.rename(each.with_name(f"{word}{each.name[3:]}"))
    refusal(tmp_path, f"no photographs in it (seen {word}9.png", "rename those")


def test_depth_that_is_turned(tmp_path):
    fill(tmp_path, depth=False)
    (tmp_path / "depth.tiff").write_bytes(encode_tiff(np.full((16, 12), 0.6, np.float32)))
    refusal(tmp_path, "turned against each other", "depth 12x16, colour 32x24", "by 90 degrees")


def test_no_image_is_left_out_without_a_word(tmp_path):
    fill(tmp_path)
    (tmp_path / "img13.webp").write_bytes(b"RIFF0000WEBP")
    warning = next(f for f in load_capture(tmp_path).findings if f.code == "unread-images")
    assert "img13.webp" in warning.message
    for name, data, words in (
        ("img13.png", b"<html>", "seen HTML or XML"),
        ("img13.JPG", b"version https://git-lfs.github.com/spec/v1", "git lfs pull"),
        ("img13.heic", b"", "the file is empty"),
        ("img13.dng", b"text", "not an image file"),
    ):
        path = tmp_path / name
        path.write_bytes(data)
        refusal(tmp_path, f"{name}: ", words)
        path.unlink()
    (tmp_path / "img13.png").symlink_to(tmp_path / "elsewhere.png")
    refusal(tmp_path, "img13.png: a link to nothing")


@pytest.mark.parametrize("text", ["40 40.5 15.25", "", "fx=40"])
def test_a_file_of_intrinsics_that_states_none(tmp_path, text):
    fill(tmp_path)
    (tmp_path / "intrinsics.txt").write_text(text)
    refusal(tmp_path, "intrinsics.txt: no intrinsics in it", f"seen {text or 'nothing'}", "fx 0 cx")


def test_two_files_of_the_same_intrinsics(tmp_path):
    made = fill(tmp_path)
    stated = {"fx": 40, "fy": 40.5, "cx": 15.25, "cy": 11.75}
    for i, width in enumerate((32, 32, 16)):
        text = json.dumps({**stated, "width": width, "height": width * 3 // 4})
        (tmp_path / f"camera{i}.json").write_text(text)
        if width == 32:
            assert load_capture(tmp_path).camera == made.camera
    refusal(tmp_path, "several files with intrinsics")


def open_cv(name, K, distortion):
    """What cv::FileStorage writes."""
    storage = cv2.FileStorage(name, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    storage.write("image_width", 32)
    storage.write("image_height", 24)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", distortion)
    return storage.releaseAndGetString()


def test_intrinsics_of_other_programs(tmp_path):
    made = fill(tmp_path, texts=False)
    matrix = made.camera.matrix
    none = np.zeros((1, 5))
    open_3d = {"width": 32, "height": 24, "intrinsic_matrix": matrix.T.ravel().tolist()}
    texts = {
        "a.yml": open_cv(".yml", matrix, none),
        "a.xml": open_cv(".xml", matrix, none),
        "a.json": open_cv(".json", matrix, none),
        "b.json": json.dumps(open_3d),
        "cameras.txt": "# Camera list\n1 PINHOLE 32 24 40 40.5 15.75 12.25\n",
        "k.csv": "40,0,15.25\n0,40.5,11.75\n0,0,1",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        assert load_capture(tmp_path).camera == made.camera, name
        (tmp_path / name).unlink()
    for name, text, model, coefficients in (
        ("a.yml", open_cv(".yml", matrix, none + 0.01), "brown-conrady", (0.01,) * 5),
        ("cameras.txt", "1 OPENCV 32 24 40 40.5 15.75 12.25 0.01 0 0 0\n", "brown-conrady",
         (0.01, *(0,) * 7)),
        ("fisheye.txt", "1 OPENCV_FISHEYE 32 24 40 40.5 15.75 12.25 0.01 0 0 0\n",
         "kannala-brandt", (0.01, 0, 0, 0)),
    ):  # fmt: skip
        (tmp_path / name).write_text(text)
        assert load_capture(tmp_path).camera.distortion == Distortion(model, coefficients), name
        (tmp_path / name).unlink()
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 64 48 80 81 31.5 24\n")
    refusal(tmp_path, "[intrinsics] is for another image size", "fx = 40")


def jpeg(pixels, **tags):
    exif = Image.Exif()
    for tag, value in tags.items():
        exif.get_ifd(34665)[int(tag[1:])] = value
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=95, exif=exif)
    return file.getvalue()


def test_intrinsics_by_exif_say_how_rough_they_are(tmp_path):
    made = fill(tmp_path, texts=False)
    for i, pixels in enumerate(made.photographs):
        (tmp_path / f"img{9 + i}.png").unlink()
        (tmp_path / f"img{9 + i}.jpg").write_bytes(jpeg(pixels, t41989=43))
    capture = load_capture(tmp_path)
    assert capture.camera.fx == pytest.approx(43 * np.hypot(32, 24) / np.hypot(36, 24))
    assert (capture.camera.cx, capture.camera.cy) == (15.5, 11.5)
    warning = next(f for f in capture.findings if f.code == "intrinsics-from-exif")
    assert "about 5% uncertain; depth" in warning.message
    assert "jpeg" in codes(capture)


def test_an_exposure_that_changes_is_said_and_taken_over(tmp_path):
    made = fill(tmp_path)
    exposures = []

    def said(*settings, flash=0):
        for i, (pixels, (parts, f_number, iso)) in enumerate(
            zip(made.photographs, settings, strict=True)
        ):
            (tmp_path / f"img{9 + i}.png").unlink(missing_ok=True)
            tags = {"t33437": IFDRational(f_number), "t34855": iso, "t37385": flash}
            if parts:  # of a second
                tags["t33434"] = IFDRational(1, parts)
            data = jpeg(pixels, **tags)
            (tmp_path / f"img{9 + i}.jpg").write_bytes(data)
        capture = load_capture(tmp_path)
        exposures[:] = capture.exposures
        return [f.message for f in capture.findings if f.code == "exposure-changed"]

    same = [(33, 2, 100)] * (len(made.photographs) - 1)
    assert said((30, 2, 100), *same) == []
    assert exposures == []
    (message,) = said((33, 2, 200), *same)
    assert "by 2.0 times" in message
    assert exposures == [1.0] + [0.5] * len(same)
    (message,) = said((33, 4, 100), *same)
    assert "by 4.0 times" in message
    assert exposures == [1.0] + [4.0] * len(same)
    assert said((None, 2, 400), *same) == []
    assert exposures == []
    # A flash is shorter than any exposure: the time does not count.
    assert said((60, 2, 100), *same, flash=1) == []
    assert len(said((60, 2, 100), *same, flash=16)) == 1  # it has not fired


def test_exif_of_a_photograph_that_was_turned_by_software():
    """The resolution of the sensor is that of the longer side, width or height."""
    # 8 mm, 3000 pixels on 6.4 mm
    figures = {"t37386": IFDRational(8), "t41486": IFDRational(30000, 64), "t41488": 4}
    for width, height in ((3000, 2000), (2000, 3000)):
        data = jpeg(np.zeros((8, 8, 3), np.uint8), t40962=width, t40963=height, **figures)
        camera, _ = camera_of(exif_of(data), width, height)
        assert camera.fx == pytest.approx(8 / 6.4 * 3000)


@pytest.mark.parametrize("sensor", [(4032, 3024), (6000, 4000)])
@pytest.mark.parametrize("proportions", [(16, 9), (1, 1), (2, 1)])
def test_a_photograph_that_was_cut_has_a_rougher_focal_length(sensor, proportions):
    exif = Exif(focal_35mm=26.0)
    known = camera_of(exif, *sensor)[0].fx
    assert [roughness_of(exif, *size) for size in (sensor, sensor[::-1])] == [ROUGHNESS] * 2
    scale = min(side / part for side, part in zip(sensor, proportions, strict=True))
    cut = [int(scale * part) for part in proportions]
    off = known / camera_of(exif, *cut)[0].fx - 1
    assert ROUGHNESS + off - 0.005 < roughness_of(exif, *cut) < ROUGHNESS + off + 0.11
    assert roughness_of(exif, *cut[::-1]) == roughness_of(exif, *cut)
    # Cut by a program that keeps the EXIF.
    kept = Exif(focal_35mm=26.0, longer=max(sensor), shorter=min(sensor))
    assert roughness_of(kept, *cut) == pytest.approx(ROUGHNESS + off, abs=0.005)
    assert roughness_of(kept, *sensor) == ROUGHNESS


def test_a_rougher_focal_length_is_said(tmp_path):
    made = fill(tmp_path, depth=False, texts=False)
    (tmp_path / "depth.tiff").write_bytes(encode_tiff(made.depth_m[0, :9]))
    for i, pixels in enumerate(made.photographs):
        (tmp_path / f"img{9 + i}.png").unlink()
        (tmp_path / f"img{9 + i}.jpg").write_bytes(jpeg(pixels[:18], t41989=43))
    warning = next(f for f in load_capture(tmp_path).findings if f.code == "intrinsics-from-exif")
    assert "about 14% uncertain, as the photographs look cut out of larger ones" in warning.message


def test_a_calibration_that_is_not_understood_is_named_beside_exif(tmp_path):
    made = fill(tmp_path, texts=False)
    for i, pixels in enumerate(made.photographs):
        (tmp_path / f"img{9 + i}.png").unlink()
        (tmp_path / f"img{9 + i}.jpg").write_bytes(jpeg(pixels, t41989=43))
    (tmp_path / "camera_settings.yaml").write_text("aperture: 8\n")
    warning = next(f for f in load_capture(tmp_path).findings if f.code == "intrinsics-from-exif")
    assert warning.message.endswith("; no intrinsics were found in camera_settings.yaml")


def test_depth_whose_sides_divide_the_photographs_by_no_integer(tmp_path):
    made = fill(tmp_path, depth=False)
    depth_m = np.full((15, 20), 0.6, np.float32)
    (tmp_path / "depth.tiff").write_bytes(encode_tiff(depth_m))
    capture = load_capture(tmp_path)
    assert capture.depth_camera == made.camera.resized(20, 15)
    assert "same-view" in codes(capture)
    (tmp_path / "depth.tiff").write_bytes(encode_tiff(depth_m[:13]))
    refusal(tmp_path, "depth and colour sizes do not fit")


def test_the_exr_and_jpg_that_record3d_exports(tmp_path):
    made = fill(tmp_path, depth=False, texts=False)
    for name in ("rgb", "depth"):
        (tmp_path / name).mkdir()
    for i in range(4):
        (tmp_path / f"img{9 + i}.png").rename(tmp_path / "rgb" / f"{i}.png")
        exr(tmp_path / "depth" / f"{i}.exr", R=made.depth_m[0])
    facts = {"w": 32, "h": 24, "K": made.camera.matrix.T.ravel().tolist(), "fps": 60}
    (tmp_path / "metadata.json").write_text(json.dumps(facts))
    capture = load_capture(tmp_path)
    assert np.array_equal(capture.depth_m, made.depth_m[[0] * 4], equal_nan=True)
    assert capture.camera == made.camera


def test_exr_brighter_than_white_is_scaled_alike(tmp_path):
    made = fill(tmp_path)
    light = made.photographs.astype(np.float32) / 100
    for i, image in enumerate(light):
        (tmp_path / f"img{9 + i}.png").unlink()
        exr(tmp_path / f"img{9 + i}.exr", RGB=image)
    capture = load_capture(tmp_path)
    assert (capture.encoding, capture.photographs.dtype) == ("linear", np.uint16)
    assert "light-scaled" in codes(capture)
    usable = capture.photographs < 0.98 * 65535
    assert usable.mean() > 0.99
    factor = (capture.photographs / light)[usable]
    assert factor.max() / factor.min() == pytest.approx(1, abs=2e-3)


def test_raw_beside_its_jpeg(tmp_path):
    made = fill(tmp_path)
    (tmp_path / "intrinsics.txt").write_bytes(b"80 0 31 0 81 24 0 0 1")
    for i, pixels in enumerate(made.photographs):
        (tmp_path / f"img{9 + i}.png").unlink()
        light = (pixels / 255).repeat(2, 0).repeat(2, 1)
        file = dng(mosaic_of(light), 1000, 16000, neutral=(0.5 + 0.1 * i, 1, 1))
        (tmp_path / f"img{9 + i}.dng").write_bytes(file)
        (tmp_path / f"img{9 + i}.jpg").write_bytes(encode_jpeg(pixels))
    capture = load_capture(tmp_path)
    assert capture.photographs.shape == made.photographs.shape  # half of the mosaic's
    assert capture.camera == replace(made.camera, fx=40.0, fy=40.5, cx=15.25, cy=11.75)
    values = np.clip(made.photographs / 255 * [2, 1, 1], 0, 1)  # of the first for all
    assert np.abs(capture.photographs / 65535 - values).max() < 1e-3
    assert {"raw", "ignored-files"} <= set(codes(capture))


def test_damaged_heic_is_one_clear_line(tmp_path):
    made = fill(tmp_path)
    for i, pixels in enumerate(made.photographs):
        (tmp_path / f"img{9 + i}.png").unlink()
        (tmp_path / f"img{9 + i}.heic").write_bytes(heic(pixels)[: 4000 if i else None][:900])
    refusal(tmp_path, "img9.heic", "damaged")


def test_an_orientation_is_applied_where_the_heics_container_says_so(tmp_path):
    made = fill(tmp_path)
    turned, noted = exif(3), heic(made.photographs[0], exif=exif(1)).replace(exif(1), exif(3))
    for i, pixels in enumerate(made.photographs):
        (tmp_path / f"img{9 + i}.png").unlink()
        data = heic(pixels, exif=turned) if i else noted
        (tmp_path / f"img{9 + i}.heic").write_bytes(data)
    capture = load_capture(tmp_path)
    off = capture.photographs.astype(int) - made.photographs
    upside_down = capture.photographs[:, ::-1, ::-1].astype(int) - made.photographs
    assert [np.abs(each).mean() < 3 for each in off] == [True, False, False, False]
    assert [np.abs(each).mean() < 3 for each in upside_down] == [False, True, True, True]
    said = next(f.message for f in capture.findings if f.code == "exif-orientation")
    assert said == "orientation applied in img10.heic, img11.heic, img12.heic, ignored in img9.heic"


# --- end to end ---

# What the lamp is: nothing is to be found out about it.
LAMP = MultiLight(lights="white", distance="distant")


@pytest.fixture(scope="module")
def scene():
    """A capture, its truth, and the errors of what is refined from it without a detour."""
    shape = make_shape("vase")
    options = SceneOptions(
        camera=shape.camera.scaled(0.15), photographs=6, depth_factor=2, image_noise=0.003,
        supersampling=1, depth_noise=DepthNoise(rms_mm=2.0),
    )  # fmt: skip
    capture, truth = render_scene(shape, make_albedo("pattern"), options)
    return capture, truth, evaluate(refine(capture, options=LAMP), truth)


@pytest.mark.parametrize("suffix", ["heic", "dng"])
def test_a_capture_by_phone_or_camera_is_refined_as_well(tmp_path, scene, suffix):
    made, truth, direct = scene
    width, height = made.camera.width, made.camera.height
    twice = 2 if suffix == "dng" else 1
    camera = made.camera.scaled(twice)
    K = " ".join(map(repr, camera.matrix.ravel().tolist()))
    (tmp_path / "camera.txt").write_text(K)
    (tmp_path / "depth.tiff").write_bytes(encode_tiff(made.depth_m[0]))
    (tmp_path / "mask.png").write_bytes(encode_png(made.mask.astype(np.uint8)))
    for i, pixels in enumerate(made.photographs):
        light = pixels / 65535
        file = heic_of(light, quality=90)
        if suffix == "dng":
            file = dng(mosaic_of(light.repeat(2, 0).repeat(2, 1)), 1000, 16000)
        (tmp_path / f"IMG_{i}.{suffix}").write_bytes(file)
    capture = load_capture(tmp_path)
    assert capture.camera.shape == (height, width)
    assert capture.photographs.dtype == (np.uint8 if suffix == "heic" else np.uint16)
    found = evaluate(refine(capture, options=LAMP), truth)
    assert found.depth.rmse_mm < 1.3 * direct.depth.rmse_mm
    assert found.normals.mae_deg < 1.3 * direct.normals.mae_deg


def test_errors_are_capture_errors(tmp_path):
    fill(tmp_path)
    (tmp_path / "img9.png").write_bytes(b"\x89PNG\r\n\x1a\nrest")
    with pytest.raises(CaptureError, match=r"img9\.png: the image is damaged"):
        load_capture(tmp_path)


LENS = [-0.1, 0.05, 0.001, -0.0005, -0.02]


def lens_text(*numbers):
    return "".join(f"{number:.18e}\n" for number in numbers).encode()  # as numpy.savetxt


@pytest.mark.parametrize(
    ("name", "camera"),
    [
        ("dist.txt", "K.txt"), ("distortion_coefficients.txt", "camera_matrix.txt"),
        ("camera_distortion.csv", "camera_matrix.csv"), ("calib_dist.npy", "calib_mtx.npy"),
        ("dist_coeffs.npy", "camera_matrix.npy"), ("distortion.json", "intrinsics.json"),
    ],
)  # fmt: skip
def test_a_lens_in_a_file_of_its_own(tmp_path, name, camera):
    fill(tmp_path, texts=False)
    for file, array in ((name, np.array([LENS])), (camera, np.loadtxt(io.BytesIO(K)))):
        if file.endswith(".npy"):
            np.save(tmp_path / file, array)
        elif file.endswith(".json"):
            facts = {"K" if file == camera else "dist": array.tolist()}
            (tmp_path / file).write_text(json.dumps(facts))
        else:
            np.savetxt(tmp_path / file, array)
    capture = load_capture(tmp_path)
    assert (capture.camera.fx, capture.camera.cy) == (40, 11.75)
    assert capture.camera.distortion == Distortion("brown-conrady", LENS)
    assert "ignored-files" not in codes(capture)


def test_a_file_of_four_coefficients_is_no_camera(tmp_path):
    """Four numbers in a file with camera in its name are fx fy cx cy otherwise."""
    fill(tmp_path)
    (tmp_path / "camera_distortion.txt").write_bytes(lens_text(*LENS[:4]))
    assert load_capture(tmp_path).camera.distortion == Distortion("brown-conrady", LENS[:4])
    (tmp_path / "camera_distortion.txt").write_bytes(lens_text(0, 0, 0, 0))
    assert load_capture(tmp_path).camera.distortion is None
    (tmp_path / "intrinsics.txt").unlink()
    facts = (40, 40.5, 15.25, 11.75, *LENS[:4])
    (tmp_path / "camera_distortion.txt").write_bytes(lens_text(*facts))
    assert load_capture(tmp_path).camera.distortion == Distortion("brown-conrady", LENS[:4])


def test_lenses_that_contradict_each_other_are_refused(tmp_path):
    fill(tmp_path)
    (tmp_path / "dist.txt").write_bytes(lens_text(*LENS))
    (tmp_path / "distortion.txt").write_bytes(lens_text(*LENS))
    load_capture(tmp_path)
    (tmp_path / "distortion.txt").write_bytes(lens_text(*LENS[:4], 0))
    refusal(tmp_path, "several files with the distortion", "dist.txt, distortion.txt")
    (tmp_path / "distortion.txt").unlink()
    facts = {"K": np.loadtxt(io.BytesIO(K)).tolist(), "D": [0.1, 0, 0, 0, 0]}
    (tmp_path / "intrinsics.txt").write_text(json.dumps(facts))
    refusal(tmp_path, "several files with the distortion", "intrinsics.txt, dist.txt")


def test_distances_are_no_lens(tmp_path):
    fill(tmp_path)
    (tmp_path / "dist.txt").write_bytes(lens_text(0.6, 0.6, 0.7))
    (tmp_path / "distances.txt").write_bytes(lens_text(*LENS))
    assert load_capture(tmp_path).camera.distortion is None


def test_a_lens_in_a_file_of_its_own_is_told(tmp_path):
    fill(tmp_path)
    (tmp_path / "lamp_dist.txt").write_text("0.05 0.06 0.05 0.06")
    (note,) = [f for f in load_capture(tmp_path).findings if f.code == "lens-from-file"]
    assert (note.severity, "lamp_dist.txt" in note.message) == ("note", True)
    for numbers in ("0.61 0.62 0.63 0.64", "0 0 0 0"):
        (tmp_path / "lamp_dist.txt").write_text(numbers)
        capture = load_capture(tmp_path)
        assert capture.camera.distortion is None
        assert "lens-from-file" not in codes(capture)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ([0.1, -0.2, 0, 0, 0], "0.1 -0.2 0 0"),
        ({"k1": 0.1, "k2": -0.2}, "0.1 -0.2 0 0 0"),
        ([0.1234567891, 0.2, 0, 0], "0.123457 0.2 0 0"),
    ],
)
def test_the_same_lens_twice_is_one(tmp_path, one, other):
    fill(tmp_path)
    facts = {"K": np.loadtxt(io.BytesIO(K)).tolist(), "distortion": one}
    (tmp_path / "intrinsics.txt").write_text(json.dumps(facts))
    (tmp_path / "dist.txt").write_text(other)
    capture = load_capture(tmp_path)
    assert capture.camera.distortion == parse_intrinsics(json.dumps(facts).encode()).distortion
    assert "lens-from-file" not in codes(capture)
    (tmp_path / "dist.txt").write_text(other.replace("0.2 0", "0.21 0"))
    refusal(tmp_path, "several files with the distortion", "dist.txt")


@pytest.mark.parametrize("name", ["dist_coeffs.npy", "calib_dist_coeffs.npy"])
def test_a_lens_in_an_array_of_one_axis(tmp_path, name):
    fill(tmp_path)
    np.save(tmp_path / name, np.array(LENS))
    assert load_capture(tmp_path).camera.distortion == Distortion("brown-conrady", LENS)


@pytest.mark.parametrize("shape", [(15,), (2, 24), (4, 1, 1), (0,), ()])
def test_another_array_is_no_lens(tmp_path, shape):
    fill(tmp_path)
    np.save(tmp_path / "distortion.npy", np.full(shape, 0.01))
    assert load_capture(tmp_path).camera.distortion is None
    (tmp_path / "distortion.npy").write_bytes(b"\x93NUMPY")
    refusal(tmp_path, "damaged", "no header")


def test_proportions_in_exif_that_no_camera_has_are_ignored():
    for sides in ((100, 1), (5000, 1200)):
        exif = Exif(focal_35mm=26.0, longer=sides[0], shorter=sides[1])
        assert roughness_of(exif, 4032, 3024) == ROUGHNESS
        assert roughness_of(exif, 4032, 2268) == roughness_of(Exif(focal_35mm=26.0), 4032, 2268)
    of_film = Exif(focal_35mm=26.0, longer=6500, shorter=2400)
    assert roughness_of(of_film, 4032, 3024) > ROUGHNESS + 0.5


def test_numbers_of_a_camera_and_its_lens_in_a_file_called_after_the_lens(tmp_path):
    """fx fy cx cy k1 k2 p1 p2: no lens has p1 and p2 as large as a principal point."""
    made = fill(tmp_path)
    facts = [40, 40.5, 15.25, 11.75]
    (tmp_path / "distortion.txt").write_bytes(lens_text(*facts, *LENS[:4]))
    capture = load_capture(tmp_path)
    assert capture.camera.distortion == Distortion("brown-conrady", LENS[:4])
    assert "lens-from-file" in codes(capture)
    (tmp_path / "intrinsics.txt").unlink()
    found = load_capture(tmp_path).camera
    assert found == replace(made.camera, distortion=capture.camera.distortion)
    (tmp_path / "distortion.txt").unlink()
    np.save(tmp_path / "distortion.npy", np.array([*facts, *LENS]))
    assert load_capture(tmp_path).camera.distortion == Distortion("brown-conrady", LENS)
    (tmp_path / "K.txt").write_bytes(lens_text(41, *facts[1:]))
    refusal(tmp_path, "several files with intrinsics", "K.txt", "distortion.npy")


@pytest.mark.parametrize("text", ["40 40.5 15.25 11.75", "0.6", "calibrated on 12.11.2024"])
def test_a_file_called_after_a_lens_that_states_none_is_told(tmp_path, text):
    fill(tmp_path)
    (tmp_path / "distortion.txt").write_text(text)
    capture = load_capture(tmp_path)
    assert capture.camera.distortion is None
    (note,) = [f for f in capture.findings if f.code == "ignored-files"]
    assert (note.severity, "in distortion.txt" in note.message) == ("note", True)


@pytest.mark.parametrize("made", ["capture folders", "loose files", "without masks"])
def test_captures_of_their_own_are_told_to_be_captures(tmp_path, made):
    for day in ("monday", "tuesday"):
        (build if made == "capture folders" else fill)(tmp_path / day)
        if made != "without masks":
            mask = encode_png(small_capture().mask.astype(np.uint8))
            (tmp_path / day / "mask.png").write_bytes(mask)
    (tmp_path / "all.jpg").write_bytes(encode_jpeg(small_capture().photographs[0]))
    refusal(tmp_path, "a folder of captures (seen monday, tuesday", "`rakelight batch`")


def test_a_lens_in_an_array_called_dist_is_read(tmp_path):
    fill(tmp_path)
    np.save(tmp_path / "dist.npy", np.array([[0.1, -0.2, 0.0, 0.0, 0.05]]))
    capture = load_capture(tmp_path)
    assert capture.camera.distortion.coefficients == (0.1, -0.2, 0.0, 0.0, 0.05)
    assert "lens-from-file" in codes(capture)
    # A map of distances is none.
    (tmp_path / "depth.tiff").unlink()
    np.save(tmp_path / "dist.npy", np.full((12, 16), 0.6, np.float32))
    capture = load_capture(tmp_path)
    assert (capture.camera.distortion, capture.depth_m.max()) == (None, np.float32(0.6))


def test_a_rotation_is_no_second_file_with_intrinsics(tmp_path):
    fill(tmp_path)
    (tmp_path / "R.txt").write_text("1 0 0\n0 1 0\n0 0 1\n")
    assert load_capture(tmp_path).camera.fx == 40
