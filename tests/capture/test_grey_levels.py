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


@pytest.mark.parametrize("bits", [10, 12, 14, 15, 16])
def test_values_of_fewer_bits_in_16_are_told_of(tmp_path, bits):
    made = small_capture(dtype=np.uint16)
    values = made.photographs >> (16 - bits)
    values[:, 10, 10:14] = 2**bits - 1
    capture = load_capture(build(tmp_path / "c", dtype=np.uint16, photographs=4))
    assert "narrow-range" not in [finding.code for finding in capture.findings]
    for i, pixels in enumerate(values):
        (tmp_path / f"c/rgb/{i:03d}.png").write_bytes(encode_png(pixels))
    found = [f for f in load_capture(tmp_path / "c").findings if f.code == "narrow-range"]
    assert len(found) == (bits in (10, 12, 14))
    for finding in found:
        assert f"the largest value is {2**bits - 1}" in finding.message
        assert finding.remedy.endswith(f" {2 ** (16 - bits)}")


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
