"""Each way in which a capture can be wrong: one clear line and exit code 2, or a note."""

import shutil
import tracemalloc

import cv2
import numpy as np
import pytest

from rakelight.capture import load_capture, load_depth, load_truth, write_capture
from rakelight.capture.images import encode_png, encode_tiff
from rakelight.capture.one_scene import check_one_scene
from rakelight.capture.validate import check_camera
from rakelight.errors import CaptureError, InputError
from rakelight.model import Camera, Distortion, RigidTransform, SensorNoise
from tests.capture.capture_builder import (
    HEIGHT,
    WIDTH,
    build,
    codes,
    edit_config,
    exif,
    png,
    png_chunk,
    small_capture,
)


@pytest.fixture
def folder(tmp_path):
    return build(tmp_path / "c")


def refusal(folder, file, *words):
    """The one line that `load_capture` ends with: about `file`, with all `words`."""
    with pytest.raises(CaptureError) as caught:
        load_capture(folder)
    line = str(caught.value)
    assert caught.value.exit_code == 2
    assert line.startswith(f"{folder}/{file}: " if file else f"{folder}: ")
    assert line.isprintable()
    for word in words:
        assert word in line, line
    return line


def jpeg(pixels):
    return cv2.imencode(".jpg", pixels)[1].tobytes()


def photograph(folder, index=1):
    return folder / "rgb" / f"{index:03d}.png"


# --- files that are not there ---


def test_no_folder_or_a_file(tmp_path):
    refusal(tmp_path / "no", "", "no such folder")
    (tmp_path / "file").write_text("x")
    refusal(tmp_path / "file", "", "this kind of file is not read")


def test_the_truth_of_no_folder(folder):
    for path, words in ((folder / "no", "no such folder"), (folder, "this capture has no truth")):
        with pytest.raises(CaptureError, match=words):
            load_truth(path)


def test_missing_parts(folder):
    shutil.rmtree(folder / "depth")
    refusal(folder, "", "no folder depth", "depth/000.png")
    (folder / "depth").write_bytes(b"x")
    line = refusal(folder, "depth", "not a folder", "seen a file", "depth/000.png")
    assert line.endswith("put it into a folder depth, or move it away")
    (folder / "depth").unlink()
    (folder / "depth").mkdir()
    refusal(folder, "depth", "no depth maps", "an empty folder")
    (folder / "depth" / "000.exr").write_bytes(b"v/1\x01")
    refusal(folder, "depth", "000.exr")
    shutil.rmtree(folder / "rgb")
    refusal(folder, "", "no folder rgb")
    for target in ("rgb", "nowhere"):
        (folder / "rgb").symlink_to(target)
        refusal(
            folder, "rgb", "not a folder", "seen a link to nothing", "make it lead to the folder"
        )
        (folder / "rgb").unlink()
    (folder / "capture.toml").unlink()
    refusal(folder, "", "no capture.toml", "depth_scale = 1000.0", "[intrinsics]", "cx = 319.5")


# --- 1, 2, 3, 20, 21: image files ---


@pytest.mark.parametrize("file", ["rgb/002.png", "depth/001.png", "mask.png"])
def test_damaged_images(folder, file):
    path = folder / file
    whole = path.read_bytes()
    path.write_bytes(b"")
    refusal(folder, file, "the file is empty")
    path.write_bytes(whole[:-12])
    refusal(folder, file, "the end of the PNG is missing")
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 4
    path.write_bytes(bytes(flipped))
    refusal(folder, file, "wrong checksum")
    path.write_text("<!DOCTYPE html>")
    refusal(folder, file, "HTML")


def test_intact_checksums_around_a_short_stream(folder):
    photograph(folder).write_bytes(png(WIDTH, HEIGHT, 8, 2, [bytes(3 * WIDTH)]))
    refusal(folder, "rgb/001.png", "another size than the image")


def test_jpeg_for_depth_and_mask_is_refused(folder):
    (folder / "depth" / "000.png").write_bytes(jpeg(np.full((12, 16), 90, np.uint8)))
    refusal(folder, "depth/000.png", "JPEG cannot carry depth", "by its first bytes")
    build(folder.parent / "d")
    (folder.parent / "d" / "mask.png").write_bytes(jpeg(np.full((HEIGHT, WIDTH), 255, np.uint8)))
    refusal(folder.parent / "d", "mask.png", "this kind of mask is not read", "a JPEG")


def test_jpeg_photographs_are_taken_with_a_warning(folder):
    data = jpeg(small_capture().photographs[1])
    photograph(folder).write_bytes(data)
    assert {"jpeg", "misnamed"} <= set(codes(folder))
    photograph(folder).rename(photograph(folder).with_suffix(".JPG"))
    found = codes(folder)
    assert "jpeg" in found
    assert "misnamed" not in found
    photograph(folder).with_suffix(".JPG").write_bytes(data[:-40])
    refusal(folder, "rgb/001.JPG", "the end of the JPEG is missing")


