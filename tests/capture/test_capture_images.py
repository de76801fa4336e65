import io
import struct

import cv2
import numpy as np
import pytest
import tifffile
from capture_builder import exif, png, png_chunk

from rakelight.capture.headers import read_header
from rakelight.capture.images import as_rgb, decode_image, encode_png, encode_tiff
from rakelight.errors import CaptureError, InputError

RANDOM = np.random.default_rng(1)
RGB8 = RANDOM.integers(0, 256, (6, 9, 3), np.uint8)


def tiff(pixels, **options):
    file = io.BytesIO()
    tifffile.imwrite(file, pixels, **options)
    return file.getvalue()


def jpeg(pixels):
    return cv2.imencode(".jpg", pixels)[1].tobytes()


def refusal(data, source="rgb/000.png"):
    with pytest.raises(CaptureError) as caught:
        decode_image(data, source)
    assert caught.value.exit_code == 2
    line = str(caught.value)
    assert line.startswith(source)
    assert "\n" not in line
    return line


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3), (5, 7, 4)])
def test_png_comes_back_as_it_was(dtype, shape):
    pixels = RANDOM.integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)
    again = decode_image(encode_png(pixels))
    assert again.dtype == dtype
    np.testing.assert_array_equal(again, pixels)


@pytest.mark.parametrize("shape", [(50, 70), (50, 70, 3)])
def test_float_tiff_comes_back_bit_by_bit(shape):
    pixels = RANDOM.normal(size=shape).astype(np.float32)
    pixels.flat[:4] = np.nan, np.inf, -0.0, 1e-42
    data = encode_tiff(pixels)
    np.testing.assert_array_equal(decode_image(data).view(np.uint32), pixels.view(np.uint32))
    others = tifffile.imread(io.BytesIO(data))  # channels in order for other programs too
    np.testing.assert_array_equal(others, pixels)


@pytest.mark.parametrize(
    "pixels", [RGB8, RGB8.astype(np.uint16) * 250, RGB8[..., 0].astype(np.float64)]
)
def test_tiff_of_other_programs(pixels):
    np.testing.assert_array_equal(decode_image(tiff(pixels)), pixels)


def test_colours_keep_their_order():
    red = np.zeros((2, 2, 3), np.uint8)
    red[..., 0] = 255
    assert tiff(red)
    assert decode_image(tiff(red))[0, 0].tolist() == [255, 0, 0]
    assert decode_image(jpeg(red[..., ::-1]))[0, 0, 0] > 200


def test_grey_with_alpha_and_palette():
    grey_alpha = png(2, 1, 8, 4, [bytes([10, 255, 20, 0])])
    assert decode_image(grey_alpha).tolist() == [[[10, 255], [20, 0]]]
    assert as_rgb(decode_image(grey_alpha)).tolist() == [[[10] * 3, [20] * 3]]
    palette = png_chunk(b"PLTE", bytes([1, 2, 3, 4, 5, 6])) + png_chunk(b"tRNS", b"\0")
    assert decode_image(png(2, 1, 8, 3, [b"\1\0"], palette)).tolist() == [[[4, 5, 6], [1, 2, 3]]]


@pytest.mark.parametrize("orientation", [3, 6])
def test_orientation_is_seen_and_ignored(orientation):
    tag = exif(orientation)
    app1 = b"\xff\xe1" + struct.pack(">H", len(tag) + 8) + b"Exif\0\0" + tag
    plain = jpeg(RGB8)
    turned = plain[:2] + app1 + plain[2:]
    tagged_tiff = tiff(RGB8, extratags=[(274, "H", 1, orientation, True)])
    rows = [row.tobytes() for row in RGB8]
    tagged_png = png(9, 6, 8, 2, rows, png_chunk(b"eXIf", tag))
    for data, expected in (
        (turned, decode_image(plain)),
        (tagged_tiff, RGB8),
        (tagged_png, RGB8),
    ):
        assert read_header(data).orientation == orientation
        np.testing.assert_array_equal(decode_image(data), expected)


