"""faults.md 1-12, 14, 17-20, 31: `rakelight refine` on captures that are wrong."""

import io
import json
import shutil

import cv2
import numpy as np
import pytest
from PIL import Image

from rakelight.capture import load_capture, write_capture
from rakelight.capture.images import decode_image, encode_png, encode_tiff
from rakelight.export import load_result
from rakelight.synthetic import make_shape
from tests.cli.cli_helpers import QUICK, contents, small_scene

IMAGES = ["rgb/002.png", "depth/000.png", "mask.png"]


def pixels(path):
    return decode_image(path.read_bytes())


def edit_config(capture, old, new):
    path = capture / "capture.toml"
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def each_photograph(capture, encode):
    """Replace every photograph (H, W, 3) by the bytes that `encode` makes of it."""
    for path in (capture / "rgb").iterdir():
        path.write_bytes(encode(pixels(path)))


def refined(run, capture, out, *options):
    """Run `refine`, which has to succeed and leave the capture alone; (code, message) findings."""
    before = contents(capture)
    ran = run("refine", capture, "-o", out, "--json", *options)
    assert (ran.code, ran.err) == (0, "")
    assert contents(capture) == before
    return {f["code"]: f["message"] for f in json.loads(ran.out)["findings"]}


# --- 1 to 3: files that are not images, or not whole ---


@pytest.mark.parametrize("file", IMAGES)
@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda whole: b"", "the file is empty"),
        (lambda whole: whole[: len(whole) // 2], "the end of the PNG is missing"),
        (lambda whole: bytes([whole[0] ^ 4]) + whole[1:], "not an image file"),
        (lambda whole: whole[:60] + bytes([whole[60] ^ 4]) + whole[61:], "wrong checksum"),
        (lambda whole: whole[:-12], "the end of the PNG is missing"),
        (lambda whole: b"<!DOCTYPE html><title>404</title>", "HTML"),
    ],
    ids=["empty", "half", "first bit", "bit", "tail", "html"],
)
def test_1_2_3_damaged_images(capture, refine_refused, file, damage, words):
    path = capture / file
    path.write_bytes(damage(path.read_bytes()))
    refine_refused(file, words)


def test_3_jpeg_named_depth_png(capture, refine_refused):
    grey = np.full((18, 24), 90, np.uint8)
    (capture / "depth" / "000.png").write_bytes(cv2.imencode(".jpg", grey)[1].tobytes())
    refine_refused("depth/000.png", "JPEG cannot carry depth", "by its first bytes", "16-bit PNG")


# --- 4 to 6: depth values ---