def test_the_same_image_in_two_formats(folder):
    photograph(folder).with_suffix(".jpg").write_bytes(jpeg(small_capture().photographs[1]))
    refusal(folder, "rgb", "two formats", "001.jpg and 001.png")


def test_size_bomb_costs_nothing(folder):
    photograph(folder).write_bytes(png(100_000, 100_000, 8, 2, [bytes(100_000)] * 100))
    tracemalloc.start()
    refusal(folder, "rgb/001.png", "100000x100000", "100 megapixels")
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()


def each_photograph(folder, change):
    for index, pixels in enumerate(small_capture().photographs):
        photograph(folder, index).write_bytes(change(pixels))


def test_alpha_is_dropped_grey_repeated(folder):
    opaque = np.full((HEIGHT, WIDTH, 1), 9, np.uint8)
    each_photograph(folder, lambda p: encode_png(np.dstack([p, opaque])))
    assert "alpha-dropped" in codes(folder)
    np.testing.assert_array_equal(load_capture(folder).photographs, small_capture().photographs)
    each_photograph(folder, lambda p: encode_png(np.ascontiguousarray(p[..., 1])))
    assert "grey" in codes(folder)
    expected = np.repeat(small_capture().photographs[..., 1:2], 3, axis=3)
    np.testing.assert_array_equal(load_capture(folder).photographs, expected)


def test_float_photographs_are_refused(folder):
    each_photograph(folder, lambda p: encode_tiff(p.astype(np.float32)))
    refusal(folder, "rgb/000.png", "float32", "8 or 16 bit")


# --- 4, 5, 6: depth ---


def set_depth(folder, values, **config):
    shutil.rmtree(folder / "depth")
    (folder / "depth").mkdir()
    data = encode_tiff(values) if values.dtype == np.float32 else encode_png(values)
    (folder / "depth" / "000.png").write_bytes(data)


def test_8_bit_depth(folder):
    set_depth(folder, np.full((12, 16), 90, np.uint8))
    refusal(folder, "depth/000.png", "256 levels cannot carry millimetres")


def test_coloured_depth(folder):
    set_depth(folder, np.full((12, 16, 3), 90, np.uint16))
    refusal(folder, "depth/000.png", "one channel", "3 channels")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("0.001", ("median depth 6e+05 m", "depth_scale = 1000 would make the median 0.6 m")),
        ("100000.0", ("median depth 0.00599 m", "0.05 to 20 m", "depth_scale = 1000")),
        ("1.0", ("median depth 600 m", "5000 0.12 m", "4000 0.15 m")),
    ],
)
def test_wrong_depth_unit(folder, given, words):
    edit_config(folder, "depth_scale = 1000.0", f"depth_scale = {given}")
    refusal(folder, "depth", *words)


def test_missing_depth_scale_is_suggested(folder):
    edit_config(folder, "depth_scale = 1000.0\n", "")
    refusal(
        folder,
        "capture.toml",
        "'depth_scale' is missing",
        "depth_scale = 1000 would make the median 0.598 m",
    )


@pytest.mark.parametrize("value", ["0", "-1000.0", "nan", "inf"])
def test_depth_scale_that_is_none(folder, value):
    edit_config(folder, "depth_scale = 1000.0", f"depth_scale = {value}")
    refusal(folder, "capture.toml", "'depth_scale' is not positive")


def test_float_depth_takes_no_scale(folder):
    set_depth(folder, np.full((12, 16), 0.6, np.float32))
    refusal(folder, "capture.toml", "'depth_scale' does not apply", "1000")
    edit_config(folder, "depth_scale = 1000.0", "depth_scale = 1.0")
    assert load_capture(folder).depth_m[0, 5, 5] == np.float32(0.6)
    set_depth(folder, np.full((12, 16), 600, np.float32))
    edit_config(folder, "depth_scale = 1.0\n", "")
    refusal(folder, "depth", "median depth 600 m", "by 1000 if they are millimetres", "by 100 ")


def test_invalid_depth_is_a_hole_and_counted(folder):
    depth_m = np.full((12, 16), 0.6, np.float32)
    depth_m[5, 5:10] = np.nan, np.inf, 0, -1, -np.inf
    set_depth(folder, depth_m)
    edit_config(folder, "depth_scale = 1000.0\n", "")
    capture = load_capture(folder)
    expected = depth_m.copy()
    expected[5, 5:10] = np.nan
    np.testing.assert_array_equal(capture.depth_m[0], expected)
    message = next(f.message for f in capture.findings if f.code == "depth-missing")
    assert message.endswith("(values: 1 zero, 2 negative, 2 not finite)")


@pytest.mark.parametrize("nothing", [1e-5, np.finfo(np.float32).eps, 1e-40])
def test_what_is_too_near_for_any_sensor_is_a_hole(folder, nothing):
    depth_m = np.full((12, 16), 0.6, np.float32)
    depth_m[:7] = nothing  # also most of it
    set_depth(folder, depth_m)
    edit_config(folder, "depth_scale = 1000.0\n", "")
    capture = load_capture(folder)
    assert np.isnan(capture.depth_m[0, :7]).all()
    assert (capture.depth_m[0, 7:] == depth_m[7:]).all()
    (missing,) = [f.message for f in capture.findings if f.code == "depth-missing"]
    assert "nearer than 0.0001 m" in missing
    assert np.array_equal(load_depth(folder), capture.depth_m, equal_nan=True)
    set_depth(folder, np.full((12, 16), 5e-5, np.float32))
    refusal(folder, "depth", "the depth unit looks wrong", "median depth 5e-05 m")


