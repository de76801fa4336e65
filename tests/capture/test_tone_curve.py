"""Photographs that say how their values depend on the light: by a profile, by chunks of PNG."""

import io
import struct
import zlib

import numpy as np
import pytest
import tifffile
from PIL import ImageCms

from rakelight.capture import load_capture, write_capture
from rakelight.capture.headers import PNG_MAGIC
from rakelight.capture.images import encode_png
from rakelight.capture.png import chunk
from rakelight.capture.readers import open3d_recorder, tum_rgbd
from rakelight.capture.readers.image_files import color_stream
from rakelight.capture.tone_curve import half_light
from rakelight.errors import CaptureError
from rakelight.prepare.linear import to_linear
from tests.capture.capture_builder import edit_config, small_capture
from tests.capture.readers.phone_sources import frames, write_open3d, write_tum

SMALL = small_capture(dtype=np.uint16, maps=1)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def profile(kind, *numbers):
    """An ICC profile of one curve: of exponents (curv), a table of them, or a formula (para)."""
    if kind == "curv":
        curve = struct.pack(f">4sII{len(numbers)}H", b"curv", 0, len(numbers), *numbers)
    else:
        form, *values = numbers
        fixed = (round(65536 * value) for value in values)
        curve = struct.pack(f">4sIHH{len(values)}i", b"para", 0, form, 0, *fixed)
    return bytes(128) + struct.pack(">I4sII", 1, b"gTRC", 144, len(curve)) + curve


GAMMA_18, ADOBE = profile("curv", round(256 * 1.8)), profile("curv", 563)
LINEAR = profile("curv")


def png(pixels, *kinds_and_bodies):
    """A PNG with more chunks before its pixels."""
    data = encode_png(pixels)
    bodies = zip(kinds_and_bodies[::2], kinds_and_bodies[1::2], strict=True)
    return data[:33] + b"".join(chunk(kind, body) for kind, body in bodies) + data[33:]


def gama(value):
    return b"gAMA", struct.pack(">I", value)


def iccp(icc):
    return b"a profile\0\0" + zlib.compress(icc)


def tiff(pixels, icc=None):
    file = io.BytesIO()
    tifffile.imwrite(file, pixels, photometric="rgb", iccprofile=icc)
    return file.getvalue()


@pytest.mark.parametrize(
    ("icc", "half"),
    [
        (SRGB, 0.214), (LINEAR, 0.5), (ADOBE, 0.218), (GAMMA_18, 0.287),
        (profile("curv", 0, 0x2000, 0xFFFF), 0.125),
        (profile("para", 0, 2.4), 0.189),
        (profile("para", 3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045), 0.214),
        (profile("para", 4, 1.0, 1.0, 0.0, 1.0, 0.0, 0.1, 0.0), 0.6),
    ],
)  # fmt: skip
def test_the_light_at_half_of_white(icc, half):
    pixels = SMALL.photographs[0]
    for data in (tiff(pixels, icc), png(pixels, b"iCCP", iccp(icc))):
        assert half_light(data) == pytest.approx(half, abs=1e-3)


@pytest.mark.parametrize(
    "icc",
    [
        b"",
        bytes(200),
        SRGB[:140],
        profile("para", 9),
        bytes(10),
        profile("para", 1, -1.0, -1.0, 0.0),
    ],
)
def test_a_profile_without_a_curve_states_nothing(icc):
    pixels = SMALL.photographs[0]
    for data in (tiff(pixels, icc or None), png(pixels, b"iCCP", iccp(icc)[: -2 if icc else None])):
        assert half_light(data) is None


def folder(path, files, config=True, small=SMALL):
    """A capture folder, or loose photographs, of a small capture with these photographs."""
    write_capture(small, path)
    for i, data in enumerate(files):
        kind = "png" if data.startswith(PNG_MAGIC) else "tiff"
        (path / f"rgb/{i:03d}.png").unlink()
        (path / f"rgb/{i:03d}.{kind}").write_bytes(data)
    if config:
        edit_config(path, f'encoding = "{small.encoding}"\n', "")
    else:
        (path / "capture.toml").unlink()
        (path / "K.txt").write_text("\n".join(" ".join(map(str, r)) for r in SMALL.camera.matrix))
    return path


