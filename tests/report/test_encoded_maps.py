"""Maps survive their way into the page."""

from base64 import b64decode
from dataclasses import replace
from zlib import decompress

import numpy as np
import pytest

from rakelight.pictures import shown
from rakelight.report.encoded_maps import encode, octahedral, pack, viewer_maps
from tests.report.report_scenes import vase_result


def decode(text, bits, height, width):
    """Undo `encode` by sums over both axes, which wrap as the differences did."""
    data = np.frombuffer(decompress(b64decode(text)), np.uint8).reshape(bits // 8, height, width)
    values = data[0].astype(np.uint16)
    if bits == 16:
        values |= data[1].astype(np.uint16) << 8
    values = np.cumsum(np.cumsum(values, axis=0, dtype=np.uint16), axis=1, dtype=np.uint16)
    return values & (2**bits - 1)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_any_values_come_back(dtype):
    rng = np.random.default_rng(0)
    values = rng.integers(0, np.iinfo(dtype).max, (7, 5), dtype=dtype, endpoint=True)
    np.testing.assert_array_equal(decode(encode(values), 8 * values.itemsize, 7, 5), values)


def test_normals_come_back_within_six_hundredths_of_a_degree():
    n = np.random.default_rng(0).normal(size=(40, 50, 3))
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    a, b = (image / 2047.5 - 1 for image in octahedral(n))
    z = np.abs(a) + np.abs(b) - 1
    fold = z > 0
    x = np.where(fold, (1 - np.abs(b)) * np.sign(a), a)
    y = np.where(fold, (1 - np.abs(a)) * np.sign(b), b)
    back = np.stack([x, y, z], axis=-1)
    back /= np.linalg.norm(back, axis=-1, keepdims=True)
    angle = np.degrees(np.arccos(np.clip((back * n).sum(axis=-1), -1, 1)))
    assert angle.max() < 0.06


def test_depth_comes_back_within_half_a_step():
    result, _ = vase_result(0.2)
    maps = viewer_maps(result)
    packed, facts = pack(maps)
    height, width = maps.camera.shape
    for name, depth_m in (("depth-after", maps.after_m), ("depth-before", maps.before_m)):
        (found,) = (each for each in packed if each.name == name)
        steps = decode(found.text, 16, height, width).astype(float)
        back = facts["depth"]["nearest_m"] + (steps - 1) * facts["depth"]["step_m"]
        np.testing.assert_array_equal(steps == 0, np.isnan(depth_m))
        inside = steps > 0
        np.testing.assert_allclose(
            back[inside], depth_m[inside], atol=0.51 * facts["depth"]["step_m"]
        )
    assert facts["depth"]["step_m"] < 1e-5


def test_an_object_too_thin_for_whole_blocks_is_shown_finer(monkeypatch):
    result = vase_result(0.2)[0]
    thin = np.eye(*result.mask.shape, 20, dtype=bool) & result.mask
    only = {
        name: np.where(thin if each.ndim == 2 else thin[..., None], each, empty)
        for name, empty in {"depth": np.nan, "normals": np.nan, "prepared_depth": np.nan,
                            "albedo": 0, "confidence": 0}.items()
        for each in [getattr(result, name)]
    }  # fmt: skip
    monkeypatch.setattr(shown, "MOST_PIXELS", 500)
    maps = viewer_maps(replace(result, **only))
    assert maps.shrunk == 1
    assert np.isfinite(maps.after_m).any()


def test_large_maps_are_averaged_and_keep_their_place(monkeypatch):
    result, _ = vase_result(0.5)
    whole = viewer_maps(result)
    monkeypatch.setattr(shown, "MOST_PIXELS", 5000)
    small = viewer_maps(result)
    assert small.shrunk > 1
    assert small.camera.width * small.camera.height <= 5000
    assert small.camera.fx == pytest.approx(whole.camera.fx / small.shrunk)
    # the middle of the maps looks the same way
    for side, middle in (("width", "cx"), ("height", "cy")):
        seen = [
            ((getattr(m.camera, side) - 1) / 2 - getattr(m.camera, middle)) / m.camera.fx
            for m in (small, whole)
        ]
        assert seen[0] == pytest.approx(seen[1], abs=small.shrunk / whole.camera.fx)
    assert np.nanmedian(small.after_m) == pytest.approx(np.nanmedian(whole.after_m), rel=0.02)