def test_the_largest_integer_is_no_measurement(folder):
    values = np.full((12, 16), 600, np.uint16)
    values[5, 5] = 65535
    values[5, 6] = 19999
    set_depth(folder, values)
    capture = load_capture(folder)
    assert np.isnan(capture.depth_m[0, 5, 5])
    assert capture.depth_m[0, 5, 6] == np.float32(19.999)
    assert any("1 at the largest value" in finding.message for finding in capture.findings)


def test_values_beyond_any_distance_and_a_far_one_that_many_share_are_holes(folder):
    values = np.full((12, 16), 600, np.uint16)
    values[5, 5:8] = 65534, 20001, 19999
    values[:2] = 10000
    set_depth(folder, values)
    capture = load_capture(folder)
    assert np.isnan(capture.depth_m[0, 5, 5:7]).all()
    (missing,) = [f.message for f in capture.findings if f.code == "depth-missing"]
    assert "2 beyond 20 m" in missing
    assert capture.depth_m[0, 5, 7] == np.float32(19.999)
    values[5, 7] = 601
    set_depth(folder, values)
    assert np.isnan(load_capture(folder).depth_m[0, :2]).all()
    assert np.array_equal(load_depth(folder), load_capture(folder).depth_m, equal_nan=True)
    values[:2] = 1100  # a wall without noise
    set_depth(folder, values)
    assert (load_capture(folder).depth_m[0, :2] == np.float32(1.1)).all()


def test_no_depth_on_the_object(folder):
    values = np.full((12, 16), 600, np.uint16)
    values[1:11, 3:13] = 0
    set_depth(folder, values)
    refusal(folder, "depth", "almost no depth on the object", "0.00% measured", "zero")
    (folder / "mask.png").unlink()
    assert "no-mask" in codes(folder)
    set_depth(folder, np.zeros((12, 16), np.uint16))
    refusal(folder, "depth", "no depth at all")


def test_depth_maps_of_different_kinds(folder):
    (folder / "depth" / "001.png").write_bytes(encode_png(np.full((6, 8), 600, np.uint16)))
    refusal(folder, "depth", "000.png 16x12x1 uint16; 001.png 8x6x1 uint16")


def add_depth(folder, *maps_m):
    """More depth maps, after the two that are there."""
    for k, depth_m in enumerate(maps_m, start=2):
        values = np.rint(1000 * np.nan_to_num(depth_m)).astype(np.uint16)
        (folder / "depth" / f"{k:03d}.png").write_bytes(encode_png(values))


def test_a_depth_map_that_contradicts_the_others_is_named(folder):
    depth_m = small_capture().depth_m[0]
    infrared = np.random.default_rng(1).uniform(0.2, 2.0, depth_m.shape)
    for wrong in (2 * depth_m, infrared):
        add_depth(folder, wrong, depth_m)
        refusal(folder, "depth", "contradict each other", " m in 002.png, 0.599 m in the others")
    add_depth(folder, 2 * depth_m, 2 * depth_m)
    line = refusal(folder, "depth", "0.599 m in 000.png", "1.2 m in 003.png")
    assert "the others" not in line


def test_of_two_depth_maps_that_contradict_each_other_none_is_blamed(folder):
    (folder / "depth" / "001.png").unlink()
    add_depth(folder, 5 * small_capture().depth_m[0])
    line = refusal(folder, "depth", "median 0.599 m in 000.png, 3 m in 002.png")
    assert line.endswith("remove what is in another unit, of another view, or no depth")