@pytest.mark.parametrize("config", [True, False], ids=["capture.toml", "loose"])
@pytest.mark.parametrize(
    ("make", "encoding"),
    [
        (lambda pixels: tiff(pixels, SRGB), "srgb"),
        (lambda pixels: tiff(pixels, ADOBE), "srgb"),
        (lambda pixels: tiff(pixels, LINEAR), "linear"),
        (lambda pixels: png(pixels, b"sRGB", b"\0"), "srgb"),
        (lambda pixels: png(pixels, *gama(45455)), "linear"),
        (lambda pixels: png(pixels, *gama(100_000)), "linear"),
        (lambda pixels: png(pixels, b"cICP", b"\x01\x0d\0\x01", *gama(100_000)), "srgb"),
        (png, "linear"),
    ],
    ids=["sRGB", "Adobe RGB", "linear", "chunk", "gAMA", "linear gAMA", "cICP", "none"],
)
def test_the_file_says_the_encoding(tmp_path, make, encoding, config):
    path = folder(tmp_path / "c", [make(pixels) for pixels in SMALL.photographs], config)
    capture = load_capture(path)
    assert capture.encoding == encoding
    assert np.array_equal(capture.photographs, SMALL.photographs)
    if config:  # what the capture says stands above it
        text = (path / "capture.toml").read_text()
        (path / "capture.toml").write_text('encoding = "linear"\n' + text)
        assert load_capture(path).encoding == "linear"


@pytest.mark.parametrize(
    ("icc", "given", "half"),
    [
        (SRGB, "linear", "0.21"),
        (ADOBE, "linear", "0.22"),
        (LINEAR, "srgb", "0.50"),
        (GAMMA_18, "srgb", "0.29"),
        (SRGB, "srgb", None),
        (ADOBE, "srgb", None),
        (LINEAR, "linear", None),
        (None, "linear", None),
        (None, "srgb", None),
    ],
)
def test_a_profile_that_contradicts_the_key_is_told(tmp_path, icc, given, half):
    path = folder(tmp_path / "c", [tiff(pixels, icc) for pixels in SMALL.photographs])
    text = (path / "capture.toml").read_text()
    (path / "capture.toml").write_text(f'encoding = "{given}"\n' + text)
    capture = load_capture(path)
    assert capture.encoding == given
    told = [f for f in capture.findings if f.code == "encoding-contradicted"]
    assert len(told) == (half is not None)
    for finding in told:
        assert finding.severity == "warning"
        assert f"said to be {given}" in finding.message
        assert "000.tiff comes with a profile" in finding.message
        assert f"half of white is {half} of its light" in finding.message


@pytest.mark.parametrize("config", [True, False], ids=["capture.toml", "loose"])
def test_other_curves_and_different_ones_are_refused(tmp_path, config):
    first, *others = SMALL.photographs
    files = [tiff(pixels, GAMMA_18) for pixels in SMALL.photographs]
    with pytest.raises(CaptureError, match=r"tone curve.*half of white is 0\.29.*linear, or all"):
        load_capture(folder(tmp_path / "a", files, config))
    files = [tiff(first, SRGB), *(tiff(pixels) for pixels in others)]
    with pytest.raises(CaptureError, match=r"tone curve.*0\.21.*; .*001\.tiff without a profile"):
        load_capture(folder(tmp_path / "b", files, config))


EIGHT = small_capture(dtype=np.uint8, maps=1)
P_SRGB, P_LINEAR = (b"iCCP", iccp(SRGB)), (b"iCCP", iccp(LINEAR))
C_SRGB = (b"sRGB", b"\0")


@pytest.mark.parametrize("config", [True, False], ids=["capture.toml", "loose"])
@pytest.mark.parametrize(
    ("chunks", "encoding"),
    [
        ((), "srgb"),
        (C_SRGB, "srgb"),
        (gama(45455), "srgb"),
        (gama(55556), "srgb"),
        (P_SRGB, "srgb"),
        ((b"iCCP", iccp(GAMMA_18)), "srgb"),
        ((*gama(100_000), *C_SRGB), "srgb"),
        ((*gama(100_000), *P_SRGB), "srgb"),
        ((*gama(100_000), b"iCCP", b"damaged"), "srgb"),
        ((b"cICP", b"\x01\x10\0\x01"), "srgb"),
        (gama(100_000), "linear"),
        (P_LINEAR, "linear"),
        ((*gama(45455), *P_LINEAR), "linear"),
        ((*C_SRGB, *P_LINEAR), "linear"),
        ((b"cICP", b"\x01\x08\0\x01", *P_SRGB), "linear"),
    ],
)
def test_8_bit_is_linear_only_where_its_chunks_say_so(tmp_path, chunks, encoding, config):
    files = [png(pixels, *chunks) for pixels in EIGHT.photographs]
    capture = load_capture(folder(tmp_path / "c", files, config, EIGHT))
    assert capture.encoding == encoding
    np.testing.assert_array_equal(capture.photographs, EIGHT.photographs)
    note = "linear-8-bit" if encoding == "linear" else "encoding-assumed"
    assert note in [finding.code for finding in capture.findings]


