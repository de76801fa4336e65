"""The sensor's grid beside the photographs', and depth of a camera of its own on its way in."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rakelight.errors import CaptureError, InputError
from rakelight.geometry.grid import area_mean
from rakelight.model import Camera, Capture, RigidTransform, SensorNoise
from rakelight.prepare import prepare
from rakelight.prepare.sensor import SensorDepth, SensorGrid, _lookup, overlaps, sensed
from tests.prepare.ray_traced import COLOUR, POSE, depth_of

HERE = RigidTransform(np.eye(3), np.zeros(3))
TRUTH = depth_of(COLOUR)
ROWS, COLUMNS = np.indices(COLOUR.shape)
# The part of the ball that is not behind the post.
BALL = (np.hypot(ROWS - COLOUR.cy, COLUMNS - COLOUR.cx) < 50) & (TRUTH > 0.69) & (TRUTH < 0.8)


def make_capture(factor=2.0, pose=POSE, colour=COLOUR, mask=BALL, **changes):
    """Random photographs, and depth of a camera at `pose` with `factor` times wider pixels."""
    depth_camera = colour.resized(round(colour.width / factor), round(colour.height / factor))
    values = np.random.default_rng(0).integers(9000, 50000, (3, *colour.shape, 3))
    capture = Capture(
        photographs=values.astype(np.uint16),
        depth_m=depth_of(depth_camera, pose)[None].astype(np.float32),
        mask=mask,
        camera=colour,
        depth_camera=depth_camera,
        depth_to_color=pose,
        source="here",
    )
    return replace(capture, **changes)


# ---- grids


@pytest.mark.parametrize(("count", "size"), [(3, 3), (3, 6), (4, 7), (5, 4), (2, 9), (1, 1)])
def test_overlaps_share_every_cell_out(count, size):
    shares = overlaps(np.arange(count + 1) * size / count, size).toarray()
    np.testing.assert_allclose(shares.sum(axis=0), 1)
    np.testing.assert_allclose(shares.sum(axis=1), size / count)
    # the mean position in a cell is its middle
    at = shares @ (np.arange(size) + 0.5) / (size / count)
    if size % count == 0:
        np.testing.assert_allclose(at, (np.arange(count) + 0.5) * size / count)


def test_overlaps_beyond_the_window_are_left_out():
    shares = overlaps(np.array([-1.5, 0.5, 2.5, 4.0]), 3).toarray()
    np.testing.assert_allclose(shares, [[0.5, 0, 0], [0.5, 1, 0.5], [0, 0, 0.5]])


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_blocks_are_a_special_case(factor):
    random = np.random.default_rng(0)
    mask = random.random((12, 18)) < 0.15
    grid = SensorGrid((12 // factor, 18 // factor), mask.shape)
    assert grid.factor == factor
    np.testing.assert_array_equal(grid.touched(mask), area_mean(mask, factor) > 0)
    image = random.random(grid.sensor)
    expected = image.repeat(factor, axis=0).repeat(factor, axis=1)
    np.testing.assert_array_equal(grid.nearest_upsample(image), expected)


def test_average_is_over_the_objects_part_of_a_pixel():
    random = np.random.default_rng(1)
    image, mask = random.random((8, 12)), random.random((8, 12)) < 0.6
    mask[:2, :2] = False
    rows, columns = np.arange(5) * 2.0, np.arange(7) * 2.0
    sensor = SensorDepth(np.ones((4, 6)), np.ones((4, 6)), rows, columns)
    total, count = (area_mean(part, 2) for part in (np.where(mask, image, 0), mask))
    found = sensor.averaging(mask).down(image)
    assert found[0, 0] == 0
    np.testing.assert_allclose(found[count > 0], (total / np.maximum(count, 0.1))[count > 0])


@pytest.mark.parametrize("sensor", [(20, 30), (27, 31), (60, 90)])
def test_averages_of_a_plane_are_its_values_at_the_middles(sensor):
    shape = (40, 60)
    grid = SensorGrid(sensor, shape)
    rows, columns = slice(7, 33), slice(11, 48)
    measured = np.ones(sensor, bool)
    window = grid.window(np.ones(sensor), np.ones(sensor), measured, rows, columns)
    v, u = np.indices(shape)[:, rows, columns]
    found = window.averaging(np.ones(v.shape, bool)).down(2.0 + 0.3 * v - 0.2 * u)
    middle_v, middle_u = (
        (edges[1:] + edges[:-1]) / 2 - 0.5 for edges in (window.row_edges, window.column_edges)
    )
    expected = 2.0 + 0.3 * (middle_v + 7)[:, None] - 0.2 * (middle_u + 11)[None]
    if all(side % small == 0 for side, small in zip(shape, sensor, strict=True)):
        np.testing.assert_allclose(found[1:-1, 1:-1], expected[1:-1, 1:-1], rtol=1e-12)
    else:  # a pixel is taken for level within itself
        assert np.abs(found - expected)[1:-1, 1:-1].max() < 0.3 * 0.5


@pytest.mark.parametrize(
    ("sensor", "shape", "fits"),
    [
        ((192, 256), (3024, 4032), True),
        ((192, 256), (1440, 1920), True),
        ((188, 250), (750, 1000), True),
        ((187, 250), (750, 1000), True),
        ((240, 427), (720, 1280), True),
        ((240, 426), (720, 1280), True),  # rounded down
        ((427, 240), (1280, 720), True),
        ((1, 1), (5, 5), True),
        ((192, 256), (720, 1280), False),
        ((256, 192), (3024, 4032), False),
        ((480, 639), (960, 1280), False),  # a column was cut off
        ((480, 848), (1080, 1920), False),
        ((960, 1280), (480, 640), False),
    ],
)
def test_sizes_fit_where_the_proportions_do(sensor, shape, fits):
    assert SensorGrid(sensor, shape).fits is fits


# ---- what a method is given


@pytest.mark.parametrize("sensor", [(21, 28), (32, 43), (48, 64)])
def test_aligned_depth_of_any_ratio_is_that_of_a_camera_in_the_same_place(sensor):
    """The latter is drawn as triangles on its own grid."""
    camera = COLOUR.resized(*sensor[::-1])
    depth = depth_of(camera)[None].astype(np.float32)
    same = {"depth_m": depth, "depth_noise": SensorNoise(0.001)}
    aligned = prepare(make_capture(**same, depth_camera=None, depth_to_color=None))
    own = prepare(make_capture(**same, depth_camera=camera, depth_to_color=HERE))
    assert aligned.factor == own.factor
    np.testing.assert_array_equal(aligned.mask, own.mask)
    np.testing.assert_allclose(aligned.depth_m[own.mask], own.depth_m[own.mask], atol=1e-6)
    np.testing.assert_allclose(aligned.sensor.depth_m, own.sensor.depth_m, atol=1e-6)
    np.testing.assert_array_equal(aligned.sensor.row_edges, own.sensor.row_edges)


@pytest.mark.parametrize("factor", [2.0, 1.754])
@pytest.mark.parametrize("pose", [HERE, POSE], ids=["same place", "beside"])
def test_depth_of_another_camera_is_prepared(factor, pose):
    prepared = prepare(make_capture(factor, pose))
    assert prepared.factor == pytest.approx(factor, rel=3e-3)
    assert prepared.full_camera == COLOUR
    # Denoising flattens the ball by 0.3 mm.
    depth = prepared.embed(prepared.depth_m, np.nan)
    error = np.median(np.abs(depth - TRUTH)[BALL])
    assert error < 0.4e-3
    for axis, pixels in ((0, 1), (0, -1), (1, 1), (1, -1)):
        shifted = np.roll(TRUTH, pixels, axis)
        assert np.median(np.abs(depth - shifted)[BALL]) > error + 0.05e-3
    # the post hides a little of the ball from the sensor
    assert prepared.measured[prepared.mask].mean() > 0.95


@pytest.mark.parametrize("factor", [2.0, 1.754])
def test_the_sensors_own_pixels_come_along(factor):
    prepared = prepare(make_capture(factor))
    sensor = prepared.sensor
    assert sensor.depth_m.shape == (len(sensor.row_edges) - 1, len(sensor.column_edges) - 1)
    assert sensor.measured.any()
    np.testing.assert_array_equal(np.isfinite(sensor.sigma_m), sensor.measured)
    expected = SensorNoise().at(sensor.depth_m)
    np.testing.assert_allclose(
        sensor.sigma_m[sensor.measured], expected[sensor.measured], rtol=0.04
    )
    # what the object really is, averaged over the sensor's pixels, is what the sensor measured
    truth = TRUTH[prepared.rows, prepared.columns]
    inner = sensor.averaging(np.ones(prepared.mask.shape, bool)).down(prepared.mask) > 0.999
    inner &= sensor.measured
    assert inner.sum() > 500
    error = np.abs(sensor.averaging(prepared.mask).down(truth) - sensor.depth_m)[inner]
    assert np.quantile(error, 0.99) < 1e-3
    assert np.median(error) < 0.1e-3


@pytest.mark.parametrize("factor", [2, 4])
def test_blocks_of_the_window(factor):
    camera = COLOUR.resized(COLOUR.width // factor, COLOUR.height // factor)
    prepared = prepare(
        make_capture(
            depth_m=depth_of(camera)[None].astype(np.float32),
            depth_camera=None,
            depth_to_color=None,
        )
    )
    assert prepared.factor == factor
    sensor = prepared.sensor
    for edges, part in (
        (sensor.row_edges, prepared.rows),
        (sensor.column_edges, prepared.columns),
    ):
        np.testing.assert_array_equal((edges + part.start) % factor, 0)
        assert edges[0] <= 0
        assert edges[-1] >= part.stop - part.start
    average = sensor.averaging(prepared.mask).down(prepared.measured)
    np.testing.assert_array_equal(average == 1, sensor.measured)


@pytest.mark.parametrize(("factor", "scales"), [(1.754, {1, 2}), (2.05, {1, 2}), (4.1, {2, 4})])
def test_scales_are_named_by_the_nearest_whole_number(factor, scales):
    capture = make_capture(factor)
    for scale in scales:
        prepared = prepare(capture, scale)
        shrink = COLOUR.width / prepared.full_camera.width
        assert shrink % 1 == 0
        assert prepared.factor == pytest.approx(factor / shrink, rel=0.01)
        assert max(round(prepared.factor), 1) == scale
    with pytest.raises(InputError, match="does not have that resolution"):
        prepare(capture, 7)


def test_the_capture_says_how_noisy_its_sensor_is():
    noise = SensorNoise(sigma_m=0.004, at_m=0.5, growth=1.0)
    prepared = prepare(make_capture(depth_noise=noise))
    seen = prepared.measured & prepared.mask
    expected = 0.004 * TRUTH[prepared.rows, prepared.columns] / 0.5
    # but for pixels that the sensor shares with the post
    assert np.quantile(np.abs(prepared.sigma_m / expected - 1)[seen], 0.99) < 0.03


def test_flying_pixels_of_the_object_are_not_measured():
    camera = COLOUR.resized(COLOUR.width // 2, COLOUR.height // 2)
    depth = area_mean(depth_of(camera.scaled(4)), 4)[None].astype(np.float32)
    mask = (TRUTH < 0.8) & (np.hypot(ROWS - COLOUR.cy, COLUMNS - COLOUR.cx) < 70)
    capture = make_capture(depth_m=depth, mask=mask, depth_camera=None, depth_to_color=None)
    prepared = prepare(capture)
    sensor = prepared.sensor
    # the sensor's depth beside the post is the post's, the ball's, or the wall's
    beyond = (sensor.depth_m > 0.83) & (sensor.depth_m < 0.95)
    assert not beyond.any()
    raw = depth[0][SensorGrid(camera.shape, mask.shape).touched(mask)]
    assert ((raw > 0.83) & (raw < 0.95)).any()


def test_cameras_of_no_depth_map():
    with pytest.raises(CaptureError, match="depth_m and depth camera are of different size"):
        prepare(make_capture(depth_camera=Camera(9, 7, 10.0, 10.0, 4.0, 3.0)))


def test_points_beside_a_picture_are_not_in_it():
    points = np.array([[[1.6, 0.0, 1.0], [-1.0, 0.0, 1.0], [2.0, -1.0, 1.0], [np.nan] * 3]])
    mask = np.array([[False, False, True]])
    assert _lookup(mask, points).tolist() == [[True, False, False, False]]


@pytest.mark.parametrize("own", [False, True], ids=["aligned", "a camera of its own"])
def test_ramps_into_holes_are_no_measurements(own):
    depth = np.full((40, 40), 0.8)
    depth[18:22, 18:22] = 0
    depth = cv2.resize(depth, (160, 160))  # as a hole that was interpolated
    depth_m = np.where(depth > 0, depth, np.nan)[None].astype(np.float32)
    camera, mask = Camera(160, 160, 200.0, 200.0, 79.5, 79.5), np.ones((160, 160), bool)
    capture = Capture(
        np.full((3, 160, 160, 3), 90, np.uint8), depth_m, mask, camera,
        depth_camera=camera if own else None,
        depth_to_color=RigidTransform(np.eye(3), np.zeros(3)) if own else None,
    )  # fmt: skip
    assert np.nanmin(sensed(capture, mask)[0]) > 0.795