TURNS = {
    "turned by 180 degrees": (slice(None, None, -1), slice(None, None, -1)),
    "mirrored left to right": (slice(None), slice(None, None, -1)),
    "mirrored top to bottom": (slice(None, None, -1), slice(None)),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("count", [2, 3])
def test_a_depth_map_that_lies_differently_is_named(tmp_path, turn, count):
    rows, columns = np.mgrid[:12, :16]
    slanted = (0.55 + 0.003 * rows + 0.005 * columns).astype(np.float32)
    folder = build(tmp_path / "c", depth_m=np.stack([slanted] * count))
    values = np.rint(1000 * slanted[TURNS[turn]]).astype(np.uint16)
    (folder / "depth" / "001.png").write_bytes(encode_png(values))
    against = "the others" if count > 2 else "000.png"
    refusal(folder, "depth", f"001.png {turn} against {against}")


def test_noise_on_few_pixels_is_no_turned_depth_map():
    depth_m = np.random.default_rng(1).normal(0.6, 0.01, (6, 8))
    check_one_scene(np.stack([depth_m, depth_m[::-1]]), np.ones((6, 8), bool), "depth")


def test_depth_maps_differ_by_noise_drift_holes_and_flying_pixels(folder):
    depth_m = small_capture().depth_m[0]
    noisy = depth_m * np.random.default_rng(1).normal(1.0, 0.04, depth_m.shape)
    torn = np.where(np.arange(16) % 3 == 0, np.nan, depth_m)
    torn[:, ::4] = 3.0
    add_depth(folder, noisy, 1.03 * depth_m, torn, np.full_like(depth_m, np.nan))
    assert len(load_capture(folder).depth_m) == 6


# --- 7, 9, 10: geometry ---


@pytest.mark.parametrize("shape", [(12, 15), (24, 16), (48, 64), (11, 16)])
def test_sizes_that_do_not_fit(folder, shape):
    set_depth(folder, np.full(shape, 600, np.uint16))
    h, w = shape
    refusal(folder, "depth", f"depth {w}x{h}, colour 32x24", "[depth_intrinsics]")


def test_intrinsics_of_another_resolution(tmp_path):
    folder = build(tmp_path / "c")
    for old, new in (
        ("width = 32", "width = 64"),
        ("height = 24", "height = 48"),
        ("fx = 40.0", "fx = 80.0"),
        ("fy = 40.5", "fy = 81.0"),
        ("cx = 15.25", "cx = 31.0"),
        ("cy = 11.75", "cy = 24.0"),
    ):
        edit_config(folder, old, new)
    rescaled = "width = 32, height = 24, fx = 40, fy = 40.5, cx = 15.25, cy = 11.75"
    refusal(folder, "capture.toml", "seen 64x48, needed 32x24", rescaled)


def test_turned_or_cropped_images(folder):
    edit_config(folder, "width = 32\nheight = 24", "width = 24\nheight = 32")
    refusal(folder, "capture.toml", "seen 24x32", "exchanged, or the images were turned")
    edit_config(folder, "width = 24\nheight = 32", "width = 30\nheight = 30")
    refusal(folder, "capture.toml", "other proportions")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("fx = 40.0", "fx = nan", ("'intrinsics.fx' is not a number", "nan")),
        ("cy = 11.75", "cy = inf", ("'intrinsics.cy' is not a number",)),
        ("fx = 40.0", "fx = -40.0", ("'intrinsics.fx' is not positive", "-40")),
        ("fy = 40.5", "fy = 0", ("'intrinsics.fy' is not positive",)),
        ("width = 32", "width = 0", ("'intrinsics.width' is not positive",)),
        ("fx = 40.0", "fx = 1.25", ("'intrinsics.fx' is implausible", "in pixels")),
        ("fx = 40.0", "fx = 400.0", ("fx and fy", "fx = 400, fy = 40.5")),
        ("cx = 15.25", "cx = 40.0", ("principal point", "outside the image", "cx = 40")),
        ("cx = 15.25\ncy = 11.75", "cx = 11.5\ncy = 15.5", ("transposed", "exchange cx and cy")),
        (
            "fx = 40.0\nfy = 40.5\ncx = 15.25\ncy = 11.75",
            "fx = 15.25\nfy = 11.75\ncx = 40.0\ncy = 40.5",
            ("outside the image", "fx, fy and cx, cy look exchanged"),
        ),
    ],
)
def test_implausible_intrinsics(folder, old, new, words):
    edit_config(folder, old, new)
    refusal(folder, "capture.toml", *words)


def test_a_principal_point_far_off_the_middle_is_doubted(folder):
    edit_config(folder, "cx = 15.25", "cx = 7.5")
    assert "off-centre" in codes(folder)
    edit_config(folder, "cx = 7.5", "cx = 11.5")
    assert "off-centre" not in codes(folder)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("fx =", "f_x =", ("unknown key 'intrinsics.f_x'", "did you mean 'fx'?")),
        ("depth_scale", "depthscale", ("unknown key 'depthscale'", "did you mean 'depth_scale'?")),
        ("[intrinsics]", "[intrinsic]", ("unknown key 'intrinsic'", "'intrinsics'")),
        ("cy = 11.75", "cy = 11.75\nlighting = 'ambient'", ("it belongs above the first",)),
        ("encoding", "cx = 3\nencoding", ("unknown key 'cx'", "it belongs in [intrinsics]")),
        ("encoding", "colour = 3\nencoding", ("unknown key 'colour'", "the keys here are")),
        ("fx = 40.0", "fx = 40.0\nfx = 41.0", ("key 'fx' is there twice", "line 9")),
        ("cy = 11.75", "cy = 11.75\n[intrinsics]", ("key '[intrinsics]' is there twice",)),
        ("fx = 40.0\n", "", ("key 'intrinsics.fx' is missing", "for example")),
        ("fx = 40.0", 'fx = "40"', ("key 'intrinsics.fx'", "seen text in quotes, needed a number")),
        ("width = 32", "width = 32.5", ("key 'intrinsics.width'",)),
        ("fx = 40.0", "fx = 40,5", ("fx = 40,5", "Fix: write fx = 40.5")),
        ("cy = ", "lights = 'lights.lp'\ncy = ", ("'intrinsics.lights'", "[lights]")),
        ("cy = ", "distortion = [0.1]\ncy = ", ("seen a list, needed a table", "distortion = {")),
        (
            "[intrinsics]",
            '[lights]\nfile = "C:\\lights.lp"\n[intrinsics]',
            ("line ", "write / in paths"),
        ),
        ("fx = 40.0", "fx = true", ("key 'intrinsics.fx'", "seen true or false")),
        (
            "encoding",
            'register = "yes"\nencoding',
            ("key 'register'", "seen text in quotes, needed true or false"),
        ),
        ("fx = 40.0", "fx = ", ("not valid TOML", "line 8: 'fx ='")),
        ('"linear"', '"sRGB"', ("'encoding' has an unknown value", "did you mean 'srgb'?")),
        ('"linear"', "7", ("'encoding' has an unknown value", "seen 7")),
        ('"moving-lamp"', '"rgb_leds"', ("'lighting'", "did you mean 'rgb-leds'?")),
        ("[intrinsics]", "[depth_to_color]\n[intrinsics]", ("depth_to_color.rotation", "missing")),
        ("encoding", "intrinsics = 5\nencoding", ("'[intrinsics]' is there twice",)),
    ],
)
def test_wrong_keys(folder, old, new, words):
    edit_config(folder, old, new)
    refusal(folder, "capture.toml", *words)


