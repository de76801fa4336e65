"""Captures brought into an ideal camera: light, masks, depth, and what it may not lose."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.errors import CaptureError, InputError
from rakelight.model import BLACK, SATURATED, Camera, Capture, Distortion
from rakelight.prepare import prepare
from rakelight.prepare._kernels import resample
from rakelight.prepare.linear import to_linear
from rakelight.prepare.sensor import sensed
from rakelight.prepare.undistort import _lanczos, shown_by_lens, undistorted

BARREL = Distortion("brown-conrady", [-0.25, 0.05, 0.002, -0.001, 0.0])
PINCUSHION = Distortion("brown-conrady", [0.25, 0.0, 0.0, 0.0, 0.0])
ZERO = Distortion("brown-conrady", [0.0] * 5)
HEIGHT, WIDTH = 90, 120


def capture_with(lens, light, mask=None, encoding="linear", dtype=np.uint16, depth_m=None):
    """A capture of linear light (H, W) in 0..1, as seen through the lens."""
    camera = Camera(WIDTH, HEIGHT, 100.0, 101.0, 60.5, 43.0, lens)
    values = np.rint(np.iinfo(dtype).max * light).astype(dtype)
    photographs = np.repeat(values[None, ..., None], 3, axis=-1)
    depth_m = np.full((1, HEIGHT // 2, WIDTH // 2), 1.0, np.float32) if depth_m is None else depth_m
    mask = disc() if mask is None else mask
    return Capture(photographs, depth_m, mask, camera, encoding)


def disc(radius=30):
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    return (rows - 43) ** 2 + (columns - 60) ** 2 < radius**2


def pattern(x, y):
    """Smooth light on the image plane, normalised coordinates."""
    return 0.5 + 0.2 * np.sin(25 * x) * np.cos(20 * y) + 0.1 * x


def rays(camera):
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy


def through(lens):
    """The pattern as the lens shows it."""
    from rakelight.geometry.distortion import undistort

    camera = capture_with(lens, np.zeros((HEIGHT, WIDTH))).camera
    return pattern(*undistort(*rays(camera), lens))


@pytest.mark.parametrize("lens", [BARREL, PINCUSHION])
def test_light_is_where_an_ideal_camera_sees_it(lens):
    ideal = undistorted(capture_with(lens, through(lens)))
    assert ideal.camera == replace(capture_with(lens, through(lens)).camera, distortion=None)
    found = to_linear(ideal.photographs[0, ..., 0], "linear")[ideal.mask]
    off = np.abs(found - pattern(*rays(ideal.camera))[ideal.mask])
    assert off.max() < 0.002
    ignored = through(lens) - pattern(*rays(ideal.camera))
    assert np.abs(ignored[ideal.mask]).max() > 0.02


def test_nothing_changes_without_distortion():
    capture = capture_with(None, through(BARREL))
    assert undistorted(capture) is capture
    zeros = replace(capture, camera=replace(capture.camera, distortion=ZERO))
    assert undistorted(zeros).photographs is zeros.photographs
    assert undistorted(zeros).camera == capture.camera


@pytest.mark.parametrize("encoding", ["linear", "srgb"])
def test_eight_bits_become_sixteen_of_the_same_encoding(encoding):
    ideal = undistorted(
        capture_with(BARREL, np.full((HEIGHT, WIDTH), 0.2), None, encoding, np.uint8)
    )
    assert ideal.photographs.dtype == np.uint16
    assert ideal.encoding == encoding
    assert set(np.unique(ideal.photographs[:, ideal.mask])) == {51 * 257}


def test_resampling_is_in_linear_light():
    # Encoded stripes keep their mean as light.
    stripes = np.where(np.arange(WIDTH) % 4 < 2, 0.8, 0.2) * np.ones((HEIGHT, 1))
    ideal = undistorted(capture_with(BARREL, stripes, disc(), "srgb", np.uint16))
    light = to_linear(ideal.photographs[0, ..., 0], "srgb")[ideal.mask]
    ends = to_linear(np.rint(65535 * np.array([0.2, 0.8])).astype(np.uint16), "srgb")
    assert light.mean() == pytest.approx(ends.mean(), rel=0.05)


def test_a_coarser_pixel_is_the_mean_of_what_it_covers():
    # White noise: the mean of an area a times as large has 1/a of its variance, and less where
    # values between pixels are interpolated.
    random = np.random.default_rng(0)
    noise = 0.5 + 0.05 * random.standard_normal((HEIGHT, WIDTH))
    squeezed = Distortion("brown-conrady", [8.0, 0.0, 0.0, 0.0, 0.0])
    ideal = undistorted(capture_with(squeezed, noise, disc(44)))
    x, y = rays(ideal.camera)
    r2 = x**2 + y**2
    area = (1 + 8 * r2) * (1 + 24 * r2)
    light = to_linear(ideal.photographs[0, ..., 0], "linear")
    ring = ideal.mask & (area > 3)
    expected = 0.05**2 / np.mean(area[ring])
    assert ring.sum() > 100
    assert 0.4 * expected < np.var(light[ring]) < 1.3 * expected


def test_saturated_and_black_pixels_stay_that():
    light = through(BARREL)
    light[30:50, 50:70] = 1.0
    light[60:64, 50:70] = 0.002
    capture = capture_with(BARREL, light)
    values = undistorted(capture).photographs[0, ..., 0] / 65535
    cameras = replace(capture.camera, distortion=None), capture.camera
    saturated = shown_by_lens(values >= SATURATED, *cameras)
    # All that was saturated, and no more than the pixels around it.
    assert saturated[31:49, 51:69].all()
    assert not saturated[:28].any()
    assert not saturated[53:].any()
    black = shown_by_lens(values <= BLACK, *cameras)
    assert black[61:63, 51:69].all()
    # Nothing between is a mixture with white.
    rest = undistorted(capture).mask & (values < SATURATED)
    assert values[rest].max() < 0.85


@pytest.mark.parametrize("lens", [BARREL, PINCUSHION])
def test_the_mask_there_and_back(lens):
    capture = capture_with(lens, through(lens))
    ideal = undistorted(capture)
    again = shown_by_lens(ideal.mask, ideal.camera, capture.camera)
    outline = capture.mask & ~np.roll(capture.mask, 1, 0) | ~capture.mask & np.roll(
        capture.mask, 1, 0
    )
    assert (again != capture.mask).sum() < 0.6 * outline.sum() * np.pi
    assert abs(int(again.sum()) - int(capture.mask.sum())) < 0.02 * capture.mask.sum()


def test_the_image_grows_to_show_the_object_whole():
    whole = np.ones((HEIGHT, WIDTH), dtype=bool)
    capture = capture_with(BARREL, through(BARREL), whole)
    ideal = undistorted(capture)
    assert ideal.camera.width > WIDTH
    # By whole depth pixels, the focal length unchanged.
    assert (ideal.camera.width % 2, ideal.camera.height % 2) == (0, 0)
    assert (ideal.camera.fx, ideal.camera.fy) == (100.0, 101.0)
    assert shown_by_lens(ideal.mask, ideal.camera, capture.camera)[1:-1, 1:-1].all()
    found = to_linear(ideal.photographs[0, ..., 0], "linear")
    assert np.abs(found - pattern(*rays(ideal.camera)))[ideal.mask].max() < 0.03
    assert "the image grew to" in ideal.findings[-1].message
    # What the lens did not show is black, and not the object.
    assert (ideal.photographs[0, ~ideal.mask] == 0).mean() > 0.9
    cut = undistorted(capture, whole=False)
    assert cut.camera.width <= ideal.camera.width


def test_an_object_too_far_from_the_axis():
    camera = Camera(WIDTH, HEIGHT, 38.0, 38.0, 59.5, 44.5, Distortion("kannala-brandt", [0.0] * 4))
    capture = replace(capture_with(None, np.full((HEIGHT, WIDTH), 0.5)), camera=camera)
    undistorted(capture)
    with pytest.raises(CaptureError, match="too far from the optical axis"):
        undistorted(replace(capture, mask=np.ones((HEIGHT, WIDTH), bool)))


def step_and_hole():
    """(1, h, w) depth through BARREL: a slanted plane, a nearer square on it, a hole."""
    from rakelight.geometry.distortion import undistort

    camera = capture_with(BARREL, np.zeros((HEIGHT, WIDTH))).camera.resized(WIDTH // 2, HEIGHT // 2)
    x, y = undistort(*rays(camera), BARREL)
    depth_m = np.where((abs(x) < 0.15) & (abs(y) < 0.15), 0.5, 1 / (1 + 0.3 * x - 0.2 * y))
    depth_m[10:14, 40:46] = np.nan
    return depth_m[None].astype(np.float32)


def test_depth_is_not_mixed_across_jumps_and_holes():
    capture = capture_with(
        BARREL, through(BARREL), np.ones((HEIGHT, WIDTH), bool), depth_m=step_and_hole()
    )
    ideal = undistorted(capture)
    depth_m, _ = sensed(ideal)
    x, y = rays(ideal.camera.resized(*depth_m.shape[::-1]))
    plane = 1 / (1 + 0.3 * x - 0.2 * y)
    off = np.minimum(np.abs(depth_m - 0.5), np.abs(depth_m - plane))[np.isfinite(depth_m)]
    assert np.median(off) < 1e-6
    assert np.quantile(off, 0.99) < 5e-4
    assert off.max() < 2e-3
    # The hole of 24 pixels stays about as large.
    inner = (abs(x) < 0.45) & (abs(y) < 0.3)
    assert 15 <= np.isnan(depth_m[inner]).sum() <= 60


def test_distortion_is_refused_where_it_would_be_ignored():
    capture = capture_with(BARREL, through(BARREL))
    for use in (prepare, sensed):
        with pytest.raises(InputError, match="a camera with lens distortion"):
            use(capture)


def test_a_depth_camera_of_its_own_with_distortion():
    # The plane that it sees through its lens, from 20 mm beside, on the colour camera's pixels.
    from rakelight.geometry.distortion import to_rays
    from rakelight.model import RigidTransform

    pose = RigidTransform(np.eye(3), np.array([0.02, 0.0, 0.0]))
    own = Camera(80, 60, 60.0, 60.0, 39.0, 30.0, BARREL)
    u, v = np.meshgrid(np.arange(80.0), np.arange(60.0))
    x, y = to_rays(u, v, own)
    depth_m = (1 / (1 + 0.3 * x - 0.2 * y))[None].astype(np.float32)
    plain = replace(capture_with(None, np.full((HEIGHT, WIDTH), 0.5)), depth_m=depth_m)
    off = []
    for lens in (BARREL, None):
        camera = replace(own, distortion=lens)
        capture = replace(plain, depth_camera=camera, depth_to_color=pose)
        assert undistorted(capture) is capture
        found_m, _ = sensed(capture)
        x, y = rays(capture.camera.resized(*found_m.shape[::-1]))
        # n.X = 1 in the depth camera's frame, moved.
        plane_m = (1 + 0.3 * 0.02) / (1 + 0.3 * x - 0.2 * y)
        inner = (abs(x) < 0.4) & (abs(y) < 0.3)
        assert np.isfinite(found_m[inner]).all()
        off.append(np.abs(found_m - plane_m)[inner].max())
    assert off[0] < 1e-6
    assert off[1] > 1e-3


SIDES = {
    "left": (slice(30, 60), slice(0, 30)), "right": (slice(30, 60), slice(90, 120)),
    "bottom": (slice(60, 90), slice(45, 75)), "top": (slice(0, 30), slice(45, 75)),
}  # fmt: skip


@pytest.mark.parametrize("side", SIDES)
def test_the_image_grows_on_the_side_of_the_object(side):
    mask = np.zeros((HEIGHT, WIDTH), bool)
    mask[SIDES[side]] = True
    lens = Distortion("brown-conrady", [-0.25, 0.05, 0.0, 0.0, 0.0])
    capture = capture_with(lens, through(lens), mask)
    ideal = undistorted(capture)
    assert ideal.camera.shape != capture.camera.shape
    found = to_linear(ideal.photographs[0, ..., 0], "linear")
    assert np.abs(found - pattern(*rays(ideal.camera)))[ideal.mask].max() < 0.03
    shown = shown_by_lens(ideal.mask, ideal.camera, capture.camera)
    assert (shown & mask).sum() > 0.95 * mask.sum()


@pytest.mark.parametrize(("u", "v"), [(4.4, 5.0), (5.6, 5.0), (5.0, 4.4), (5.0, 5.6)])
def test_a_saturated_neighbour_is_not_mixed_in(u, v):
    values = np.full((11, 11, 1), 0.5, np.float32)
    values[5, 5] = 1.0
    out = np.empty((1, 1, 1), np.float32)
    place, jacobian = np.array([[[u, v]]]), np.broadcast_to(np.eye(2), (1, 1, 2, 2))
    limits = np.float32(0.99), np.float32(0.0)
    resample(0, 1, values, place, jacobian, *limits, _lanczos(), np.empty(1), out)
    assert out[0, 0, 0] == 1.0