@pytest.mark.parametrize(("icc", "encoding"), [(LINEAR, "linear"), (SRGB, "srgb"), (None, "srgb")])
def test_8_bit_tiff_is_linear_where_its_profile_says_so(tmp_path, icc, encoding):
    files = [tiff(pixels, icc) for pixels in EIGHT.photographs]
    assert load_capture(folder(tmp_path / "c", files, False, EIGHT)).encoding == encoding


def test_linear_8_bit_beside_sRGB_is_refused(tmp_path):
    files = [png(EIGHT.photographs[0], *gama(100_000)), *map(png, EIGHT.photographs[1:])]
    with pytest.raises(CaptureError, match=r"tone curve.*0\.50.*001\.png without"):
        load_capture(folder(tmp_path / "c", files, True, EIGHT))


# Recordings as image files in a folder


def recorded(path, write, images, *chunks):
    """A folder of a recording whose colour frames are these, with these chunks; returns it."""
    write(path)
    files = sorted([*path.glob("color/*.png"), *path.glob("rgb/*.png")])
    for file, image in zip(files, images, strict=True):
        file.write_bytes(png(image, *chunks))
    return path


LINEAR_16 = np.rint(65535 * to_linear(frames(), "srgb")).astype(np.uint16)


@pytest.mark.parametrize(
    ("read", "write"),
    [(open3d_recorder, write_open3d), (tum_rgbd, write_tum)],
    ids=["Open3D", "TUM"],
)
@pytest.mark.parametrize(
    ("images", "chunks", "encoding", "says"),
    [
        (frames(), (), "srgb", []),
        (LINEAR_16, (), "linear", ["encoding-assumed"]),
        (LINEAR_16, P_LINEAR, "linear", []),
        (257 * frames().astype(np.uint16), C_SRGB, "srgb", []),
        (np.rint(LINEAR_16 / 257).astype(np.uint8), gama(100_000), "linear", ["linear-8-bit"]),
    ],
    ids=["8 bit", "16 bit", "16 bit, linear", "16 bit, sRGB", "8 bit, linear"],
)
def test_frames_have_the_encoding_that_photographs_would_have(
    tmp_path, read, write, images, chunks, encoding, says
):
    recording, _ = read.recording(recorded(tmp_path / "a", write, images, *chunks))
    assert recording.color.encoding == encoding
    codes = [finding.code for finding in recording.findings]
    assert [code for code in codes if code in ("encoding-assumed", "linear-8-bit")] == says
    ((_, first),) = recording.color.walk([0])
    assert np.array_equal(first, images[0])


def test_linear_frames_give_the_light_of_those_in_sRGB(tmp_path):
    light = [
        load_capture(recorded(tmp_path / name, write_open3d, images)).photographs.astype(int)
        for name, images in (("8", frames()), ("16", LINEAR_16))
    ]
    assert np.abs(light[0] - light[1]).max() < 2


def test_frames_of_another_tone_curve_are_refused(tmp_path):
    images = LINEAR_16[:, ::8, ::8]
    path = recorded(tmp_path / "a", write_open3d, images, *P_LINEAR)
    (path / "color/000007.png").write_bytes(png(images[7], *C_SRGB))
    color, _ = color_stream(path, [f"color/{i:06d}.png" for i in range(12)], np.arange(12.0))
    with pytest.raises(CaptureError, match=r"tone curve.*0\.50.*color/000007\.png.*0\.21"):
        list(color.walk(range(12)))
    path = recorded(tmp_path / "b", write_open3d, images, b"iCCP", iccp(GAMMA_18))
    with pytest.raises(CaptureError, match=r"tone curve.*half of white is 0\.29"):
        open3d_recorder.recording(path)