def test_no_intrinsics_or_no_table(folder):
    config = folder / "capture.toml"
    config.write_text("depth_scale = 1000.0")
    refusal(folder, "capture.toml", "key 'intrinsics' is missing", "fx = 525.0")
    config.write_text("depth_scale = 1000.0\nintrinsics = 5")
    refusal(folder, "capture.toml", "key 'intrinsics' has a wrong value", "needed a table")
    config.write_bytes(b"encoding = \xff")
    refusal(folder, "capture.toml", "not UTF-8")
    config.write_text("a = " + "[" * 5000)
    refusal(folder, "capture.toml", "not valid TOML")


def test_windows_text_is_read(folder):
    config = folder / "capture.toml"
    config.write_bytes(b"\xef\xbb\xbf" + config.read_bytes().replace(b"\n", b"\r\n"))
    assert load_capture(folder).camera == small_capture().camera


@pytest.mark.parametrize(
    ("rotation", "translation", "words"),
    [
        (np.diag([1.0, 1, -1]), [0, 0, 0], ("not a rotation", "determinant -1")),
        (np.eye(3) * 1.01, [0, 0, 0], ("not a rotation",)),
        (np.eye(3) * np.nan, [0, 0, 0], ("rotation' is not a number",)),
        (np.eye(3), [25.0, 0, 0], ("translation", "25 m", "not millimetres")),
        (np.eye(3), [np.nan, 0, 0], ("translation' is not a number",)),
        (np.eye(2), [0, 0, 0], ("'depth_to_color.rotation' has a wrong shape", "3x3")),
        (np.eye(3), [0, 0], ("'depth_to_color.translation' has a wrong shape",)),
    ],
)
def test_wrong_transforms(tmp_path, rotation, translation, words):
    capture = small_capture(
        depth_camera=Camera(16, 12, 20.0, 20.0, 7.5, 5.5),
        depth_to_color=RigidTransform(rotation, np.array(translation, float)),
    )
    write_capture(capture, tmp_path / "c")
    refusal(tmp_path / "c", "capture.toml", *words)


def test_transform_and_depth_camera_belong_together(tmp_path):
    capture = small_capture(
        depth_camera=Camera(17, 12, 20.0, 20.0, 7.5, 5.5),
        depth_to_color=RigidTransform(np.eye(3), np.zeros(3)),
    )
    write_capture(capture, tmp_path / "c")
    refusal(tmp_path / "c", "capture.toml", "[depth_intrinsics] is for another image size", "17x12")
    config = tmp_path / "c" / "capture.toml"
    before, after = config.read_text().split("[depth_intrinsics]")
    config.write_text(before + "[depth_to_color]" + after.split("[depth_to_color]")[1])
    refusal(tmp_path / "c", "capture.toml", "[depth_to_color] without [depth_intrinsics]")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ((1.4, 1.0, 2.0), ("depth_noise.sigma_m' is implausible", "1.4 m", "not millimetres")),
        ((0.0, 1.0, 2.0), ("depth_noise.sigma_m' is not positive",)),
        ((1e-300, 1.0, 2.0), ("depth_noise.sigma_m' is implausible", "1e-06 to 0.2 of at_m")),
        ((1e-7, 1.0, 2.0), ("depth_noise.sigma_m' is implausible", "in metres")),
        ((0.2, 1e300, 2.0), ("depth_noise.at_m' is implausible", "0.05 to 20 m")),
        ((1.4, 1000.0, 2.0), ("depth_noise.at_m' is implausible", "1000 m", "in metres")),
        ((1e-4, 0.01, 2.0), ("depth_noise.at_m' is implausible", "in metres")),
        ((np.nan, 1.0, 2.0), ("depth_noise.sigma_m' is not a number",)),
        ((0.001, -1.0, 2.0), ("depth_noise.at_m' is not positive", "metres")),
        ((0.001, 1.0, np.inf), ("depth_noise.growth' is not a number", "power of the depth")),
        ((0.001, 1.0, 9.0), ("depth_noise.growth' is implausible", "0 to 4")),
        ((0.001, 1.0, -1.0), ("depth_noise.growth' is implausible",)),
    ],
)
def test_wrong_depth_noise(tmp_path, values, words):
    write_capture(small_capture(depth_noise=SensorNoise(*values)), tmp_path / "c")
    refusal(tmp_path / "c", "capture.toml", *words)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("[1, 2]", ("key 'exposures': no exposure for each photograph", "seen 2, needed 4")),
        ("[1, 2, 0, 1]", ("key 'exposures': no exposures", "needed numbers above 0")),
        ("[1, 2, inf, 1]", ("key 'exposures': no exposures", "seconds * ISO")),
        ("[1, 2, 1, 1e30]", ("key 'exposures': implausible exposures", "seen 1 to 1e+30")),
        ('["1/30"]', ("exposures", "seen text in quotes, needed a number")),
    ],
)
def test_wrong_exposures(folder, value, words):
    edit_config(folder, "encoding", f"exposures = {value}\nencoding")
    refusal(folder, "capture.toml", *words)


