"""Lens distortion in capture.toml: written and read back exactly, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.capture import load_capture, write_capture
from rakelight.errors import CaptureError, InputError
from rakelight.model import Camera, Capture, Distortion, RigidTransform
from tests.capture.capture_builder import small_capture

LENSES = [
    Distortion("brown-conrady", [0.1, -0.05, 1 / 3000, -1e-17]),
    Distortion("brown-conrady", [0.1, -0.05, 1 / 3000, -1e-17, 0.1 + 0.2]),
    Distortion("brown-conrady", [0.4508, -2.6105, 7.7e-4, -2.1e-4, 1.4968, 0.33, -2.43, 1.4242]),
    Distortion("inverse-brown-conrady", [-0.055, 0.066, 6e-4, -4e-4, -0.021]),
    Distortion("kannala-brandt", [-0.02, 0.011, -0.0085, 0.0018]),
]
HERE = RigidTransform(np.eye(3), np.zeros(3))


def with_lens(lens, **changes):
    capture = small_capture(**changes)
    return replace(capture, camera=replace(capture.camera, distortion=lens))


@pytest.mark.parametrize("lens", LENSES)
def test_written_and_read_back_exactly(tmp_path, lens):
    capture = with_lens(lens)
    own = Camera(16, 12, 20.0, 20.0, 7.5, 5.5, lens)
    capture = replace(capture, depth_camera=own, depth_to_color=HERE)
    write_capture(capture, tmp_path / "capture")
    again = load_capture(tmp_path / "capture")
    assert again.camera == capture.camera
    assert again.depth_camera == own


def test_without_distortion_the_text_is_as_before(tmp_path):
    write_capture(small_capture(), tmp_path / "capture")
    assert "distortion" not in (tmp_path / "capture" / "capture.toml").read_text()


REFUSED = [
    ("distortion = 3", "'intrinsics.distortion' has a wrong value.*write distortion = { model"),
    ("distortion = [0, 0, 0, 0]", "'intrinsics.distortion' has a wrong value"),
    (
        'distortion = { model = "brown", k = [0, 0, 0, 0] }',
        "'intrinsics.distortion.model' has an unknown value .seen 'brown', needed 'brown-conrady'",
    ),
    (
        'distortion = { model = "Brown-Conrady", k = [0, 0, 0, 0] }',
        "did you mean 'brown-conrady'",
    ),
    ('distortion = { model = "brown-conrady" }', "'intrinsics.distortion.k' is missing.*k1, k2"),
    (
        'distortion = { model = "brown-conrady", k = [0, 0, 0, 0], p = 1 }',
        "unknown key 'intrinsics.distortion.p'",
    ),
    (
        'distortion = { model = "brown-conrady", k = [0, 0, 0] }',
        "'intrinsics.distortion.k': another number of coefficients.*seen 3, needed 4 or 5 or 8",
    ),
    (
        'distortion = { model = "kannala-brandt", k = [0, 0, 0, 0, 0] }',
        "seen 5, needed 4",
    ),
    ('distortion = { model = "brown-conrady", k = [0, 0, nan, 0] }', "not finite numbers"),
    ('distortion = { model = "brown-conrady", k = [0, 0, inf, 0] }', "not finite numbers"),
    ('distortion = { model = "brown-conrady", k = [0, 0, "1", 0] }', r"k\[2\]' has a wrong value"),
    (
        f'distortion = {{ model = "brown-conrady", k = [1{"0" * 400}, 0, 0, 0] }}',
        r"k\[0\]' has a wrong value",
    ),
    (
        'distortion = { model = "brown-conrady", k = [-9.0, 0, 0, 0] }',
        "'intrinsics.distortion' folds inside the image .seen 5 pixels from the principal point, "
        "needed beyond the corners, 20 pixels",
    ),
    *(
        (
            f'distortion = {{ model = "{model}", k = [{k}, 0, 0, 0] }}',
            "'intrinsics.distortion' is that of no lens .seen the corners .* times as far out",
        )
        for model, k in (
            ("brown-conrady", 5.0),
            ("brown-conrady", 1000.0),
            ("brown-conrady", 1e308),
            ("kannala-brandt", 1e308),
        )
    ),
    (
        f'distortion = {{ model = "brown-conrady", k = [{", ".join(["1e308"] * 8)}] }}',
        "'intrinsics.distortion' folds inside the image .seen 0 pixels",
    ),
    (
        'distortion = { model = "kannala-brandt", k = [0, 0, 0, -1e308] }',
        "'intrinsics.distortion' folds inside the image",
    ),
]


@pytest.mark.parametrize(("line", "words"), REFUSED)
def test_what_capture_toml_may_not_say(tmp_path, line, words):
    write_capture(small_capture(), tmp_path / "capture")
    config = tmp_path / "capture" / "capture.toml"
    config.write_text(config.read_text() + line + "\n")
    with pytest.raises(CaptureError, match=words) as refused:
        load_capture(tmp_path / "capture")
    assert refused.value.source.endswith("capture.toml")


def test_the_depth_camera_is_named(tmp_path):
    own = Camera(16, 12, 20.0, 20.0, 7.5, 5.5, LENSES[0])
    write_capture(replace(small_capture(), depth_camera=own), tmp_path / "capture")
    config = tmp_path / "capture" / "capture.toml"
    config.write_text(config.read_text().replace("k = [0.1,", "k = [nan,"))
    with pytest.raises(CaptureError, match=r"depth_intrinsics\.distortion\.k"):
        load_capture(tmp_path / "capture")


def test_arrays_with_distortion():
    capture = with_lens(LENSES[1])
    made = Capture.from_arrays(
        capture.photographs, capture.depth_m, capture.camera, mask=capture.mask, encoding="linear"
    )
    assert made.camera == capture.camera
    folding = replace(capture.camera, distortion=Distortion("brown-conrady", [-9, 0, 0, 0]))
    with pytest.raises(CaptureError, match="camera: distortion folds inside the image"):
        Capture.from_arrays(capture.photographs, capture.depth_m, folding, mask=capture.mask)
    numbers = replace(capture.camera, distortion=(0.1, 0, 0, 0))
    with pytest.raises(InputError, match=r"camera\.distortion: this is no Distortion"):
        Capture.from_arrays(capture.photographs, capture.depth_m, numbers, mask=capture.mask)
