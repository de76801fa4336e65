"""Grey levels that mean something else: a mask's soft edge, 12 bits in a file of 16."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rakelight.capture import load_capture, write_capture
from rakelight.capture.images import decode_image, encode_jpeg, encode_png, encode_tiff
from rakelight.errors import CaptureError
from rakelight.model import Capture
from tests.capture.capture_builder import build, codes, small_capture
from tests.capture.readers.test_photographs import fill

MASK = small_capture().mask
WHITE = MASK.astype(np.uint8) * 255
BLURRED = cv2.GaussianBlur(WHITE, (0, 0), 2.0)
THROUGH_JPEG = np.maximum(decode_image(encode_jpeg(WHITE, 50)), 0)


@pytest.mark.parametrize(
    ("values", "soft"),
    [
        (BLURRED, True),
        (BLURRED.astype(np.uint16) * 257, True),
        (np.dstack([BLURRED // 3, BLURRED, BLURRED // 2]), True),
        (np.dstack([WHITE | 255] * 3 + [BLURRED]), True),
        (THROUGH_JPEG, True),
        (WHITE, False),
        (MASK.astype(np.uint8), False),
        (np.where(MASK, 200, 60).astype(np.uint8), False),
        (BLURRED // 8, False),
        (np.where(MASK, 255, BLURRED // 30 * 30 * (BLURRED > 200)).astype(np.uint8), False),
    ],
    ids=[
        *("8 bit", "16 bit", "colour", "cut-out", "JPEG's noise", "sharp", "of 1", "labels"),
        *("dark", "a narrow edge"),
    ],
)
def test_a_soft_mask_is_told_of(tmp_path, values, soft):
    path = build(tmp_path / "c")
    (path / "mask.png").write_bytes(encode_png(values))
    assert ("mask-soft" in codes(path)) == soft
    fill(tmp_path / "loose")
    (tmp_path / "loose/mask.png").write_bytes(encode_png(values))
    capture = load_capture(tmp_path / "loose")
    assert ("mask-soft" in [finding.code for finding in capture.findings]) == soft


@pytest.mark.parametrize(("values", "soft"), [(BLURRED, True), (WHITE, False)])
def test_a_soft_mask_in_floating_point_is_told_of_as_well(tmp_path, values, soft):
    fill(tmp_path)
    (tmp_path / "mask.tiff").write_bytes(encode_tiff(values.astype(np.float32) / 255))
    capture = load_capture(tmp_path)
    assert np.array_equal(capture.mask, values > 0)
    assert ("mask-soft" in [finding.code for finding in capture.findings]) == soft


@pytest.mark.parametrize(
    ("mask", "soft"),
    [
        (BLURRED, True),
        (BLURRED / 255, True),
        (BLURRED.astype(int), True),
        (WHITE, False),
        (MASK, False),
        (MASK * 0.5, False),
        (np.where(MASK, 1 + np.arange(MASK.size).reshape(MASK.shape) % 4, 0), False),
        (BLURRED // 8, False),
    ],
    ids=["8 bit", "0 to 1", "int64", "sharp", "bool", "one half", "labels", "dark"],
)
def test_a_soft_mask_among_arrays_is_told_of(mask, soft):
    given = small_capture()
    capture = Capture.from_arrays(given.photographs, given.depth_m, given.camera, mask=mask)
    assert ("mask-soft" in [finding.code for finding in capture.findings]) == soft


def of_fewer_bits(bits):
    """(4, H, W, 3) uint16 of `bits`, a few of them saturated."""
    values = small_capture(dtype=np.uint16).photographs >> (16 - bits)
    values[:, 10, 10:14] = 2**bits - 1
    return values


def loaded(path, photographs):
    """The capture of a folder whose photographs are exchanged for these, and its findings."""
    build(path, dtype=np.uint16, photographs=len(photographs))
    for i, pixels in enumerate(photographs):
        (path / f"rgb/{i:03d}.png").write_bytes(encode_png(pixels))
    capture = load_capture(path)
    return capture, {finding.code: finding for finding in capture.findings}


@pytest.mark.parametrize("bits", [9, 10, 12, 14, 15, 16])
def test_values_of_fewer_bits_are_those_of_16(tmp_path, bits):
    values = of_fewer_bits(bits)
    capture, found = loaded(tmp_path / "c", values)
    wanted = np.rint(values * (65535 / (2**bits - 1)))
    assert np.array_equal(capture.photographs, wanted)
    assert ("range-stretched" in found) == (bits < 16)
    assert "narrow-range" not in found
    assert np.array_equal(values, of_fewer_bits(bits))
    given = small_capture()
    again = Capture.from_arrays(values, given.depth_m, given.camera, mask=given.mask)
    assert np.array_equal(again.photographs, wanted)
    if bits < 16:
        assert f"the largest value is {2**bits - 1}" in found["range-stretched"].message


def test_values_are_multiplied_once(tmp_path):
    capture, _ = loaded(tmp_path / "c", of_fewer_bits(10))
    write_capture(capture, tmp_path / "d")
    again = load_capture(tmp_path / "d")
    assert np.array_equal(again.photographs, capture.photographs)
    assert "range-stretched" not in [finding.code for finding in again.findings]


@pytest.mark.parametrize("bits", [10, 15])
def test_where_white_is_doubtful_the_values_stay_with_a_warning(tmp_path, bits):
    values = of_fewer_bits(bits)
    values[:, 11, 10:14] = 2**bits - 2
    capture, found = loaded(tmp_path / "c", values)
    assert np.array_equal(capture.photographs, values)
    assert "range-stretched" not in found
    assert f"the largest value is {2**bits - 1}" in found["narrow-range"].message
    assert found["narrow-range"].remedy.endswith(f" {2 ** (16 - bits)}")


def test_values_in_floating_point_are_not_multiplied():
    given, values = small_capture(), of_fewer_bits(15)
    capture = Capture.from_arrays(values / 65535, given.depth_m, given.camera, mask=given.mask)
    assert np.array_equal(capture.photographs, values)
    assert "range-stretched" not in [finding.code for finding in capture.findings]


def test_ambient_light_of_fewer_bits_is_subtracted_alike():
    given, values = small_capture(), of_fewer_bits(12)
    ambient = np.full_like(values[0], 100)
    of_16 = [np.rint(each * (65535 / 4095)).astype(np.uint16) for each in (values, ambient)]
    few, whole = (
        Capture.from_arrays(pixels, given.depth_m, given.camera, mask=given.mask, ambient=room)
        for pixels, room in ((values, ambient), of_16)
    )
    assert np.array_equal(few.photographs, whole.photographs)
    brighter = np.full_like(ambient, 5000)
    with pytest.raises(CaptureError, match="nearly all light"):
        Capture.from_arrays(values, given.depth_m, given.camera, ambient=brighter)


@pytest.mark.parametrize("top", [255, 200])
def test_values_of_8_bit_in_16_are_refused_with_what_to_multiply_by(tmp_path, top):
    photographs = (small_capture().photographs.astype(float) / 204 * top).astype(np.uint16)
    photographs[0, 10, 10] = top
    given = small_capture(dtype=np.uint16)
    words = f"values go up to {top} of 65535.*save them as 8 bit or multiply them by 257"
    with pytest.raises(CaptureError, match=words):
        Capture.from_arrays(photographs, given.depth_m, given.camera, mask=given.mask)
    write_capture(replace(given, photographs=photographs), tmp_path / "c")
    with pytest.raises(CaptureError, match=words):
        load_capture(tmp_path / "c")
    as_multiplied = replace(given, photographs=257 * photographs)
    write_capture(as_multiplied, tmp_path / "d")
    assert len(load_capture(tmp_path / "d").photographs) == 4
