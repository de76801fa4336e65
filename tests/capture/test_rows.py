"""Files that are written some rows at a time, read back by our decoders and OpenCV's."""

import errno

import cv2
import numpy as np
import pytest

from rakelight.capture.images import decode_image
from rakelight.capture.rows import TiffFile, pack_png_rows, pack_tiff_rows, png_parts
from rakelight.errors import MachineError

RANDOM = np.random.default_rng(0)
SMOOTH = np.add.outer(np.arange(23), np.arange(31))[..., None] * np.array([5, 7, 3])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("kind", ["noise", "smooth"])
@pytest.mark.parametrize("rows", [1, 7, 23])
def test_a_png_in_parts_is_a_png(dtype, kind, rows):
    most = np.iinfo(dtype).max
    noise = RANDOM.integers(0, most, SMOOTH.shape, dtype, endpoint=True)
    image = noise if kind == "noise" else (SMOOTH % most).astype(dtype)
    packed = [pack_png_rows(image[top : top + rows]) for top in range(0, 23, rows)]
    data = b"".join(png_parts((23, 31), dtype, packed))
    np.testing.assert_array_equal(decode_image(data), image)
    by_opencv = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(by_opencv[..., ::-1], image)


def test_rows_that_change_little_are_stored_as_changes():
    ramp = np.repeat(np.arange(0, 60000, 20, dtype=np.uint16)[None, :, None], 3, axis=2)
    disorder = RANDOM.permuted(ramp, axis=1)
    assert 2 * len(pack_png_rows(ramp).data) < len(pack_png_rows(disorder).data)


@pytest.mark.parametrize("axes", [(), (3,)])
@pytest.mark.parametrize("rows", [1, 6, 17])
def test_a_tiff_in_strips_is_a_tiff(axes, rows, tmp_path):
    image = RANDOM.normal(size=(17, 13, *axes)).astype(np.float32)
    image[2:5] = np.nan
    path = tmp_path / "map.tiff"
    with TiffFile(path, image.shape, rows) as file:
        for top in range(0, 17, rows):
            file.append(pack_tiff_rows(image[top : top + rows]))
    np.testing.assert_array_equal(decode_image(path.read_bytes()), image)
    by_opencv = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(by_opencv[..., ::-1] if axes else by_opencv, image)


def test_a_place_that_cannot_be_written(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.open", full)
    words = "cannot be written .*No space left"
    with pytest.raises(MachineError, match=words), TiffFile(tmp_path / "x", (1, 1), 1):
        pass
