"""ambient.png and flat.png: light that is not the lamp's is subtracted, vignetting divided out."""

import numpy as np
import pytest

from rakelight import Capture, MultiLight, evaluate, load_capture, refine
from rakelight.capture.ambient_and_flat import corrected, vignetting
from rakelight.capture.images import encode_png
from rakelight.errors import CaptureError
from rakelight.prepare.linear import srgb
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene
from tests.capture.capture_builder import HEIGHT, WIDTH, build, codes, small_capture
from tests.capture.readers.test_photographs import fill


def corner_falloff(height, width, corner=2 / 3):
    """(H, W, 3) brightness, 1 in the middle and `corner` in the corners."""
    rows, columns = np.mgrid[-1 : 1 : 1j * height, -1 : 1 : 1j * width]
    return (1 - (1 - corner) * (rows**2 + columns**2) / 2)[..., None].repeat(3, axis=2)


def coded(light, dtype=np.uint16, encoding="linear"):
    code = srgb(light) if encoding == "srgb" else np.clip(light, 0, 1)
    return np.rint(np.iinfo(dtype).max * code).astype(dtype)


@pytest.mark.parametrize(("dtype", "encoding"), [(np.uint16, "linear"), (np.uint8, "srgb")])
def test_light_of_the_lamp_comes_out(dtype, encoding):
    random = np.random.default_rng(0)
    lamp = random.uniform(0.05, 0.4, (3, 60, 80, 3))
    ambient = random.uniform(0.0, 0.3, (60, 80, 3))
    lens = corner_falloff(60, 80)
    seen = coded((lamp + ambient) * lens, dtype, encoding)
    flat = coded(0.7 * lens * np.array([1.0, 0.9, 0.6]), dtype, encoding)
    off = coded(ambient * lens, dtype, encoding)
    values, findings = corrected(seen, encoding, off, flat)
    assert values.dtype == np.uint16
    assert [f.code for f in findings] == ["ambient-subtracted", "flat-divided"]
    largest_error = 0.004 if dtype == np.uint16 else 0.012
    assert np.abs(values / 65535 - lamp).max() < largest_error
    only_flat, _ = corrected(seen, encoding, None, flat)
    assert np.abs(only_flat / 65535 - lamp).max() > 0.25


def test_saturated_stays_so_and_nothing_else_becomes_it():
    light = np.full((2, 60, 80, 3), 0.5)
    light[0, :30] = 0.96
    light[1, :, 40:] = 1.0
    seen = coded(light)
    flat = coded(0.6 * corner_falloff(60, 80))
    values, _ = corrected(seen, "linear", np.full_like(seen[0], 6000), flat)
    saturated = values >= 0.98 * 65535
    assert np.array_equal(saturated, light == 1.0)
    darker = values[0, 2, 2] / values[0, 32, 2]  # one factor for all
    assert darker == pytest.approx((0.96 - 6000 / 65535) / (0.5 - 6000 / 65535), rel=0.35)


def test_noise_and_texture_of_the_card_are_smoothed_away():
    random = np.random.default_rng(0)
    lens = corner_falloff(240, 320)
    card = 0.6 * lens * random.normal(1, 0.05, (240, 320, 3))
    assert np.abs(vignetting(coded(card), "linear") / lens - 1).max() < 0.03
    assert np.abs(vignetting(coded(0.6 * lens), "linear") / lens - 1).max() < 0.003


def test_what_is_no_such_picture_is_refused():
    seen = small_capture(dtype=np.uint16).photographs
    for ambient, flat, words in (
        (seen[0, 1:], None, "ambient: this picture does not fit"),
        (seen[0].astype(np.uint8), None, "needed .*uint16"),
        (seen.max(axis=0), None, "nearly all light"),
        (None, np.full_like(seen[0], 65535), "saturated"),
        (None, np.full_like(seen[0], 300), "card is dark"),
        (None, coded(np.linspace(0, 0.9, WIDTH)[:, None] * np.ones((HEIGHT, 1, 3))), "fills"),
    ):
        with pytest.raises(CaptureError, match=words):
            corrected(seen, "linear", ambient, flat)