@pytest.mark.parametrize("end", ["\r", "\r\n"])
def test_lines_of_other_systems(folder, end):
    config = folder / "capture.toml"
    config.write_bytes(config.read_bytes().replace(b"\n", end.encode()))
    assert load_capture(folder).camera == small_capture().camera


def test_keys_of_depth_noise(folder):
    config = folder / "capture.toml"
    text = config.read_text()
    config.write_text(text + "\n[depth_noise]\nsigma_mm = 1.4\n")
    refusal(folder, "capture.toml", "unknown key 'depth_noise.sigma_mm'", "'sigma_m'?")
    config.write_text(text + "\n[depth_noise]\nat_m = 1.0\n")
    line = refusal(folder, "capture.toml", "key 'depth_noise.sigma_m' is missing")
    assert line.endswith("for example sigma_m = 0.002 (metres, at at_m), or take the table out")
    config.write_text(text + "\n[depth_to_color]\ntranslation = [0, 0, 0]\n")
    refusal(folder, "capture.toml", "'depth_to_color.rotation' is missing", "example rotation = [[")
    config.write_text(text + "\n[depth_noise]\nsigma_m = 0.002\n")
    assert load_capture(folder).depth_noise == SensorNoise(0.002, 1.0, 2.0)


# --- 11 to 15: photographs ---


def test_the_same_photograph_twice(folder):
    shutil.copy(photograph(folder, 0), photograph(folder, 3))
    refusal(folder, "rgb", "the same photograph twice", "000.png and 003.png", "remove 003.png")
    almost = small_capture().photographs[0].copy()
    almost[3, 5, 1] ^= 1
    photograph(folder, 3).write_bytes(encode_png(almost))
    assert len(load_capture(folder).photographs) == 4


def test_photographs_that_are_all_black(folder):
    black = encode_png(np.zeros_like(small_capture().photographs[0]))
    for index in (1, 3):
        photograph(folder, index).write_bytes(black)
    line = refusal(folder, "rgb", "all black", "seen 001.png, 003.png, needed light in each")
    assert line.endswith("Fix: remove them, or take them again with the lamp on")


@pytest.mark.parametrize(
    ("photographs", "words"),
    [
        ([0, 0, 1, 2], r"a photograph twice .seen \[0, 0, 1, 2\].*Fix: name each"),
        (np.array(3), "these are no numbers of photographs .seen 3"),
        (3, "these are no numbers of photographs .seen 3"),
    ],
)
def test_numbers_of_photographs_that_are_none(folder, photographs, words):
    with pytest.raises(InputError, match=f"^photographs: {words}"):
        load_capture(folder, photographs=photographs)


def test_photographs_of_different_size_or_channels(folder):
    photograph(folder).write_bytes(encode_png(small_capture().photographs[1, :20]))
    refusal(folder, "rgb", "000.png 32x24x3 uint8 and 2 more; 001.png 32x20x3 uint8")
    photograph(folder).write_bytes(encode_png(small_capture().photographs[1, ..., 0].copy()))
    refusal(folder, "rgb", "001.png 32x24x1 uint8", "channels")


def test_8_bit_beside_16_bit(folder):
    photograph(folder).write_bytes(encode_png(small_capture(dtype=np.uint16).photographs[1]))
    refusal(folder, "rgb", "8-bit images beside 16-bit ones", "001.png 32x24x3 uint16")


def test_exif_orientation_is_ignored_with_a_warning(folder):
    rows = [row.tobytes() for row in small_capture().photographs[1]]
    photograph(folder).write_bytes(png(WIDTH, HEIGHT, 8, 2, rows, png_chunk(b"eXIf", exif(6))))
    capture = load_capture(folder)
    warning = next(f for f in capture.findings if f.code == "exif-orientation")
    assert warning.severity == "warning"
    assert "001.png" in warning.message
    np.testing.assert_array_equal(capture.photographs, small_capture().photographs)


