"""`prepare`: scales, cameras, windows, and what it refuses."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from rakelight.errors import CaptureError, InputError
from rakelight.geometry.camera import back_project
from rakelight.model import Camera, Capture, RigidTransform, SensorNoise
from rakelight.prepare import prepare

KINECT_NOISE = SensorNoise().sigma_m

CAMERA = Camera(width=64, height=48, fx=700.0, fy=720.0, cx=30.5, cy=25.0)
ROWS, COLUMNS = np.indices(CAMERA.shape)
DISC = (ROWS - 22) ** 2 + (COLUMNS - 33) ** 2 < 14**2


def plane(camera):
    """Depth of a slanted plane, exact at the pixel centres of `camera`."""
    return 0.8 / (back_project(np.ones(camera.shape), camera) @ [-0.3, 0.2, 1.0])


def make_capture(step=2, count=3, **changes):
    """Random photographs of middle brightness, a slanted plane as depth."""
    values = np.random.default_rng(0).integers(9000, 50000, (count, *CAMERA.shape, 3))
    capture = Capture(
        photographs=values.astype(np.uint16),
        depth_m=plane(CAMERA.scaled(1 / step))[None].astype(np.float32),
        mask=DISC,
        camera=CAMERA,
        names=("a.png", "b.png", "c.png"),
        source="here",
    )
    return replace(capture, **changes)


@pytest.mark.parametrize("step", [1, 2, 4])
def test_auto_is_the_colour_cameras_resolution(step):
    prepared = prepare(make_capture(step))
    assert prepared.factor == step
    assert prepared.full_camera == CAMERA
    assert prepared.encoding == "linear"
    assert prepared.depth_m.shape == prepared.mask.shape == prepared.camera.shape


@pytest.mark.parametrize(
    ("step", "scale", "shrink"), [(4, 4, 1), (4, 2, 2), (4, 1, 4), (2, 1, 2), (1, 1, 1)]
)
def test_output_scale_over_the_depths_resolution(step, scale, shrink):
    prepared = prepare(make_capture(step), scale)
    assert prepared.factor == scale
    assert prepared.full_camera == CAMERA.scaled(1 / shrink)
    assert prepared.full_camera.shape == (48 // shrink, 64 // shrink)


@pytest.mark.parametrize("scale", [0, -1, 3, 8])
def test_other_scales_are_refused(scale):
    with pytest.raises(InputError, match="resolution") as error:
        prepare(make_capture(4), scale)
    assert error.value.needed == "one of 1, 2, 4"


@pytest.mark.parametrize("scale", [1.5, 1.0, "2", True, None, float("nan")])
def test_a_scale_is_a_whole_number_or_auto(scale):
    with pytest.raises(InputError, match="scale: no scale") as error:
        prepare(make_capture(4), scale)
    assert error.value.needed == 'a whole number, here one of 1, 2, 4, or "auto"'


def test_window_holds_the_object_with_a_margin():
    prepared = prepare(make_capture())
    assert prepared.mask.sum() == DISC.sum()
    for edge in (0, -1):
        assert not prepared.mask[edge].any()
        assert not prepared.mask[:, edge].any()
        assert prepared.mask[(1, -2)[edge]].any()
    assert prepared.camera == CAMERA.cropped(prepared.rows, prepared.columns)
    np.testing.assert_array_equal(prepared.mask, DISC[prepared.rows, prepared.columns])


def test_embed_puts_the_window_back():
    capture = make_capture(mask=DISC)
    prepared = prepare(capture)
    for outside in (np.nan, 0.0, -1.0):
        rows = prepared.embed(ROWS[prepared.rows, prepared.columns], outside)
        np.testing.assert_array_equal(rows, np.where(DISC, ROWS, outside).astype(np.float32))
        assert rows.dtype == np.float32
    colours = np.stack([ROWS, COLUMNS, ROWS + COLUMNS], axis=-1)
    full = prepared.embed(colours[prepared.rows, prepared.columns], 0.0)
    np.testing.assert_array_equal(full, np.where(DISC[..., None], colours, 0))


def test_pixels_are_those_of_the_mask():
    capture = make_capture()
    light, good = prepare(capture).pixels(1)
    np.testing.assert_allclose(light, capture.photographs[1][DISC] / 65535, rtol=1e-6)
    assert good.all()


@pytest.mark.parametrize("step", [1, 2, 4])
def test_a_plane_comes_out_as_a_plane(step):
    # Away from the frame, further than filter and splines reach; half a pixel of shift would be
    # an error of 1.7e-4 m.
    prepared = prepare(make_capture(step, mask=np.ones(CAMERA.shape, bool)))
    reach = 5 * step
    inner = np.s_[reach:-reach, reach:-reach]
    assert np.abs(prepared.depth_m - plane(CAMERA))[inner].max() < 2e-5


def test_depth_and_its_noise_are_positive_everywhere_in_the_window():
    depth = make_capture().depth_m.copy()
    depth[0, 5:15, 10:20] = np.nan
    prepared = prepare(make_capture(depth_m=depth))
    assert (prepared.depth_m > 0).all()
    assert (prepared.sigma_m > 0).all()
    # away from what was measured the noise is the typical one
    measured = prepared.measured & prepared.mask
    typical = np.median(prepared.sigma_m[measured])
    np.testing.assert_allclose(prepared.sigma_m[prepared.mask & ~measured], typical, rtol=0.1)


def test_noise_is_the_sensors_where_the_depth_is_clean():
    prepared = prepare(make_capture(1))
    inside = prepared.measured
    expected = KINECT_NOISE * plane(prepared.camera) ** 2
    np.testing.assert_allclose(prepared.sigma_m[inside], expected[inside], rtol=1e-6)


def test_measured_is_where_the_sensor_saw_the_object():
    depth = make_capture(2).depth_m.copy()
    depth[0, 8:12, 14:18] = np.nan
    prepared = prepare(make_capture(2, depth_m=depth))
    measured = prepared.embed(prepared.measured, 0) > 0
    hole = (ROWS // 2 >= 8) & (ROWS // 2 < 12) & (COLUMNS // 2 >= 14) & (COLUMNS // 2 < 18)
    np.testing.assert_array_equal(measured, DISC & ~hole)


def test_several_maps_are_averaged():
    noise = np.random.default_rng(1).normal(0, 1e-3, (9, *CAMERA.shape))
    maps = (plane(CAMERA) + noise).astype(np.float32)
    maps[3, 20:24, 30:34] = 5.0
    prepared = prepare(make_capture(1, depth_m=maps))
    exact = plane(prepared.camera)
    assert np.abs(prepared.depth_m - exact)[prepared.mask].max() < 0.02
    inner = prepared.mask & (np.hypot(*(np.indices(exact.shape) - 14.0)) < 9)
    assert np.sqrt(np.mean((prepared.depth_m - exact)[inner] ** 2)) < 3e-4


# ---- photographs at a lower resolution


def test_photographs_are_averaged_in_linear_light():
    codes = np.random.default_rng(2).integers(20, 240, (1, *CAMERA.shape, 3)).astype(np.uint8)
    capture = make_capture(2, photographs=codes, encoding="srgb", mask=np.ones(CAMERA.shape, bool))
    prepared = prepare(capture, 1)
    assert prepared.encoding == "srgb"
    assert prepared.photographs.dtype == np.uint16
    code = codes[0] / 255
    light = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    blocks = (light[::2, ::2] + light[1::2, ::2] + light[::2, 1::2] + light[1::2, 1::2]) / 4
    seen, _ = prepared.pixels(0)
    np.testing.assert_allclose(seen, blocks.reshape(-1, 3), rtol=1e-4)
    wrong = (code[::2, ::2] + code[1::2, ::2] + code[::2, 1::2] + code[1::2, 1::2]) / 4
    wrong = ((wrong + 0.055) / 1.055) ** 2.4
    assert np.abs(wrong - blocks).max() > 0.05


def test_dark_is_as_usable_at_a_lower_resolution():
    # sRGB's code 2 is the first that is not black, and 0.0006 of white.
    photographs = np.full((1, *CAMERA.shape, 3), 2, np.uint8)
    for encoding, scale in itertools.product(("srgb", "linear"), (2, 1)):
        capture = make_capture(2, photographs=photographs, encoding=encoding)
        seen, good = prepare(capture, scale).pixels(0)
        assert good.all(), (encoding, scale)
        dark = 2 / 255 / (12.92 if encoding == "srgb" else 1)
        np.testing.assert_allclose(seen, dark, rtol=5e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_block_with_a_saturated_pixel_stays_saturated(dtype):
    top = np.iinfo(dtype).max
    photographs = np.full((1, *CAMERA.shape, 3), top // 2, dtype)
    photographs[0, 10, 21, 1] = top
    photographs[0, 30, 40, 2] = np.ceil(0.98 * top) - 1  # bright, but not saturated
    capture = make_capture(2, photographs=photographs, mask=np.ones(CAMERA.shape, bool))
    _, good = prepare(capture, 1).pixels(0)
    good = good.reshape(24, 32, 3)
    assert not good[5, 10, 1]
    assert good.sum() == good.size - 1  # other channels and pixels stay usable


def test_shrunk_mask_has_only_whole_blocks():
    prepared = prepare(make_capture(2), 1)
    blocks = DISC.reshape(24, 2, 32, 2).all(axis=(1, 3))
    np.testing.assert_array_equal(prepared.embed(prepared.mask, 0) > 0, blocks)


# ---- masks at the frame, thin masks, parts


@pytest.mark.parametrize(
    "window",
    [
        np.s_[:, :],
        np.s_[0:7, 0:9],
        np.s_[40:48, 55:64],
        np.s_[:, 0:1],
        np.s_[47:48, :],
        np.s_[20:21, 30:31],
    ],
)
@pytest.mark.parametrize("step", [1, 2, 4])
def test_masks_of_any_place_and_width(window, step):
    mask = np.zeros(CAMERA.shape, bool)
    mask[window] = True
    prepared = prepare(make_capture(step, mask=mask))
    np.testing.assert_array_equal(prepared.embed(prepared.mask, 0) > 0, mask)
    assert np.isfinite(prepared.depth_m).all()
    error = np.abs(prepared.embed(prepared.depth_m, np.nan) - plane(CAMERA))[mask]
    assert error.max() < 0.003


def test_parts_do_not_mix():
    # Two parts at different depth: each stays within the depths that were measured on it.
    mask = np.zeros(CAMERA.shape, bool)
    mask[5:40, 4:28] = mask[5:40, 30:60] = True
    depth = np.where(np.arange(32) < 14, 0.6, 1.4) * np.ones((1, 24, 32))
    depth[0, :, 14] = np.nan
    prepared = prepare(make_capture(2, mask=mask, depth_m=depth.astype(np.float32)))
    full = prepared.embed(prepared.depth_m, np.nan)
    np.testing.assert_allclose(full[mask & (COLUMNS < 20)], 0.6, rtol=1e-3)
    np.testing.assert_allclose(full[mask & (COLUMNS > 40)], 1.4, rtol=1e-3)


def test_a_part_without_any_depth_is_left_out():
    mask = np.zeros(CAMERA.shape, bool)
    mask[4:20, 4:20] = mask[30:44, 40:60] = True
    depth = np.full((1, 24, 32), np.nan, np.float32)
    depth[0, :12, :12] = 0.7
    prepared = prepare(make_capture(2, mask=mask, depth_m=depth))
    full = prepared.embed(prepared.depth_m, np.nan)
    np.testing.assert_allclose(full[4:20, 4:20], 0.7, rtol=1e-6)
    assert np.isnan(full[30:]).all()
    (warning,) = prepared.findings
    assert (warning.severity, warning.code) == ("warning", "holes-left-out")
    assert f"{280 / (280 + 256):.1%} of the object" in warning.message
    assert warning.message.endswith("(280 pixels at (40, 30))")


def test_a_mask_thinner_than_the_scales_pixels_is_refused():
    mask = np.zeros(CAMERA.shape, bool)
    mask[5, 4:20] = True
    with pytest.raises(CaptureError, match=r"seen 16 pixels.*a block of 2 x 2.*leave --scale"):
        prepare(make_capture(2, mask=mask), 1)


# ---- what is refused


@pytest.mark.parametrize("mask", [DISC, np.zeros(CAMERA.shape, bool)])
@pytest.mark.parametrize("count", [1, 3])
def test_no_depth_on_the_object(mask, count):
    depth = np.full((count, 24, 32), np.nan, np.float32)
    depth[:, 0, 0] = 0.8  # beside the object
    with pytest.raises(CaptureError, match=r"no depth on the object .seen 1 depth.*mask belong"):
        prepare(make_capture(2, mask=mask, depth_m=depth))


@pytest.mark.parametrize(
    "changes",
    [
        {"depth_m": np.ones((1, 96, 128), np.float32)},
        {"depth_m": np.ones((1, 24, 30), np.float32)},
        {"depth_m": np.ones((1, 48, 32), np.float32)},
        {"depth_m": np.ones((24, 32), np.float32)},
        {"mask": np.ones((48, 63), bool)},
        {"photographs": np.ones((3, 48, 64), np.uint8)},
        {"photographs": np.ones((3, 24, 32, 3), np.uint8)},
    ],
)
def test_arrays_that_do_not_fit(changes):
    with pytest.raises(CaptureError, match="different size"):
        prepare(make_capture(**changes))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"depth_camera": CAMERA}, "depth camera are of different size"),
        ({"depth_to_color": RigidTransform(np.eye(3), np.ones(3))}, "without depth_camera"),
    ],
)
def test_depth_cameras_that_do_not_fit(changes, words):
    with pytest.raises(CaptureError, match=words):
        prepare(make_capture(**changes))
