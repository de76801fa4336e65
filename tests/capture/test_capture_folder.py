import os
import shutil
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from rakelight.capture import load_capture, load_truth, write_capture
from rakelight.errors import CaptureError, InputError, MachineError, OutputExistsError
from rakelight.model import Camera, Capture, Lights, RigidTransform, SensorNoise
from tests.capture.capture_builder import (
    HEIGHT,
    WIDTH,
    build,
    codes,
    edit_config,
    small_capture,
    small_truth,
)

REAL = Path(__file__).parents[3] / "shared" / "captures"


def same_bits(a, b):
    assert a.dtype == b.dtype
    assert a.shape == b.shape
    return np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("factor", [1, 2, 4])
def test_written_and_read_back_is_the_same(tmp_path, dtype, factor):
    capture = small_capture(dtype=dtype, factor=factor, encoding="srgb", lighting="rgb-leds")
    write_capture(capture, tmp_path / "c")
    again = load_capture(tmp_path / "c")
    for name in ("photographs", "depth_m", "mask"):
        assert same_bits(getattr(again, name), getattr(capture, name)), name
    assert again.camera == capture.camera
    assert (again.encoding, again.lighting) == ("srgb", "rgb-leds")
    assert again.depth_camera is None
    assert again.depth_to_color is None
    assert again.depth_noise is None
    assert again.names == ("000.png", "001.png", "002.png", "003.png")
    assert again.source == str(tmp_path / "c")
    assert "median depth 0.60 m" in [finding.message for finding in again.findings]


@pytest.mark.parametrize("size", [(10, 13), (8, 11), (16, 21), (7, 9)])
def test_depth_of_any_ratio_of_resolutions_is_read(tmp_path, size):
    """One side of each is rounded: 13.33, 10.67, 21.33, 9.33 pixels wide."""
    depth_m = np.random.default_rng(0).normal(0.6, 0.01, (2, *size)).astype(np.float32)
    capture = small_capture(depth_m=depth_m)
    write_capture(capture, tmp_path / "c")
    again = load_capture(tmp_path / "c")
    assert same_bits(again.depth_m, depth_m)
    arrays = Capture.from_arrays(capture.photographs, depth_m, capture.camera, mask=capture.mask)
    assert [f.message for f in arrays.findings if f.code == "median-depth"] == [
        f.message for f in again.findings if f.code == "median-depth"
    ]


def test_depth_camera_comes_back(tmp_path):
    c, s = np.cos(0.1), np.sin(0.1)
    transform = RigidTransform(
        np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.array([0.05, 1 / 3, -1e-9])
    )
    capture = small_capture(
        depth_m=np.pad(np.full((1, 9, 14), 0.7, np.float32), ((0, 0), (1, 0), (0, 0))),
        depth_camera=Camera(14, 10, 20.0, 20.0, 6.5, 4.5),
        depth_to_color=transform,
        depth_noise=SensorNoise(sigma_m=0.0021, at_m=0.7, growth=1.5),
    )
    write_capture(capture, tmp_path / "c")
    again = load_capture(tmp_path / "c")
    assert again.depth_camera == capture.depth_camera
    assert again.depth_noise == capture.depth_noise
    assert "depth-missing" not in codes(tmp_path / "c")  # what of it is the object is not known
    assert same_bits(again.depth_to_color.rotation, transform.rotation)
    assert same_bits(again.depth_to_color.translation_m, transform.translation_m)
    nine = ", ".join(map(repr, transform.rotation.ravel().tolist()))
    edit_config(tmp_path / "c", repr(transform.rotation.tolist()), f"[{nine}]")
    assert same_bits(load_capture(tmp_path / "c").depth_to_color.rotation, transform.rotation)


def test_exposures_come_back_also_of_some_photographs(tmp_path):
    capture = small_capture(exposures=(1.0, 2.0, 0.25, 0.123457))
    write_capture(capture, tmp_path / "c")
    assert load_capture(tmp_path / "c").exposures == capture.exposures
    assert load_capture(tmp_path / "c", photographs=[3, 0]).exposures == (0.123457, 1.0)
    assert capture.select([2, 1]).exposures == (0.25, 2.0)
    assert load_capture(build(tmp_path / "d")).exposures == ()


def test_depth_camera_alone_looks_from_the_same_place(tmp_path):
    capture = small_capture(depth_camera=Camera(16, 12, 20.0, 20.0, 7.5, 5.5))
    write_capture(capture, tmp_path / "c")
    transform = load_capture(tmp_path / "c").depth_to_color
    np.testing.assert_array_equal(transform.rotation, np.eye(3))
    np.testing.assert_array_equal(transform.translation_m, np.zeros(3))


