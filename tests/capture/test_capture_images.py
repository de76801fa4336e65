import io
import struct
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from rakelight.capture.headers import read_header
from rakelight.capture.images import as_rgb, decode_image, encode_png, encode_tiff
from rakelight.errors import CaptureError, InputError
from tests.capture.capture_builder import exif, png, png_chunk

RANDOM = np.random.default_rng(1)
ADAM7 = (  # first column and row of each pass of an interlaced PNG, steps along both
    (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)
)  # fmt: skip
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
    assert "compressed pixels" in refusal(data[:3000] + bytes(20) + data[3020:])


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


def read_or_refused(data):
    """The pixels, None where the file is refused; nothing else may happen."""
    try:
        return decode_image(data)
    except CaptureError:
        return None


def test_flipped_bits_of_a_tiff_are_refused_or_harmless():
    """In the tags: what is read has the size of a part of the image, never more than the file."""
    data = tiff(RGB8)
    for at in range(len(data) - RGB8.size):
        for bit in range(8):
            flipped = bytearray(data)
            flipped[at] ^= 1 << bit
            decoded = read_or_refused(bytes(flipped))
            assert decoded is None or decoded.nbytes <= len(data)


# --- every kind of file that other programs write: as OpenCV reads it, or better ---

SMOOTH = (120 + 90 * np.sin(np.mgrid[:61, :83, :3].sum(axis=0) / 9)).astype(np.uint8)
NOISY = RANDOM.integers(0, 65536, (61, 83, 3), np.uint16)
FLAT = np.zeros((300, 400, 3), np.uint8)
FLAT[50:200, 30:300] = 200
NONE, LZW, DEFLATE, PACKBITS = 1, 5, 8, 32773


def opencv(data):
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return pixels if pixels.ndim == 2 else pixels[..., ::-1]


def libtiff(pixels, compression=LZW, predictor=1, rows=16):
    """A TIFF as libtiff, in OpenCV, writes it."""
    options = {
        cv2.IMWRITE_TIFF_COMPRESSION: compression,
        cv2.IMWRITE_TIFF_PREDICTOR: predictor,
        cv2.IMWRITE_TIFF_ROWSPERSTRIP: rows,
    }
    turned = np.ascontiguousarray(pixels[..., ::-1] if pixels.ndim == 3 else pixels)
    return cv2.imencode(".tiff", turned, [n for pair in options.items() for n in pair])[1].tobytes()


@pytest.mark.parametrize("rows", [1, 16, 200])
@pytest.mark.parametrize("compression", [NONE, LZW, DEFLATE, PACKBITS])
def test_strips_are_read_as_they_were_written(compression, rows):
    floats = (NOISY / 65535).astype(np.float32)
    for pixels in (SMOOTH, NOISY, FLAT, floats, NOISY[..., 0].copy(), floats[..., 0].astype(float)):
        predictors = (1, 3) if pixels.dtype.kind == "f" else (1, 2)
        for predictor in predictors if compression in (LZW, DEFLATE) else (1,):
            data = libtiff(pixels, compression, predictor, rows)
            np.testing.assert_array_equal(decode_image(data), pixels)
            np.testing.assert_array_equal(decode_image(data), opencv(data))


@pytest.mark.parametrize("byteorder", ["<", ">"])
@pytest.mark.parametrize("options", [{}, {"compression": "zlib"}])
@pytest.mark.parametrize("layout", [{}, {"tile": (32, 16)}, {"rowsperstrip": 9}])
def test_tiles_and_byte_orders(options, layout, byteorder):
    for pixels in (SMOOTH, NOISY, NOISY[..., 0], NOISY[..., 1].astype(np.int16)):
        colour = {"photometric": "rgb"} if pixels.ndim == 3 else {}
        data = tiff(pixels, byteorder=byteorder, **options, **layout, **colour)
        np.testing.assert_array_equal(decode_image(data), pixels)


@pytest.mark.parametrize("layout", [{}, {"tile": (32, 16)}, {"compression": "zlib"}])
def test_channels_that_lie_apart(layout):
    """OpenCV mixes their bytes up, without a word."""
    apart = np.ascontiguousarray(np.moveaxis(NOISY, 2, 0))
    data = tiff(apart, photometric="rgb", planarconfig="separate", **layout)
    np.testing.assert_array_equal(decode_image(data), NOISY)


@pytest.mark.parametrize("subsampling", [0, 1, 2])
@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("quality", [30, 90, 100])
def test_jpeg_is_read_as_opencv_does(quality, progressive, subsampling):
    for pixels in (SMOOTH, SMOOTH[..., 0], FLAT):
        file = io.BytesIO()
        options = {} if pixels.ndim == 2 else {"subsampling": subsampling}
        image = Image.fromarray(pixels)
        image.save(file, "JPEG", quality=quality, progressive=progressive, **options)
        np.testing.assert_array_equal(decode_image(file.getvalue()), opencv(file.getvalue()))


