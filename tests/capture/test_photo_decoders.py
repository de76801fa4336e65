"""HEIC, raw, EXR, PFM and NPY files: known values in, the same values out; damage is refused."""

import io
import os
from contextlib import suppress
from random import Random

import numpy as np
import pytest

from rakelight.capture.decoder_process import DecoderProcess
from rakelight.capture.exr import read_exr_header
from rakelight.capture.npy import decode_npy
from rakelight.capture.pfm import decode_pfm
from rakelight.errors import CaptureError, InputError
from tests.capture.photo_files import dng, exr, heic, mosaic_of, pfm
from tests.faults.mutations import mutated


@pytest.fixture(scope="module")
def decoder():
    with DecoderProcess() as started:
        yield started


def patches(side=16):
    """Light (4 side, 6 side, 3): patches of even colour."""
    random = np.random.default_rng(3)
    return random.uniform(0.05, 0.6, (4, 6, 3)).repeat(side, 0).repeat(side, 1)


@pytest.mark.parametrize("half", [True, False])
def test_raw_is_linear(decoder, half):
    light = patches()
    for brightest in (1.0, 0.4):  # the factor is not that of the brightest pixel
        file = dng(mosaic_of(brightest * light), black=1000, white=16000)
        pixels = decoder.decode("raw", file, "a.dng", half=half).arrays["pixels"]
        step = 8 if half else 16
        assert pixels.shape == ((32, 48, 3) if half else (64, 96, 3))
        middles = pixels[step // 2 :: step, step // 2 :: step] / 65535
        assert np.abs(middles - brightest * light[8::16, 8::16]).max() < 3e-4


def test_what_clips_on_the_sensor_is_saturated_after_white_balance(decoder):
    light = np.tile(np.array([0.2, 0.4, 0.3]), (32, 32, 1))
    light[:16] *= 10
    file = dng(mosaic_of(light), 1000, 16000, neutral=(0.5, 1.0, 0.8), orientation=6)
    made = decoder.decode("raw", file, "a.dng")
    assert made.facts["white_balance"] == pytest.approx([2, 1, 1.25, 1], rel=1e-3)
    assert made.facts["flip"] != 0
    pixels = made.arrays["pixels"]
    assert pixels.shape == (32, 32, 3)  # as stored
    assert (pixels[:14] == 65535).all()
    assert pixels[24, 16] / 65535 == pytest.approx([0.4, 0.4, 0.375], abs=3e-4)
    other = dng(mosaic_of(light), 1000, 16000, neutral=(1.0, 1.0, 1.0))
    same = decoder.decode("raw", other, "b.dng", white_balance=made.facts["white_balance"])
    assert np.array_equal(same.arrays["pixels"], pixels)


def test_heic_of_8_and_10_bits(decoder):
    random = np.random.default_rng(0)
    eight = random.integers(0, 256, (4, 6, 3), np.uint8).repeat(8, 0).repeat(8, 1)
    made = decoder.decode("heic", heic(eight), "a.heic")
    assert made.arrays["pixels"].dtype == np.uint8
    assert np.abs(made.arrays["pixels"].astype(int) - eight).max() <= 2  # YCbCr
    ten = (eight.astype(np.uint16) * 257) & 0xFFC0
    made = decoder.decode("heic", heic(ten), "a.heic")
    assert made.arrays["pixels"].dtype == np.uint16
    assert np.abs(made.arrays["pixels"].astype(int) - ten).max() <= 3 * 64


def test_exr_color_and_depth(decoder, tmp_path):
    color = patches(2).astype(np.float16)
    depth = patches(2)[..., 0].astype(np.float32)
    exr(tmp_path / "a.exr", RGB=color, Z=depth)
    data = (tmp_path / "a.exr").read_bytes()
    header = read_exr_header(data)
    assert (header.width, header.height, header.color, header.depth) == (12, 8, tuple("RGB"), "Z")
    arrays = decoder.decode("exr", data, "a.exr").arrays
    assert np.array_equal(arrays["color"], color.astype(np.float32))
    assert np.array_equal(arrays["depth"], depth)


@pytest.mark.parametrize(
    ("left", "top", "at"),
    [(0, 0, (0, 0)), (4, 2, (0, 0)), (4, 2, (7, -9)), (-4, -2, (0, 0)), (8, -6, (3, 3)),
     (30, 0, (0, 0)), (0, -30, (0, 0))],
)  # fmt: skip
def test_exr_whose_data_are_a_part_of_the_picture_or_more(decoder, tmp_path, left, top, at):
    """Programs cut off what is empty, or render beyond the edges; `at` is the picture's corner."""
    width, height, (x, y) = 16, 10, at
    data_window = x + left, y + top, x + left + 11, y + top + 7
    depth = 1 + patches(2)[..., 0].astype(np.float32)
    windows = data_window, (x, y, x + width - 1, y + height - 1)
    exr(tmp_path / "a.exr", RGB=np.dstack([depth] * 3), Z=depth, windows=windows)
    data = (tmp_path / "a.exr").read_bytes()
    header = read_exr_header(data)
    assert (header.width, header.height) == (width, height)
    wide = np.pad(depth, 40)  # the picture with a border of 40
    want = wide[40 - top : 40 - top + height, 40 - left : 40 - left + width]
    arrays = decoder.decode("exr", data, "a.exr").arrays
    np.testing.assert_array_equal(arrays["depth"], want)
    np.testing.assert_array_equal(arrays["color"], np.dstack([want] * 3))


def test_exr_of_a_picture_that_is_too_large(tmp_path):
    windows = (0, 0, 11, 7), (0, 0, 99_999, 99_999)
    exr(tmp_path / "a.exr", Z=patches(2)[..., 0].astype(np.float32), windows=windows)
    with pytest.raises(CaptureError, match="too large"):
        read_exr_header((tmp_path / "a.exr").read_bytes())


def test_pfm_and_npy():
    depth = np.arange(6, dtype=np.float32).reshape(2, 3)
    assert np.array_equal(decode_pfm(pfm(depth)), depth)
    file = io.BytesIO()
    np.save(file, np.asfortranarray(depth))
    assert np.array_equal(decode_npy(file.getvalue()), depth)
    file = io.BytesIO()
    np.save(file, np.array([[None]]), allow_pickle=True)
    with pytest.raises(InputError, match="not an image of numbers"):
        decode_npy(file.getvalue())
    with pytest.raises(CaptureError, match="too large"):
        decode_pfm(b"Pf\n99999 99999\n-1.0\n")


def test_pixels_that_openexr_cannot_unpack_are_no_zeros(decoder, tmp_path):
    exr(tmp_path / "a.exr", RGB=patches(8).astype(np.float32))
    data = bytearray((tmp_path / "a.exr").read_bytes())
    data[-200:-100] = bytes(100)
    with pytest.raises(CaptureError, match=r"a\.exr: the image is damaged"):
        decoder.decode("exr", bytes(data), "a.exr")


def test_a_decoder_that_hangs_or_dies_is_a_damaged_file():
    file = dng(mosaic_of(patches()))
    with DecoderProcess(seconds=0.0) as decoder, pytest.raises(CaptureError, match="ended over it"):
        decoder.decode("raw", file, "a.dng")
    with DecoderProcess() as decoder:
        decoder.decode("raw", file, "a.dng")
        os.kill(decoder._child.pid, 9)
        with pytest.raises(CaptureError, match="ended over it"):
            decoder.decode("raw", file, "a.dng")
        assert "pixels" in decoder.decode("raw", file, "a.dng").arrays  # by a new one


def test_damaged_files_are_read_or_refused(decoder, tmp_path, capfd):
    random = np.random.default_rng(0)
    exr(tmp_path / "a.exr", RGB=random.random((12, 16, 3), np.float32))
    sound = {
        "raw": dng(random.integers(1000, 16000, (24, 32)).astype(np.uint16), 1000, 16000),
        "heic": heic(random.integers(0, 256, (24, 32, 3)).astype(np.uint8)),
        "exr": (tmp_path / "a.exr").read_bytes(),
    }
    for kind, data in sound.items():
        seen = {"read": 0, "refused": 0}
        for case in range(150):
            damaged = mutated(Random(f"{kind} {case}"), data, sound["raw"])
            try:
                decoder.decode(kind, damaged, f"a.{kind}")
                seen["read"] += 1
            except InputError as error:
                seen["refused"] += str(error).isprintable()
        assert min(seen.values()) > 10, (kind, seen)
        assert sum(seen.values()) == 150
    assert capfd.readouterr() == ("", "")


def test_damaged_arrays_are_read_or_refused():
    depth = np.arange(48, dtype=np.float32).reshape(6, 8)
    file = io.BytesIO()
    np.save(file, depth)
    for decode, data in ((decode_pfm, pfm(depth)), (decode_npy, file.getvalue())):
        for case in range(300):
            with suppress(InputError):
                assert decode(mutated(Random(case), data, data)).ndim == 2