def exposed(share, value):
    """Photographs with `value` on this share of the object in all but two of them."""
    capture = small_capture()
    where = np.zeros_like(capture.mask)
    rows, columns = np.nonzero(capture.mask)
    count = round(share * len(rows))
    where[rows[:count], columns[:count]] = True
    capture.photographs[:2, where] = value
    return capture


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ((250, 251, 255), ("saturated", "expose shorter")),
        ((1, 0, 1), ("black", "expose longer")),
    ],
)
def test_too_little_of_the_object_is_usable(tmp_path, value, words):
    write_capture(exposed(0.25, value), tmp_path / "bad")
    refusal(tmp_path / "bad", "rgb", "fewer than 3 usable photographs on 25% of the", *words)
    write_capture(exposed(0.15, value), tmp_path / "good")
    findings = load_capture(tmp_path / "good").findings
    message = next(f.message for f in findings if f.code == words[0])
    assert "7.4% of the object on average, most in 000.png (14.8%)" in message


@pytest.mark.parametrize("value", [(249, 9, 99), (2, 0, 1)])
def test_bright_and_dark_are_usable(tmp_path, value):
    write_capture(exposed(0.25, value), tmp_path / "c")
    assert not {"saturated", "black"} & set(codes(tmp_path / "c"))


def test_a_channel_that_clips_leaves_the_others(tmp_path):
    write_capture(exposed(0.25, (250, 9, 99)), tmp_path / "c")
    found = {finding.code: finding.message for finding in load_capture(tmp_path / "c").findings}
    assert "12.5% of the object on average, most in 000.png (25.0%)" in found["saturated"]


def test_two_photographs_may_be_saturated(tmp_path):
    capture = exposed(1.0, 255)
    capture.photographs[1] -= 1
    write_capture(capture.select([0, 1]), tmp_path / "c")
    assert "saturated" in codes(tmp_path / "c")


# --- 17: mask ---


@pytest.mark.parametrize("colour", [0, 255, "photograph"])
def test_a_cut_out_is_a_mask_where_it_is_not_transparent(folder, colour):
    capture = small_capture()
    colours = np.full((HEIGHT, WIDTH, 3), colour if colour != "photograph" else 0, np.uint8)
    if colour == "photograph":
        colours[:] = capture.photographs[0]
    opaque = np.where(capture.mask, 255, 0).astype(np.uint8)
    (folder / "mask.png").write_bytes(encode_png(np.dstack([colours, opaque])))
    np.testing.assert_array_equal(load_capture(folder).mask, capture.mask)


def transparent(values, bits=8, colour=0, key=b"\0\0", palette=b""):
    """A PNG of (H, W) values; key : what its tRNS holds."""
    dtype = ">u2" if bits == 16 else np.uint8
    rows = [row.astype(dtype) for row in np.repeat(values[..., None], 3 if colour == 2 else 1, -1)]
    packed = [np.packbits(row) if bits == 1 else row for row in rows]
    extra = (png_chunk(b"PLTE", palette) if palette else b"") + png_chunk(b"tRNS", key)
    return png(WIDTH, HEIGHT, bits, colour, [row.tobytes() for row in packed], extra)


WHITE_TWICE = bytes([255] * 6)


@pytest.mark.parametrize(
    "file",
    [
        lambda mask: transparent(mask, colour=3, key=b"\0", palette=WHITE_TWICE),
        lambda mask: transparent(mask, colour=3, key=b"\0\x80", palette=WHITE_TWICE),
        lambda mask: transparent(mask, 1, colour=3, key=b"\0", palette=WHITE_TWICE),
        lambda mask: transparent(np.where(mask, 100, 255), key=b"\0\xff"),
        lambda mask: transparent(~mask, bits=1, key=b"\0\1"),
        lambda mask: transparent(np.where(mask, 511, 255), bits=16, key=b"\0\xff"),
        lambda mask: transparent(np.where(mask, 100, 255), colour=2, key=b"\0\xff" * 3),
        lambda mask: transparent(np.where(mask, 511, 65535), 16, colour=2, key=b"\xff" * 6),
    ],
    ids=["palette", "half", "bits of a palette", "grey", "bits", "grey 16", "colour", "colour 16"],
)
def test_a_cut_out_by_colours_that_are_transparent(folder, file):
    mask = small_capture().mask
    (folder / "mask.png").write_bytes(file(mask))
    np.testing.assert_array_equal(load_capture(folder).mask, mask)


def test_transparent_colours_that_say_nothing_or_are_damaged(folder):
    mask = small_capture().mask
    values = np.where(mask, 255, 0)
    (folder / "mask.png").write_bytes(transparent(values, key=b"\0\x07"))
    np.testing.assert_array_equal(load_capture(folder).mask, mask)
    (folder / "mask.png").write_bytes(transparent(values, key=b"\0"))
    refusal(folder, "mask.png", "the image is damaged", "no valid transparent colour")