@pytest.mark.parametrize(
    ("bits", "colour_type", "channels"), [(4, 3, 1), (8, 0, 1), (1, 0, 1), (16, 4, 2)]
)
@pytest.mark.parametrize("side", [1, 2, 5, 61])
def test_interlaced_and_packed_png(bits, colour_type, channels, side):
    """Every pass of an interlaced image, small ones that leave passes out included."""
    palette = png_chunk(b"PLTE", bytes(range(48))) if colour_type == 3 else b""
    values = b""
    for left, top, across, down in ADAM7:
        columns, rows = len(range(left, side, across)), len(range(top, side, down))
        if columns:
            values += rows * (b"\0" + RANDOM.bytes((columns * bits * channels + 7) // 8))
    header = struct.pack(">IIBBBBB", side, side, bits, colour_type, 0, 0, 1)
    chunks = (png_chunk(b"IDAT", zlib.compress(values)), png_chunk(b"IEND", b""))
    data = b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", header) + palette + b"".join(chunks)
    expected = opencv(data)
    if channels == 2:
        expected = expected[..., [1, 0]]  # alpha, grey, grey, grey
    np.testing.assert_array_equal(decode_image(data), expected)
    short = png_chunk(b"IDAT", zlib.compress(values[:-1]))
    assert "size" in refusal(data.replace(chunks[0], short))


# --- damaged, and seen to be ---


def flips_refused(data, count=100, start=0):
    """How many of `count` bits, flipped one at a time, make the file be refused."""
    refused = 0
    for bit in np.random.default_rng(3).integers(8 * start, 8 * len(data), count):
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        refused += read_or_refused(bytes(flipped)) is None
    return refused


@pytest.mark.parametrize("progressive", [False, True])
@pytest.mark.parametrize("restarts", [0, 2])
def test_half_a_jpeg_with_an_end_marker(progressive, restarts, capfd):
    file = io.BytesIO()
    options = {"restart_marker_blocks": restarts} if restarts else {}
    Image.fromarray(FLAT + np.resize(SMOOTH, FLAT.shape) // 8).save(
        file, "JPEG", quality=95, progressive=progressive, **options
    )
    data = file.getvalue()
    assert "Corrupt JPEG data" in refusal(data[: len(data) // 2] + b"\xff\xd9")
    assert capfd.readouterr() == ("", "")


def test_flipped_bits_of_a_jpeg(capfd):
    """A code that became another code cannot be told; what loses its place in the data can."""
    file = io.BytesIO()
    Image.fromarray(SMOOTH).save(file, "JPEG", quality=95)
    assert flips_refused(file.getvalue(), 300, file.getvalue().index(b"\xff\xda")) > 30
    assert capfd.readouterr() == ("", "")


def test_a_jpeg_that_only_keeps_a_decoder_busy():
    file = io.BytesIO()
    Image.fromarray(SMOOTH).save(file, "JPEG", progressive=True)
    data = file.getvalue()
    last = data[data.rindex(b"\xff\xda") : -2]
    assert "200 scans" in refusal(data[:-2] + last * 200 + b"\xff\xd9")


@pytest.mark.parametrize("progressive", [False, True])
def test_what_follows_the_end_of_a_jpeg_is_no_part_of_it(progressive):
    """A phone's motion photo is a JPEG with its video behind it, in which any bytes may be."""
    file = io.BytesIO()
    Image.fromarray(SMOOTH).save(file, "JPEG", quality=95, progressive=progressive)
    data = file.getvalue()
    moving = data + b"\0\0\0\x1cftypisom" + b"\xff\xda\xff\xd9" * 300
    np.testing.assert_array_equal(decode_image(moving), decode_image(data))
    assert "the end of the JPEG is missing" in refusal(data[:-2])


def tags_alone(width, height, compression, tile, offsets, counts):
    """A grey TIFF of 8 bit in tiles, without its pixels."""
    tags = {
        256: [width], 257: [height], 258: [8], 259: [compression], 262: [1], 277: [1],
        322: [tile], 323: [tile], 324: offsets, 325: counts,
    }  # fmt: skip
    start, entries, long = 8 + 2 + 12 * len(tags) + 4, b"", b""
    for tag, values in tags.items():
        body = struct.pack(f"<{len(values)}I", *values)
        if len(body) > 4:
            body, long = struct.pack("<I", start + len(long)), long + body
        entries += struct.pack("<HHI", tag, 4, len(values)) + body
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4) + long


def test_a_tiff_that_states_more_tiles_than_it_has_is_refused_at_once():
    data = tags_alone(10_000, 10_000, 1, 1, [8], [1])
    tracemalloc.start()
    try:
        assert "strips or tiles are missing" in refusal(data)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()


def test_tiles_that_lie_in_each_other_are_refused():
    """Unpacking them takes their number times the size of the file."""
    tile = zlib.compress(bytes(256)) + bytes(10_000)
    data = tags_alone(160, 160, 8, 16, [0] * 100, [len(tile)] * 100)
    data = tags_alone(160, 160, 8, 16, [len(data)] * 100, [len(tile)] * 100) + tile
    assert "strips or tiles lie in each other" in refusal(data)


def test_a_count_that_reaches_beyond_the_file_is_no_such_tile():
    data = tags_alone(16, 16, 8, 16, [0], [0])
    tile = zlib.compress(bytes(range(256)))
    data = tags_alone(16, 16, 8, 16, [len(data)], [10**9]) + tile
    assert decode_image(data).ravel().tolist() == list(range(256))


def test_every_flipped_bit_of_deflate_in_tiles_is_seen():
    data = tiff(NOISY, tile=(16, 16), compression="zlib")
    start = len(data) - len(zlib.compress(NOISY[:16, :16].tobytes()))
    assert flips_refused(data, 200, start) == 200


def test_damaged_lzw_is_seen():
    data = libtiff(SMOOTH, LZW, 1, 200)
    assert flips_refused(data, 200) > 50
    assert refusal(data.replace(data[500:520], bytes(20)))
    # Its bytes in the other order, as before TIFF 6.
    assert refusal(data.replace(b"\x80", b"\0\1", 1))


def test_damaged_packbits_is_seen():
    data = libtiff(FLAT, PACKBITS, 1, 200)
    assert flips_refused(data, 200) > 50


def tiff_of(*images, subfile=0, size=slice(None)):
    file = io.BytesIO()
    with tifffile.TiffWriter(file) as writer:
        for i, image in enumerate(images):
            if i and subfile == 4:
                writer.write(image[size] > 3, photometric="mask", subfiletype=subfile)
            elif i:
                writer.write(image[size], photometric="minisblack", subfiletype=subfile)
            else:
                writer.write(image, photometric="minisblack")
    return file.getvalue()


@pytest.mark.parametrize("kind", [0, 2])
def test_a_tiff_of_several_images_is_refused(kind):
    image = np.arange(12, dtype=np.uint16).reshape(3, 4)
    with pytest.raises(CaptureError, match=r"s\.tif: several images in one TIFF .* second of 4x3"):
        read_header(tiff_of(image, image + 1, subfile=kind), "s.tif")


@pytest.mark.parametrize(
    ("kind", "size"), [(1, slice(None)), (4, slice(None)), (0, slice(1)), (1, slice(1))]
)
def test_previews_and_masks_in_a_tiff_are_no_images(kind, size):
    image = np.arange(12, dtype=np.uint16).reshape(3, 4)
    data = tiff_of(image, image + 1, subfile=kind, size=size)
    np.testing.assert_array_equal(decode_image(data), image)


def test_what_follows_a_tiff_where_no_image_can_be_is_nothing():
    image = np.arange(12, dtype=np.uint16).reshape(3, 4)
    data = bytearray(tiff_of(image))
    at = int.from_bytes(data[4:8], "little")
    after = at + 2 + 12 * int.from_bytes(data[at : at + 2], "little")
    assert data[after : after + 4] == bytes(4)
    for place in (len(data), 0xFFFFFFFF):
        data[after : after + 4] = place.to_bytes(4, "little")
        np.testing.assert_array_equal(decode_image(bytes(data)), image)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"II+\0" + bytes(60), r"seen a BigTIFF.*Fix: export it as PNG"),
        (tiff(np.zeros((3, 4), np.float16)), "1 channels of 16 bit, floating point"),
    ],
    ids=["BigTIFF", "half"],
)
def test_tiffs_that_are_not_read_are_told_what_they_are(data, words):
    with pytest.raises(CaptureError, match=words):
        read_header(data, "d.tif")


def test_jpeg_inside_tiff_is_refused():
    file = io.BytesIO()
    Image.fromarray(SMOOTH[..., 0]).save(file, "TIFF", compression="jpeg")
    line = refusal(file.getvalue())
    assert "compression JPEG" in line
    assert "needed none, deflate, LZW or PackBits" in line


def test_png_without_a_sound_palette(capfd):
    rows = [b"\1\0"]
    for palette in (b"", png_chunk(b"PLTE", bytes(5)), 2 * png_chunk(b"PLTE", bytes(6))):
        assert "palette" in refusal(png(2, 1, 8, 3, rows, palette))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("row", [b"\5\0\0", b"\xff\0\0"])
def test_png_with_a_filter_that_does_not_exist(row, capfd):
    data = png(1, 1, 16, 0, [b"\0\0"])
    at, end = data.index(b"IDAT") - 4, data.index(b"IEND") - 4
    refusal(data[:at] + png_chunk(b"IDAT", zlib.compress(row)) + data[end:])
    assert capfd.readouterr() == ("", "")


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