def test_in_a_capture_folder(tmp_path):
    folder = build(tmp_path / "a")
    made = load_capture(folder)
    ambient = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    (folder / "ambient.png").write_bytes(encode_png(ambient))
    (folder / "flat.png").write_bytes(encode_png(coded(0.6 * corner_falloff(HEIGHT, WIDTH))))
    assert {"ambient-subtracted", "flat-divided"} <= set(codes(folder))
    capture = load_capture(folder)
    assert (capture.encoding, capture.photographs.dtype) == ("linear", np.uint16)
    expected, _ = corrected(
        made.photographs, made.encoding, ambient, coded(0.6 * corner_falloff(HEIGHT, WIDTH))
    )
    assert np.array_equal(capture.photographs, expected)
    (folder / "flat.png").write_bytes(encode_png(ambient[1:]))
    with pytest.raises(CaptureError, match=r"flat\.png: this picture does not fit"):
        load_capture(folder)


def test_an_ambient_photograph_under_the_lamp_is_named(tmp_path):
    made = small_capture()
    lit = np.where(made.mask[..., None].repeat(3, 2), 204, 0).astype(np.uint8)
    words = r"after .*{}.* was subtracted.*take .*{} with the lamp off"
    with pytest.raises(CaptureError, match=words.format("ambient", "ambient")):
        Capture.from_arrays(
            made.photographs, made.depth_m, made.camera, mask=made.mask, ambient=lit
        )
    (build(tmp_path / "a") / "ambient.png").write_bytes(encode_png(lit))
    fill(tmp_path / "b")
    (tmp_path / "b/mask.png").write_bytes(encode_png(made.mask.astype(np.uint8)))
    (tmp_path / "b/lamp_ambient.png").write_bytes(encode_png(lit))
    for folder, name in (("a", r"ambient\.png"), ("b", r"lamp_ambient\.png")):
        with pytest.raises(CaptureError, match=words.format(name, name)):
            load_capture(tmp_path / folder)


def test_among_loose_photographs_the_picture_is_named(tmp_path):
    fill(tmp_path)
    card = coded(0.6 * corner_falloff(HEIGHT, WIDTH), np.uint8)
    (tmp_path / "lamp_flat.png").write_bytes(encode_png(card))
    (note,) = (f for f in load_capture(tmp_path).findings if f.code == "flat-divided")
    assert note.message.startswith("vignetting divided out by lamp_flat.png: ")
    (tmp_path / "lamp_flat.png").write_bytes(encode_png(card // 60))
    with pytest.raises(CaptureError, match=r": lamp_flat\.png: the card is dark"):
        load_capture(tmp_path)


def test_strong_ambient_light_and_vignetting_are_repaired():
    """Window light with a shadow's edge, half of all light; corners two thirds as bright."""
    shape = make_shape("vase")
    options = SceneOptions(
        camera=shape.camera.scaled(0.15), photographs=6, depth_factor=2, supersampling=1,
        image_noise=0.003, depth_noise=DepthNoise(rms_mm=2.0),
    )  # fmt: skip
    made, truth = render_scene(shape, make_albedo("pattern"), options)
    height, width = made.mask.shape
    lamp = 0.55 * made.photographs / 65535
    edge = 1 + np.tanh((np.arange(width) - 0.5 * width) / 4)[:, None]
    paint = np.where(made.mask[..., None], truth.albedo / truth.albedo.max(), 0.3)
    ambient, lens = 0.2 * paint * edge, corner_falloff(height, width)
    random = np.random.default_rng(0)

    def noisy(light):
        return coded(light + random.normal(0, 0.003, light.shape))

    seen, off = noisy((lamp + ambient) * lens), noisy(ambient * lens)
    pictures = {"ambient": off, "flat": noisy(0.7 * lens)}

    def errors(photographs, **given):
        capture = Capture.from_arrays(
            photographs, made.depth_m, made.camera, mask=made.mask, encoding="linear", **given
        )
        result = refine(capture, options=MultiLight(lights="white", distance="distant"))
        ratio = result.albedo[made.mask] / np.maximum(truth.albedo[made.mask], 0.01)
        albedo = float(np.median(np.abs(ratio / np.median(ratio) - 1)))
        return evaluate(result, truth).normals.mae_deg, albedo

    without, albedo_without = errors(seen)
    repaired, albedo_repaired = errors(seen, **pictures)
    assert repaired < 0.9 * without, (repaired, without)
    assert albedo_repaired < 0.6 * albedo_without, (albedo_repaired, albedo_without)