def test_every_cut_and_every_flipped_bit_of_a_png_is_seen():
    data = encode_png(RGB8)
    for length in range(len(data)):
        assert refusal(data[:length])
    for at in range(len(data)):
        flipped = bytearray(data)
        flipped[at] ^= 0x10
        assert refusal(bytes(flipped))


def test_damaged_deflate_of_a_tiff_is_seen():
    data = encode_tiff(RANDOM.normal(size=(40, 50)).astype(np.float32))
    assert "contradict themselves" in refusal(data[:3000] + bytes(20) + data[3020:])


@pytest.mark.parametrize("data", [tiff(RGB8), encode_tiff(RGB8.astype(np.float32)), jpeg(RGB8)])
def test_cut_tiff_and_jpeg_are_seen(data, capfd):
    for length in range(len(data) - 2):
        try:
            decoded = decode_image(data[:length])
        except CaptureError:
            continue
        # tifffile puts its tags first and pads the end: what was cut was not needed.
        np.testing.assert_array_equal(decoded, decode_image(data))
    assert capfd.readouterr() == ("", "")


def test_flipped_bits_of_a_tiff_do_no_harm():
    data = tiff(RGB8)
    for at in range(len(data) - RGB8.size):
        for bit in range(8):
            flipped = bytearray(data)
            flipped[at] ^= 1 << bit
            try:
                decode_image(bytes(flipped))
            except CaptureError as error:
                assert error.exit_code == 2  # noqa: PT017


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "empty"),
        (b"<!DOCTYPE html><html>", "HTML"),
        (b"\n <svg", "HTML or XML"),
        (b"version https://git-lfs.github.com/spec/v1", "git lfs pull"),
        (b"GIF89a", "GIF"),
        (b"\0\0\0\x18ftypheic", "HEIC"),
        (b"\x1b[31mred", r"\x1b[31mre"),
        (tiff(RGB8, bigtiff=True), "BigTIFF"),
        (tiff(np.dstack([RGB8, RGB8[..., :1]]), photometric="separated"), "photometric 5"),
        (tiff(np.dstack([RGB8, RGB8[..., :1]]), extrasamples=["unassalpha"]), "4 channels"),
        (tiff(RGB8[..., 0], photometric="miniswhite"), "photometric 0"),
        (tiff(RGB8[..., 0] > 9), "1 bit"),
        (jpeg(RGB8).replace(b"\x08\0\x06\0\x09\x03", b"\x08\0\x06\0\x09\x04"), "CMYK"),
    ],
)
def test_refused_files(data, words):
    assert words in refusal(data)


def test_size_bombs_are_refused_by_their_header():
    side = 100_000
    bomb = png(side, side, 8, 2, [])
    assert "100000x100000" in refusal(bomb)
    assert "100 megapixels" in refusal(bomb)
    frame = jpeg(RGB8)
    at = frame.index(b"\xff\xc0") + 5
    assert "60000x60000" in refusal(frame[:at] + struct.pack(">HH", 60000, 60000) + frame[at + 4 :])
    entries = struct.pack("<HHIIHHII", 256, 4, 1, side, 257, 4, 1, side)
    assert "megapixels" in refusal(b"II*\0" + struct.pack("<IH", 8, 2) + entries + bytes(4))


def test_a_lying_tag_count_allocates_nothing():
    entry = struct.pack("<HHII", 273, 4, 0xFFFFFFFF, 8)
    refusal(b"II*\0" + struct.pack("<IH", 8, 1) + entry + bytes(4))


@pytest.mark.parametrize("pixels", [RGB8.astype(float), RGB8[..., :2], RGB8[:0]])
def test_what_is_no_image_is_not_encoded(pixels):
    for encode in (encode_png, encode_tiff):
        with pytest.raises(InputError, match="not written"):
            encode(pixels)