def test_4_8_bit_depth(capture, refine_refused):
    path = capture / "depth" / "000.png"
    path.write_bytes(encode_png((pixels(path) // 256).astype(np.uint8)))
    refine_refused("depth/000.png", "256 levels cannot carry millimetres", "needed 16-bit PNG")


@pytest.mark.parametrize(
    ("scale", "seen"), [("1.0", "median depth 7.2e+03 m"), ("1000000.0", "median depth 0.0072 m")]
)
def test_5_wrong_depth_unit(capture, refine_refused, scale, seen):
    edit_config(capture, "depth_scale = 10000.0", f"depth_scale = {scale}")
    remedy = "depth_scale = 1000 would make the median 7.2 m, 5000 1.44 m, 10000 0.72 m"
    refine_refused("depth", "the depth unit looks wrong", seen, "needed 0.05 to 20 m", remedy)


def test_5_no_depth_unit(capture, refine_refused):
    edit_config(capture, "depth_scale = 10000.0\n", "")
    refine_refused("capture.toml", "'depth_scale' is missing", "depth_scale = 1000 would make")


def as_float_depth(capture, change):
    """The depth as float TIFF in metres, holes as NaN, after `change` (in place)."""
    path = capture / "depth" / "000.png"
    depth_m = pixels(path).astype(np.float32) / 10_000
    depth_m[depth_m == 0] = np.nan
    change(depth_m)
    path.unlink()
    path.with_suffix(".tiff").write_bytes(encode_tiff(depth_m))
    edit_config(capture, "depth_scale = 10000.0\n", "")


def test_6_invalid_depth_is_a_hole_and_counted(capture, run, tmp_path):
    def spoil(depth_m):
        depth_m[8, 9:14] = 0, -0.7, np.inf, -np.inf, np.nan

    already_nan = 0

    def count_and_spoil(depth_m):
        nonlocal already_nan
        spoil(depth_m)
        on_object = pixels(capture / "mask.png").reshape(18, 2, 24, 2).all(axis=(1, 3))
        already_nan = int(np.isnan(depth_m[on_object]).sum()) - 1

    as_float_depth(capture, count_and_spoil)
    findings = refined(run, capture, tmp_path / "out", *QUICK)
    counts = f"(values: 1 zero, 2 negative, {already_nan + 2} not finite)"
    assert findings["depth-missing"].endswith(counts)
    result = load_result(tmp_path / "out")
    assert np.isfinite(result.depth[16:18, 18:28]).all()
    assert abs(np.nanmedian(result.depth) - 0.74) < 0.02


@pytest.mark.parametrize("value", [0, -0.7, np.inf, np.nan])
def test_6_almost_no_depth(capture, refine_refused, value):
    def spoil(depth_m):
        keep = depth_m[8, 9]
        depth_m[:] = value
        depth_m[8, 9] = keep

    as_float_depth(capture, spoil)
    (capture / "mask.png").write_bytes(encode_png(np.full((36, 48), 255, np.uint8)))
    refine_refused(
        "depth", "almost no depth on the object", "seen 0.23% measured", "needed at least 1%"
    )


# --- 7, 9, 10: geometry ---


@pytest.mark.parametrize("shape", [(18, 23), (17, 24), (24, 18), (36, 24), (72, 96)])
def test_7_sizes_that_do_not_fit(capture, refine_refused, shape):
    h, w = shape
    (capture / "depth" / "000.png").write_bytes(encode_png(np.full(shape, 7400, np.uint16)))
    what = "turned against each other" if shape == (24, 18) else "sizes do not fit"
    refine_refused("depth", what, f"seen depth {w}x{h}, colour 48x36", "[depth_intrinsics]")


def test_9_intrinsics_of_another_resolution(capture, refine_refused):
    edit_config(
        capture,
        "width = 48\nheight = 36\nfx = 90.0\nfy = 90.0\ncx = 23.5\ncy = 17.5",
        "width = 480\nheight = 360\nfx = 900.0\nfy = 900.0\ncx = 239.5\ncy = 179.5",
    )
    rescaled = "width = 48, height = 36, fx = 90, fy = 90, cx = 23.5, cy = 17.5"
    refine_refused("capture.toml", "seen 480x360, needed 48x36", rescaled)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cx = 23.5\ncy = 17.5", "cx = 17.5\ncy = 23.5", ("[intrinsics]", "exchange cx and cy")),
        (
            "fx = 90.0\nfy = 90.0\ncx = 23.5\ncy = 17.5",
            "fx = 23.5\nfy = 17.5\ncx = 90.0\ncy = 90.0",
            ("[intrinsics]", "fx, fy and cx, cy look exchanged"),
        ),
        ("fy = 90.0", "fy = nan", ("'intrinsics.fy' is not a number", "needed pixels")),
        ("fx = 90.0", "focal = 90.0", ("unknown key 'intrinsics.focal'", "the keys here are")),
        ("depth_scale", "depth_units", ("unknown key 'depth_units'", "Fix: ")),
        ("fx = 90.0", "fx = 90.0\nfx = 91.0", ("'fx' is there twice", "keep one of them")),
        ("fx = 90.0\n", "", ("'intrinsics.fx' is missing", "for example")),
    ],
)
def test_10_intrinsics(capture, refine_refused, old, new, words):
    edit_config(capture, old, new)
    refine_refused("capture.toml", *words)


# --- 8, 31: what was shifted ---


@pytest.fixture
def larger(capture):
    """The capture of small_scene, in 192 x 144 pixels: outlines and texture can be compared."""
    shutil.rmtree(capture)
    scene, _ = small_scene(camera=make_shape("sphere").camera.scaled(0.4), photographs=6)
    write_capture(scene, capture, depth_scale=10_000)
    return capture


def shift(path, right, down):
    path.write_bytes(encode_png(np.roll(pixels(path), (down, right), axis=(0, 1))))


def test_8_31_what_lies_on_each_other_is_not_doubted(larger, run, tmp_path):
    assert not {"depth-shifted", "camera-moved"} & set(
        refined(run, larger, tmp_path / "out", *QUICK)
    )


def test_8_depth_shifted_against_the_photographs(larger, run, tmp_path, refine_refused):
    shift(larger / "depth" / "000.png", 3, -2)
    said = refined(run, larger, tmp_path / "out", *QUICK)["depth-shifted"]
    assert said.endswith(
        "not registered to the photographs: shifted by about 7 pixels (6 right, 4 up)"
    )
    shutil.rmtree(tmp_path / "out")
    shift(larger / "depth" / "000.png", 9, 2)
    words = ("not registered", "seen shifted by about 24 pixels (24 right, 0 ", "[depth_to_color]")
    refine_refused("", *words)


def test_31_the_camera_moved(larger, run, tmp_path):
    for name in ("004.png", "005.png"):
        shift(larger / "rgb" / name, -2, 1)
    said = refined(run, larger, tmp_path / "out", *QUICK)["camera-moved"]
    assert "004.png, 005.png shifted by 2." in said
    # Without them, as the remedy says, nothing is left to say.
    kept = refined(run, larger, tmp_path / "kept", "--photographs", "0-3", *QUICK)
    assert "camera-moved" not in kept


# --- 11, 12, 14: photographs ---


def test_11_too_few_photographs(capture, refine_refused):
    for name in ("003.png", "004.png"):
        (capture / "rgb" / name).unlink()
    words = ("too few photographs", "seen 3", "needed at least 4", "Fix: take more photographs")
    refine_refused("", *words, options=QUICK)


def test_11_too_few_of_them_chosen(refine_refused):
    words = ("too few photographs", "seen 3", "needed at least 4")
    refine_refused("", *words, options=(*QUICK, "--photographs", "0-2"))


def test_11_two_photographs_are_told_the_ways_out(run, refine_refused, capture, tmp_path):
    two = ("--photographs", "0-1")
    words = ("too few photographs for multi-light", "seen 2", "the method fusion-like, which takes")
    refine_refused("", *words, options=two)
    refined(run, capture, tmp_path / "out", *two, "--method", "fusion-like")


def test_11_super_resolution_needs_the_square_of_the_scale(run, refine_refused, capture, tmp_path):
    shutil.rmtree(capture)
    scene, truth = small_scene(depth_factor=4)
    write_capture(scene, capture, truth=truth)
    words = ("too few photographs", "at scale 4", "seen 5", "needed at least 16")
    refine_refused("", *words, options=QUICK)
    refined(run, capture, tmp_path / "out", *QUICK, "--scale", "2")
    assert load_result(tmp_path / "out").depth.shape == (18, 24)


def test_11_the_same_photograph_twice(capture, refine_refused):
    shutil.copy(capture / "rgb" / "001.png", capture / "rgb" / "004.png")
    refine_refused("rgb", "the same photograph twice", "001.png and 004.png", "remove 004.png")


def test_12_photographs_of_different_kinds(capture, refine_refused):
    path = capture / "rgb" / "001.png"
    path.write_bytes(encode_png(pixels(path)[:20].copy()))
    path = capture / "rgb" / "003.png"
    path.write_bytes(encode_png(pixels(path)[..., 0].copy()))
    table = (
        "000.png 48x36x3 uint16 and 2 more; 001.png 48x20x3 uint16; 003.png 48x36x1 uint16",
        "needed one size, depth and number of channels",
    )
    refine_refused("rgb", *table)


def test_14_8_bit_beside_16_bit(capture, refine_refused):
    path = capture / "rgb" / "001.png"
    path.write_bytes(encode_png((pixels(path) // 256).astype(np.uint8)))
    refine_refused("rgb", "8-bit images beside 16-bit ones", "001.png 48x36x3 uint8")


# --- 17, 18, 19: masks ---


def test_17_masks_that_are_refused(capture, refine_refused):
    mask = capture / "mask.png"
    mask.write_bytes(encode_png(np.zeros((36, 48), np.uint8)))
    refine_refused("mask.png", "the mask is empty", "needed non-zero = object")
    mask.write_bytes(encode_png(np.ones((18, 24), np.uint8)))
    refine_refused("mask.png", "another size", "seen 24x18, needed 48x36")


def test_17_a_mask_of_everything_is_noted(capture, run, tmp_path):
    def plane_behind(depth_m):
        depth_m[np.isnan(depth_m)] = 0.8

    as_float_depth(capture, plane_behind)
    # What has no depth behind the sphere would be black in every photograph.
    each_photograph(capture, lambda image: encode_png(np.maximum(image, np.uint16(9000))))
    (capture / "mask.png").write_bytes(encode_png(np.full((36, 48), 255, np.uint8)))
    findings = refined(run, capture, tmp_path / "out", *QUICK)
    assert findings["mask-everything"] == "the mask covers the whole image"
    assert np.isfinite(load_result(tmp_path / "out").depth).all()


def test_19_thin_parts_and_single_pixels_keep_the_prepared_depth(capture, run, tmp_path):
    whole = load_capture(capture).mask
    thin = np.zeros_like(whole)
    thin[8, 20:27] = True  # one pixel high
    thin[13:23, 14] = True  # one pixel wide
    thin[[25, 26, 25], [20, 21, 26]] = True  # single pixels, two of them touching at a corner
    broad = np.zeros_like(whole)
    broad[12:23, 17:32] = True
    mask = thin | broad
    assert not (mask & ~whole).any()
    (capture / "mask.png").write_bytes(encode_png(mask.astype(np.uint8)))
    listed = refined(run, capture, tmp_path / "out")["thin-parts"]
    assert "keep the prepared depth: 10 pixels at (" in listed
    assert "7 at (" in listed
    result = load_result(tmp_path / "out")
    np.testing.assert_array_equal(np.isfinite(result.depth), mask)
    assert np.isfinite(result.normals[mask]).all()
    np.testing.assert_allclose(result.depth[thin], result.prepared_depth[thin], rtol=0, atol=1e-6)
    assert np.abs(result.depth - result.prepared_depth)[broad].max() > 1e-4


# --- 20: what a photograph may be ---


def test_20_alpha_is_dropped(capture, run, tmp_path):
    refined(run, capture, tmp_path / "plain", *QUICK)
    opaque = np.full((36, 48, 1), 7, np.uint16)
    each_photograph(capture, lambda image: encode_png(np.dstack([image, opaque])))
    findings = refined(run, capture, tmp_path / "alpha", *QUICK)
    assert findings["alpha-dropped"] == "rgb: alpha channel dropped"
    for name in ("depth.tiff", "albedo.png"):
        alpha, plain = (tmp_path / out / name for out in ("alpha", "plain"))
        assert alpha.read_bytes() == plain.read_bytes()


def test_20_grey_is_repeated(capture, run, tmp_path):
    each_photograph(capture, lambda image: encode_png(image[..., 1].copy()))
    assert "repeated to three channels" in refined(run, capture, tmp_path / "out", *QUICK)["grey"]
    albedo = pixels(tmp_path / "out" / "albedo.png")
    np.testing.assert_array_equal(albedo[..., 0], albedo[..., 2])


def test_20_palettes_are_expanded(capture, run, tmp_path):
    def with_palette(image):
        eight_bit = Image.fromarray((image // 257).astype(np.uint8))
        data = io.BytesIO()
        eight_bit.quantize(256).save(data, "PNG")
        return data.getvalue()

    each_photograph(capture, with_palette)
    refined(run, capture, tmp_path / "out", *QUICK)
    coloured = pixels(tmp_path / "out" / "albedo.png").astype(int)
    assert (coloured[..., 0] != coloured[..., 2]).any()


def test_20_cmyk_is_refused(capture, refine_refused):
    data = io.BytesIO()
    Image.new("CMYK", (48, 36)).save(data, "JPEG")
    (capture / "rgb" / "001.png").write_bytes(data.getvalue())
    refine_refused("rgb/001.png", "seen CMYK, needed 8-bit grey or RGB", "export it as RGB PNG")