@pytest.mark.parametrize("alpha", [0, 255])
def test_a_mask_that_is_transparent_everywhere_or_nowhere_goes_by_its_colours(folder, alpha):
    mask = small_capture().mask
    colours = np.repeat(np.where(mask, 255, 0).astype(np.uint8)[..., None], 3, axis=-1)
    layers = [colours, np.full(mask.shape, alpha, np.uint8)]
    (folder / "mask.png").write_bytes(encode_png(np.dstack(layers)))
    np.testing.assert_array_equal(load_capture(folder).mask, mask)


@pytest.mark.parametrize("wrong", ["mask.jpg", "MASK.TIF", "ambient.JPG", "flat.bmp"])
def test_a_picture_that_would_be_passed_over_for_its_format_is_refused(folder, wrong):
    (folder / wrong).write_bytes(b"whatever is in it")
    name = wrong.split(".")[0].lower() + ".png"
    if name == "mask.png":
        assert load_capture(folder).mask.any()  # a copy beside it is nobody's concern
        (folder / name).unlink()
    refusal(folder, wrong, "not read under this name", f"needed {name}", f"Fix: save it as {name}")


@pytest.mark.parametrize("wrong", ["Capture.toml", "capture.toml.txt"])
def test_a_misnamed_config_is_named(folder, wrong):
    (folder / "capture.toml").rename(folder / wrong)
    if (folder / "capture.toml").exists():
        pytest.skip("capitals do not count on this disk")
    refusal(folder, "", "no capture.toml in it", f"seen {wrong}", "Fix: rename it to capture.toml")


def test_masks(folder):
    mask = folder / "mask.png"
    mask.write_bytes(encode_png(np.zeros((HEIGHT, WIDTH), np.uint8)))
    refusal(folder, "mask.png", "the mask is empty")
    mask.write_bytes(encode_png(np.ones((12, 16), np.uint8)))
    refusal(folder, "mask.png", "another size", "seen 16x12, needed 32x24")
    mask.write_bytes(encode_png(np.ones((HEIGHT, WIDTH), np.uint8)))
    assert "mask-everything" in codes(folder)
    mask.unlink()
    capture = load_capture(folder)
    warning = next(f for f in capture.findings if f.code == "no-mask")
    assert warning.severity == "warning"
    expected = np.isfinite(small_capture().depth_m).any(axis=0).repeat(2, 0).repeat(2, 1)
    assert not expected.all()
    np.testing.assert_array_equal(capture.mask, expected)


def test_coloured_and_palette_masks(folder):
    expected = small_capture().mask
    blue = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    blue[expected, 2] = 1
    (folder / "mask.png").write_bytes(encode_png(blue))
    np.testing.assert_array_equal(load_capture(folder).mask, expected)
    palette = png_chunk(b"PLTE", bytes([9, 9, 9, 0, 0, 0]))
    rows = [(~row).astype(np.uint8).tobytes() for row in expected]
    (folder / "mask.png").write_bytes(png(WIDTH, HEIGHT, 8, 3, rows, palette))
    np.testing.assert_array_equal(load_capture(folder).mask, expected)
    bits = [np.packbits(row).tobytes() for row in expected]
    (folder / "mask.png").write_bytes(png(WIDTH, HEIGHT, 1, 0, bits))
    np.testing.assert_array_equal(load_capture(folder).mask, expected)


@pytest.mark.parametrize("quarters", [-1, 1], ids=["clockwise", "anticlockwise"])
def test_a_calibration_of_turned_images_is_told_that_of_the_stored_ones(tmp_path, quarters):
    """EXIF has viewers, and cv2.imread, turn them; a point that both show has the same ray."""
    stored = Camera(32, 24, 40.0, 40.5, 16.0, 11.0)
    rows, columns = np.rot90(np.mgrid[:24, :32], quarters, axes=(1, 2))
    (cy,), (cx,) = np.nonzero((rows == stored.cy) & (columns == stored.cx))
    told = f"cx = {stored.cx:g}, cy = {stored.cy:g}"
    told += " if it turned them clockwise (orientation 6" if quarters < 0 else ""
    for width, height in ((32, 24), (24, 32)):
        turned = Camera(width, height, stored.fy, stored.fx, float(cx), float(cy))
        with pytest.raises(CaptureError) as caught:
            check_camera(turned, stored.shape, "K.txt", "intrinsics")
        assert "fx = 40, fy = 40.5, and cx" in caught.value.remedy
        assert told in caught.value.remedy
        assert len(caught.value.remedy) < 400  # what is longer is cut


def test_a_turned_calibration_with_a_tangential_lens_is_to_be_made_again():
    lens = Distortion("brown-conrady", [0.1, 0, 0.001, 0])
    turned = Camera(24, 32, 40.5, 40.0, 11.0, 16.0, lens)
    with pytest.raises(CaptureError, match="calibrate with them as they are stored"):
        check_camera(turned, (24, 32), "K.txt", "intrinsics")