def test_integer_depth_is_rounded_to_its_scale_once(tmp_path):
    capture = small_capture()
    write_capture(capture, tmp_path / "a", depth_scale=1000)
    first = load_capture(tmp_path / "a")
    holes = np.isnan(capture.depth_m)
    np.testing.assert_array_equal(np.isnan(first.depth_m), holes)
    error_m = np.abs(first.depth_m - capture.depth_m)[~holes].max()
    assert 0.0004 < error_m <= 0.000501
    write_capture(first, tmp_path / "b", depth_scale=1000)
    assert same_bits(load_capture(tmp_path / "b").depth_m, first.depth_m)


@pytest.mark.parametrize("depth_scale", [200_000.0, 0.5])
def test_depth_that_does_not_fit_16_bit_is_not_written(tmp_path, depth_scale):
    with pytest.raises(CaptureError, match="does not fit 16 bit"):
        write_capture(small_capture(), tmp_path / "c", depth_scale=depth_scale)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("depth_scale", [True, "1000", 10**400, float("nan"), 1j])
def test_a_depth_scale_that_is_no_number_is_named(tmp_path, depth_scale):
    with pytest.raises(InputError, match=r"depth_scale: this is no finite number"):
        write_capture(small_capture(), tmp_path / "c", depth_scale=depth_scale)
    assert list(tmp_path.iterdir()) == []


# At 0.6 m the unknown sensor's noise is 0.51 mm, that of rounding to steps of 1.77 mm.
@pytest.mark.parametrize(
    ("depth_scale", "noise", "needed"),
    [
        (1, None, "565 or more"),
        (563, None, "565 or more"),
        (999, SensorNoise(1e-5), "1000 or more"),
        (28, SensorNoise(0.01, 0.6), "29 or more"),
    ],
)
def test_depth_is_not_rounded_more_coarsely_than_it_was_measured(
    tmp_path, depth_scale, noise, needed
):
    capture = small_capture(depth_noise=noise)
    capture = replace(capture, depth_m=np.maximum(capture.depth_m, np.float32(0.51)))
    with pytest.raises(CaptureError, match=f"steps of .* at a median depth of 0.599 m.*{needed}"):
        write_capture(capture, tmp_path / "c", depth_scale=depth_scale)
    assert list(tmp_path.iterdir()) == []
    finer = int(needed.split()[0])
    write_capture(capture, tmp_path / "c", depth_scale=finer)
    error_m = np.nanmax(np.abs(load_capture(tmp_path / "c").depth_m - capture.depth_m))
    assert error_m < 0.501 / finer


@pytest.mark.parametrize(
    ("field", "lights"),
    [
        ("truth.lights", 3),
        ("truth.lights.vector", Lights(None, np.ones((4, 1)))),
        ("truth.lights.ambient", Lights(np.ones((4, 2, 3)), np.ones((4, 2)))),
        ("truth.lights.ambient", Lights(np.ones((4, 1, 3)), np.full((4, 1), np.nan))),
    ],
)
def test_wrong_true_lights_are_named_and_nothing_is_written(tmp_path, field, lights):
    truth = replace(small_truth(), lights=lights)
    with pytest.raises(InputError) as caught:
        write_capture(small_capture(), tmp_path / "c", truth=truth)
    assert caught.value.source == field
    assert list(tmp_path.iterdir()) == []


def test_truth_comes_back(tmp_path):
    truth = small_truth()
    write_capture(small_capture(), tmp_path / "c", truth=truth)
    again = load_truth(tmp_path / "c")
    for name in ("depth", "normals", "albedo"):
        assert same_bits(getattr(again, name), getattr(truth, name)), name
    for each in fields(Lights):
        ours, theirs = (getattr(lights, each.name) for lights in (again.lights, truth.lights))
        assert (ours is None) == (theirs is None)
        assert ours is None or same_bits(ours, theirs), each.name
    write_capture(small_capture(), tmp_path / "d", truth=replace(truth, lights=None))
    assert load_truth(tmp_path / "d").lights is None


