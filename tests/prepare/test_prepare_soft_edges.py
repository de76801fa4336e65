"""Depth that is blurred across the object's outline."""

import cv2
import numpy as np
import pytest

from rakelight.geometry.grid import area_mean
from rakelight.model import Camera, Capture
from rakelight.prepare import prepare
from rakelight.prepare.sensor import sensed
from rakelight.prepare.soft_edges import edge_blur, mixed_with_background
from rakelight.synthetic.noise import flying_pixels

ROWS, COLUMNS = np.mgrid[:160, :160]
SHAPES = {
    "disc": np.hypot(ROWS - 80, COLUMNS - 80) < 30,
    "square": np.maximum(abs(ROWS - 80), abs(COLUMNS - 80)) < 25,
    "diamond": abs(ROWS - 80) + abs(COLUMNS - 80) < 35,
}
NOISE_M = 0.001


def depth_of(inside, gap_m=0.3):
    """A wavy object half a metre away before a wall, metres."""
    return np.where(inside, 0.5 + 0.01 * np.cos(ROWS / 9) * np.cos(COLUMNS / 7), 0.52 + gap_m)


def noisy(depth):
    return depth + NOISE_M * np.random.default_rng(3).normal(size=depth.shape)


def blurred(depth, sigma_px):
    return cv2.GaussianBlur(depth, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("sigma_px", [1.5, 2.5, 5.0])
@pytest.mark.parametrize("gap_m", [0.1, 0.3, 2.0])
def test_how_far_a_map_is_blurred(shape, sigma_px, gap_m):
    inside = SHAPES[shape]
    found = edge_blur(noisy(blurred(depth_of(inside, gap_m), sigma_px)), inside)
    assert 0.95 * sigma_px < found < 1.35 * sigma_px


@pytest.mark.parametrize("shape", SHAPES)
def test_a_shift_is_no_blur_and_changes_none(shape):
    inside = SHAPES[shape]
    depth = noisy(depth_of(inside))
    assert edge_blur(np.roll(depth, (3, -2), (0, 1)), inside) == 0
    soft = noisy(blurred(depth_of(inside), 2.0))
    moved = edge_blur(np.roll(soft, (1, -2), (0, 1)), inside)
    assert moved == pytest.approx(edge_blur(soft, inside), rel=0.15)


def test_a_bilinear_ramp_is_a_blur():
    inside = SHAPES["disc"]
    small = cv2.resize(depth_of(inside), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    large = cv2.resize(small, inside.shape, interpolation=cv2.INTER_LINEAR)
    assert 1.5 < edge_blur(large, inside) < 3.0


@pytest.mark.parametrize("seed", range(5))
def test_mixed_and_flying_pixels_are_no_blur(seed):
    rng = np.random.default_rng(seed)
    inside = SHAPES["disc"]
    fine = np.hypot(*(np.mgrid[:640, :640] - 319.3)) < 121.7
    mixed = area_mean(np.where(fine, 0.5, 0.8), 4)
    assert edge_blur(noisy(mixed), area_mean(fine, 4) >= 0.5) == 0
    # Where more of the rim's pixels fly it is called blurred: it is mixed with the background.
    depth = flying_pixels(depth_of(inside), 0.02, 0.6, rng)
    assert (depth != depth_of(inside)).sum() > 150
    assert edge_blur(noisy(depth), inside) == 0


def test_an_objects_own_relief_is_no_blur():
    """Of a ball on a wall, whose sides are as deep as the wall is far."""
    inside = SHAPES["disc"]
    ball = 0.62 - 0.1 * np.sqrt(np.maximum(1 - ((ROWS - 80) ** 2 + (COLUMNS - 80) ** 2) / 900, 0))
    assert edge_blur(noisy(np.where(inside, ball, 0.63)), inside) == 0


def on_table(shape, slant_deg):
    """Depth of what stands on a table that is seen at a slant, metres, and where it is."""
    slant = np.deg2rad(slant_deg)
    up, across = (0, -np.sin(slant), -np.cos(slant)), (0, np.cos(slant), -np.sin(slant))
    pixels = np.stack([COLUMNS - 79.5, ROWS - 79.5, np.full(ROWS.shape, 600.0)], axis=-1) / 600
    rays = pixels @ np.transpose([(1, 0, 0), across, up])
    camera = -0.6 * np.array([0, across[2], up[2]])  # the object's middle is the origin
    half = np.array([0.025, 0.025, 0.025 if shape == "ball" else 0.015])
    with np.errstate(invalid="ignore"):
        if shape == "ball":
            ray, start = rays / half, camera / half
            square, along = (ray**2).sum(axis=-1), ray @ start
            depth = (-along - np.sqrt(along**2 - square * (start @ start - 1))) / square
        else:
            ends = np.sort([(side * half - camera) / rays for side in (-1, 1)], axis=0)
            first, last = ends[0].max(axis=-1), ends[1].min(axis=-1)
            depth = np.where(first < last, first, np.nan)
    table = (-half[2] - camera[2]) / rays[..., 2]
    return np.fmin(depth, table), np.isfinite(depth)


@pytest.mark.parametrize("shape", ["ball", "box"])
@pytest.mark.parametrize("slant_deg", [30, 45, 60, 70])
def test_the_slope_of_a_table_is_no_blur_and_hides_none(shape, slant_deg):
    depth, inside = on_table(shape, slant_deg)
    assert edge_blur(noisy(depth), inside) == 0
    assert 0.95 * 1.5 < edge_blur(noisy(blurred(depth, 1.5)), inside) < 1.35 * 1.5


@pytest.mark.parametrize("behind", [np.nan, 0.51])
def test_without_a_background_nothing_is_found(behind):
    inside = SHAPES["disc"]
    depth = np.where(inside, blurred(depth_of(inside), 2.0), behind)
    assert edge_blur(depth, inside) == 0
    assert edge_blur(depth, np.ones_like(inside)) == 0
    assert edge_blur(depth, np.zeros_like(inside)) == 0


def test_what_stays_is_right():
    inside = SHAPES["disc"]
    truth = depth_of(inside)
    soft = blurred(truth, 2.0)
    flat = blurred(np.where(inside, truth, 0.5), 2.0)  # as blurred, without a background
    mixed = mixed_with_background(soft, np.full(soft.shape, NOISE_M), inside.astype(float))
    off = soft - flat
    assert off[inside].max() > 0.1
    assert not mixed[~inside].any()
    assert abs(off[inside & ~mixed]).max() < 3 * NOISE_M
    assert 0.2 < mixed[inside].mean() < 0.5


def test_the_rims_of_a_narrow_gap_are_left_out_too():
    inside = SHAPES["disc"] & ~(abs(ROWS - 80) < 4)
    soft = blurred(depth_of(inside), 1.5)
    mixed = mixed_with_background(soft, np.full(soft.shape, NOISE_M), inside.astype(float))
    beside_gap = inside & (abs(ROWS - 80) < 6) & (abs(COLUMNS - 80) < 15)
    assert (soft[beside_gap] > 0.54).all()
    assert mixed[beside_gap].all()


def test_of_a_narrow_object_the_least_mixed_part_stays():
    inside = np.hypot(ROWS - 80, COLUMNS - 80) < 6
    soft = blurred(depth_of(inside), 2.5)
    mixed = mixed_with_background(soft, np.full(soft.shape, 1e-4), inside.astype(float))
    left = inside & ~mixed
    assert left.sum() == pytest.approx(0.2 * inside.sum(), abs=2)
    assert np.median(soft[left]) < np.quantile(soft[inside], 0.3)


def soft_capture(factor=4, sigma_px=1.5):
    """A capture of a disc, its depth blurred by so many depth pixels."""
    inside = cv2.resize(SHAPES["disc"].astype(np.uint8), None, fx=factor, fy=factor) > 0
    camera = Camera(*inside.shape[::-1], 800.0, 800.0, 320.0, 320.0)
    photographs = np.where(inside[..., None], np.full(3, 90, np.uint8), np.uint8(40))
    depth = blurred(depth_of(SHAPES["disc"]), sigma_px).astype(np.float32)
    return Capture(np.stack([photographs] * 4), depth[None], inside, camera)


def test_the_prepared_depth_is_the_objects():
    capture = soft_capture()
    truth = depth_of(SHAPES["disc"])
    prepared = prepare(capture)
    error = prepared.embed(prepared.depth_m, np.nan)[2::4, 2::4] - truth
    assert np.nanmax(np.abs(error[SHAPES["disc"]])) < 0.012
    assert np.isfinite(error[SHAPES["disc"]]).all()
    assert not prepared.sensor.measured.all()


def test_the_noise_is_that_of_what_stays():
    capture = soft_capture()
    _, sigma = sensed(capture, capture.mask)
    sharp = soft_capture(sigma_px=0.01)
    _, expected = sensed(sharp, sharp.mask)
    there = np.isfinite(sigma) & SHAPES["disc"]
    assert np.median(sigma[there]) == pytest.approx(np.median(expected[there]), rel=0.1)
