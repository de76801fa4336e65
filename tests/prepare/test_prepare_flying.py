"""Flying pixels at ray-traced jumps that the sensor's optics blur; slopes and thin things stay."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from rakelight.geometry.grid import area_mean
from rakelight.model import Camera, Capture, SensorNoise
from rakelight.prepare import prepare
from rakelight.prepare.flying import flying, stray
from rakelight.synthetic.implicit import Solid, trace
from tests.prepare.ray_traced import depth_of

CAMERA = Camera(320, 240, fx=300.0, fy=302.0, cx=160.7, cy=118.0)
SIGMA = SensorNoise()


def find(depth, camera=CAMERA):
    return flying(depth, SIGMA.at(depth), camera)


def wrong_by(depth, truth):
    """Distance of each depth from the nearest true one within a pixel."""
    nearby = sliding_window_view(np.pad(truth, 1, mode="edge"), (3, 3)).reshape(*truth.shape, 9)
    return np.abs(nearby - depth[..., None]).min(axis=-1)


@pytest.fixture(scope="module")
def fine():
    """The scene of ball, post and wall by four rays per pixel and side, and by one."""
    return depth_of(CAMERA.scaled(4)), depth_of(CAMERA)


@pytest.mark.parametrize("noisy", [False, True])
@pytest.mark.parametrize(
    ("blur_px", "kept_share"), [(0.0, 0.0), (0.3, 0.005), (0.5, 0.03), (1.0, 0.04)]
)
def test_mixed_pixels_are_found(fine, blur_px, kept_share, noisy):
    rays, truth = fine
    depth = area_mean(gaussian_filter(rays, 4 * blur_px) if blur_px else rays, 4)
    if noisy:
        depth = depth + SIGMA.at(depth) * np.random.default_rng(0).normal(size=depth.shape)
    found, off = find(depth), wrong_by(depth, truth)
    mixed = off > 0.02
    assert mixed.sum() > 300
    assert (mixed & ~found).sum() <= kept_share * mixed.sum()
    # what else is left out lies at jumps, and is little
    jump = maximum_filter(truth, 5) - minimum_filter(truth, 5) > 0.03
    assert not (found & ~jump).any()
    assert (found & (off < 0.003)).sum() <= 0.1 * mixed.sum()


def test_a_jump_between_pixels_loses_nothing(fine):
    _, truth = fine
    found = find(truth)
    # between post and wall the ball is but two pixels wide in places
    assert found.sum() <= 10
    wall = truth > 0.97
    assert not (found & wall).any()


@pytest.mark.parametrize("tilt_deg", [30, 60, 75, 80, 84])
@pytest.mark.parametrize("noisy", [False, True])
def test_slopes_stay(tilt_deg, noisy):
    x = (np.arange(CAMERA.width) - CAMERA.cx) / CAMERA.fx
    depth = np.repeat(0.8 / (1 - x * np.tan(np.radians(tilt_deg)))[None], 40, axis=0)
    depth[(depth < 0.3) | (depth > 3)] = np.nan
    if noisy:
        depth = depth + SIGMA.at(depth) * np.random.default_rng(1).normal(size=depth.shape)
    assert np.isfinite(depth).sum() > 300
    assert not find(depth).any()


@pytest.mark.parametrize(("step_px", "width"), [(6, 7), (11, 7), (13, 9), (100, 9)])
def test_slopes_between_two_planes_stay_from_some_width_on(step_px, width):
    steps = np.r_[np.zeros(9), np.ones(width), np.zeros(9)] * step_px * 0.8 / CAMERA.fx
    depth = np.repeat(0.8 + np.cumsum(steps)[None], 5, axis=0)
    camera = CAMERA.cropped(slice(0, 5), slice(0, len(steps)))
    assert not flying(depth, np.zeros(depth.shape), camera).any()
    narrower = np.delete(depth, np.s_[10:13], axis=1)
    narrower[:, 10:] -= depth[:, 12:13] - depth[:, 9:10]
    assert flying(narrower, np.zeros(narrower.shape), camera)[:, 9:].any()


@pytest.mark.parametrize("radius_m", [0.02, 0.05, 0.2])
def test_limbs_stay(radius_m):
    ball = Solid(
        lambda x, y, z: np.sqrt(x**2 + y**2 + z**2) - radius_m, 0.8, radius_m=radius_m + 0.001
    )
    depth = trace(ball, CAMERA).depth
    assert np.isfinite(depth).sum() > 100
    assert not find(np.where(np.isfinite(depth), depth, 2.0)).any()
    assert not find(depth).any()


@pytest.mark.parametrize("pixels", [1, 2, 3])
@pytest.mark.parametrize("slant", [0.0, 0.004, 0.006])
def test_thin_things_stay(pixels, slant):
    # A post, a bar and a rod across, before a wall; they may lead far into the depth.
    rows, columns = np.indices(CAMERA.shape)
    along = [rows, columns, rows + columns]
    across = [columns - 60, rows - 120, columns - rows - 30]
    for line, distance in zip(along, across, strict=True):
        depth = np.full(CAMERA.shape, 12.0)
        on = (distance >= 0) & (distance < pixels)
        depth[on] = 0.7 + slant * line[on]
        assert not find(depth).any()


@pytest.mark.parametrize("steps", [2, 3])
def test_stairs_stay(steps):
    columns = np.indices(CAMERA.shape)[1]
    depth = 0.8 + 0.1 * (columns // steps % 7)
    assert not find(depth).any()


def test_holes_and_small_maps():
    assert not find(np.full(CAMERA.shape, np.nan)).any()
    for shape in ((1, 1), (1, 3), (3, 1), (2, 5)):
        assert not flying(np.ones(shape), np.full(shape, 1e-3), CAMERA).any()
    depth = np.full((9, 9), 1.0)
    depth[:, 5:] = 1.5
    depth[:, 4] = 1.25
    camera = Camera(9, 9, fx=300.0, fy=300.0, cx=4.0, cy=4.0)
    assert flying(depth, 0.001 * depth, camera)[:, 4].all()
    depth[:, 3] = np.nan  # one side is not known: it may be a surface
    assert not flying(depth, 0.001 * depth, camera).any()


# ---- stray pixels


def wall_with_strays(fraction=0.014, far_m=5.0):
    """A slanted noisy wall at 0.8 m of which some pixels, 4 apart or more, are far away."""
    rng = np.random.default_rng(3)
    rows, columns = np.mgrid[:120, :160]
    wall = 0.8 + 0.001 * columns + 0.002 * rng.normal(size=rows.shape)
    strays = np.zeros(wall.shape, bool)
    strays[2::5, 2::5] = rng.random((24, 32)) < 25 * fraction
    return np.where(strays, far_m, wall), strays


@pytest.mark.parametrize("far_m", [0.3, 5.0, 65.534])
def test_stray_pixels_are_found_and_nothing_else(far_m):
    depth, strays = wall_with_strays(far_m=far_m)
    assert strays.sum() > 100
    np.testing.assert_array_equal(stray(depth, SIGMA.at(depth), CAMERA), strays)


def test_wires_corners_and_edges_are_not_stray():
    depth = np.full((40, 60), 1.2)
    depth[20, :] = 0.8  # along, across and slanted, one pixel wide, and its ends
    depth[:, 30] = 0.8
    depth[np.arange(10), np.arange(10)] = 0.8
    depth[30:, 50:] = np.nan
    depth[25, 45:] = np.nan
    depth[5, 50], depth[4:7, 49:52] = 0.8, np.nan
    depth[5, 50] = 0.8  # alone in a hole: nobody contradicts it
    assert not stray(depth, SIGMA.at(depth), CAMERA).any()


def test_stray_pixels_are_filled_from_their_neighbours():
    depth, strays = wall_with_strays()
    camera = Camera(160, 120, fx=300.0, fy=300.0, cx=79.5, cy=59.5)
    capture = Capture(
        photographs=np.full((1, 120, 160, 3), 90, np.uint8),
        depth_m=depth[None].astype(np.float32),
        mask=np.ones(depth.shape, bool),
        camera=camera,
    )
    prepared = prepare(capture)
    assert np.abs(prepared.embed(prepared.depth_m, np.nan)[strays] - 0.88).max() < 0.1