def test_true_lights_with_beams_in_a_lit_room_come_back(tmp_path):
    truth = small_truth()
    vector, middle_m = truth.lights.vector, np.array([0.0, 0.01, 0.5])
    beam, direction = np.arange(vector.size).reshape(vector.shape) / 7, np.array([0.5, 0.0, -1.0])
    lights = Lights(vector, truth.lights.ambient, None, middle_m, beam, direction)
    write_capture(small_capture(), tmp_path / "c", truth=replace(truth, lights=lights))
    again = load_truth(tmp_path / "c").lights
    assert again.position_m is None
    for name in ("vector", "ambient", "middle_m", "beam", "ambient_direction"):
        assert same_bits(getattr(again, name), getattr(lights, name)), name


def test_a_truth_without_albedo_is_read(tmp_path):
    truth = small_truth()
    write_capture(small_capture(), tmp_path / "c", truth=truth)
    (tmp_path / "c/truth/albedo.tiff").unlink()
    again = load_truth(tmp_path / "c")
    assert same_bits(again.normals, truth.normals)
    assert again.albedo.shape == truth.albedo.shape
    assert np.isnan(again.albedo).all()
    (tmp_path / "c/truth/normals.tiff").unlink()
    with pytest.raises(InputError, match=r"normals\.tiff"):
        load_truth(tmp_path / "c")


def test_broken_truth_is_refused(tmp_path):
    write_capture(small_capture(), tmp_path / "c", truth=small_truth())
    truth = tmp_path / "c" / "truth"
    (truth / "lights.json").write_text('{"vector": [[[1, 2]]], "ambient": [[1]]}')
    with pytest.raises(CaptureError, match=r"truth/lights.json: the lights do not fit"):
        load_truth(tmp_path / "c")
    (truth / "lights.json").write_text("{")
    with pytest.raises(CaptureError, match="not the lights"):
        load_truth(tmp_path / "c")
    shutil.copy(truth / "depth.tiff", truth / "normals.tiff")
    with pytest.raises(CaptureError, match=r"normals.tiff: this map does not fit"):
        load_truth(tmp_path / "c")
    shutil.rmtree(truth)
    with pytest.raises(CaptureError, match="no truth"):
        load_truth(tmp_path / "c")


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"mask": np.ones((5, 5), bool)}, "mask"),
        ({"camera": Camera(WIDTH, HEIGHT + 1, 9.0, 9.0, 3.0, 3.0)}, "photographs"),
        ({"depth_m": np.ones((12, 16), np.float32)}, "depth_m"),
    ],
)
def test_arrays_that_do_not_fit_are_not_written(tmp_path, changes, name):
    with pytest.raises(CaptureError, match=f"{name}: this array does not fit"):
        write_capture(small_capture(**changes), tmp_path / "c")
    truth = replace(small_truth(), normals=np.zeros((2, 2, 3), np.float32))
    with pytest.raises(CaptureError, match=r"truth\.normals: this array"):
        write_capture(small_capture(), tmp_path / "c", truth=truth)


def test_overwriting(tmp_path):
    folder = build(tmp_path / "c")
    before = sorted((p, p.stat().st_mtime_ns) for p in folder.rglob("*"))
    with pytest.raises(OutputExistsError):
        build(folder)
    with pytest.raises(OutputExistsError, match="never overwritten"):
        write_capture(load_capture(folder), tmp_path / "." / "c", overwrite=True)
    assert sorted((p, p.stat().st_mtime_ns) for p in folder.rglob("*")) == before
    write_capture(small_capture(photographs=5), folder, overwrite=True)
    assert len(load_capture(folder).photographs) == 5
    assert [p.name for p in tmp_path.iterdir()] == ["c"]


def test_reading_writes_nothing(tmp_path):
    folder = build(tmp_path / "c")
    before = sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*"))
    load_capture(folder)
    assert sorted((p, p.stat().st_mtime_ns) for p in tmp_path.rglob("*")) == before


def test_what_capture_toml_leaves_open(tmp_path):
    eight = build(tmp_path / "8")
    edit_config(eight, 'encoding = "linear"\n', "")
    edit_config(eight, 'lighting = "moving-lamp"\n', "")
    capture = load_capture(eight)
    assert (capture.encoding, capture.lighting) == ("srgb", "moving-lamp")
    assert "encoding-assumed" in [finding.code for finding in capture.findings]
    sixteen = build(tmp_path / "16", dtype=np.uint16, photographs=1)
    edit_config(sixteen, 'encoding = "linear"\n', "")
    edit_config(sixteen, 'lighting = "moving-lamp"\n', "")
    capture = load_capture(sixteen)
    assert (capture.encoding, capture.lighting) == ("linear", "ambient")


def test_photographs_come_in_the_order_of_their_numbers(tmp_path):
    folder = build(tmp_path / "c")
    for old, new in (("000", "img10"), ("001", "img9"), ("002", "img1"), ("003", "img02")):
        (folder / "rgb" / f"{old}.png").rename(folder / "rgb" / f"{new}.png")
    capture = load_capture(folder)
    assert capture.names == ("img1.png", "img02.png", "img9.png", "img10.png")
    np.testing.assert_array_equal(capture.photographs, small_capture().photographs[[2, 3, 1, 0]])


def test_other_files_are_skipped_and_named(tmp_path):
    folder = build(tmp_path / "c")
    (folder / "rgb" / ".DS_Store").write_bytes(b"x")
    (folder / "rgb" / "._000.png").write_bytes(b"x")
    assert "ignored-files" not in codes(folder)
    (folder / "rgb" / "Thumbs.db").write_bytes(b"x")
    findings = load_capture(folder).findings
    assert [finding.message for finding in findings if finding.code == "ignored-files"] == [
        "rgb: not images, ignored: Thumbs.db"
    ]


def test_images_that_are_not_read_are_not_called_other_files(tmp_path):
    folder = build(tmp_path / "c")
    (folder / "rgb" / "004.WEBP").write_bytes(b"x")
    (finding,) = [each for each in load_capture(folder).findings if "004" in each.message]
    assert (finding.severity, finding.code) == ("warning", "unread-images")
    assert finding.remedy == "convert them to PNG"


WEIRD = ["with space", "Grabmal Müller", "new\nline", "-o", "日本", "100%", "*?[x]", "x" * 200]
if sys.platform == "linux":
    WEIRD.append(os.fsdecode(b"caf\xe9"))


@pytest.mark.parametrize("name", WEIRD)
def test_weird_paths(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    build(name)
    (Path(name) / "rgb" / "000.png").rename(Path(name) / "rgb" / f"{name[:100]}.png")
    capture = load_capture(name)
    assert capture.source == name
    assert len(capture.photographs) == 4
    "".join(capture.names).encode()  # fit for result.json
    assert [path.name for path in tmp_path.iterdir()] == [name]
    (Path(name) / "mask.png").write_bytes(b"")
    with pytest.raises(CaptureError) as caught:
        load_capture(os.fsencode(name))
    line = str(caught.value)
    assert "\n" not in line
    line.encode()
    assert "/mask.png: the file is empty. Fix: " in line


def test_registration_is_asked_for_by_a_key(tmp_path):
    for name, wanted in (("yes", True), ("no", False)):
        write_capture(small_capture(register=wanted), tmp_path / name)
        assert load_capture(tmp_path / name).register is wanted


@pytest.mark.parametrize("name", ["nul\0byte", "y" * 300])
def test_impossible_paths(tmp_path, name):
    with pytest.raises(InputError, match=r"no such folder|File name too long"):
        load_capture(tmp_path / name)
    with pytest.raises(InputError, match=r"usable path|cannot be written"):
        write_capture(small_capture(), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads all")
def test_unreadable_file_is_the_machines_fault(tmp_path):
    folder = build(tmp_path / "c")
    (folder / "mask.png").chmod(0)
    with pytest.raises(MachineError, match=r"mask.png: cannot be read"):
        load_capture(folder)


@pytest.mark.skipif(not REAL.is_dir(), reason="the real captures are not here")
@pytest.mark.parametrize(
    ("name", "photographs", "lighting", "median_m"),
    [
        ("mitten", 20, "moving-lamp", "0.55"),
        ("android", 1, "ambient", "0.59"),
        ("monkey", 1, "ambient", "0.67"),
    ],
)
def test_real_captures(name, photographs, lighting, median_m):
    capture = load_capture(REAL / name)
    assert capture.photographs.shape == (photographs, 960, 1280, 3)
    assert capture.depth_m.shape == (photographs, 480, 640)
    assert (capture.lighting, capture.encoding) == (lighting, "linear")
    assert {finding.severity for finding in capture.findings} == {"note"}
    noted, median, *_ = capture.findings
    assert noted.code == "linear-8-bit"
    assert median.message == f"median depth {median_m} m"


@pytest.mark.parametrize("wrong", [{"depth_scale": "1000"}, {"contact_sheet": "sheet.png"}])
def test_arguments_of_another_type_write_nothing(tmp_path, wrong):
    (name,) = wrong
    with pytest.raises(InputError, match=f"{name}: this is no"):
        write_capture(small_capture(), tmp_path / "c", **wrong)
    assert not list(tmp_path.iterdir())
