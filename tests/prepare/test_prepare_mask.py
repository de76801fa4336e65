"""The nearest object cut out of scenes with a background, and doubt where there is cause."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from rakelight.capture import load_capture, write_capture
from rakelight.errors import CaptureError
from rakelight.geometry.camera import pixel_rays
from rakelight.model import Camera, Capture, RigidTransform, SensorNoise
from rakelight.prepare import prepare
from rakelight.prepare.mask import _frame, behind_planes, cut_out, nearest_object
from rakelight.synthetic.implicit import Solid, seen_from, trace

REAL = Path(__file__).parents[3] / "shared" / "captures"
COLOUR = Camera(320, 240, fx=310.0, fy=310.0, cx=161.0, cy=118.0)
PAINT = np.array([[0.75, 0.3, 0.25], [0.35, 0.4, 0.45], [0.25, 0.6, 0.3]])


def ball(x, y, z, at=(0.0, 0.0, 0.0), radius=0.1):
    return np.sqrt(sum((a - b) ** 2 for a, b in zip((x, y, z), at, strict=True))) - radius


def disc(x, y, z):
    """It floats before the ball."""
    return ball(x, y, 5 * (z - 0.2), radius=0.03) / 5


def ring(x, y, z):
    return np.sqrt((np.sqrt(x**2 + y**2 + 1e-12) - 0.08) ** 2 + z**2) - 0.03


def box(x, y, z):
    """0.16 m wide, its front towards the camera."""
    sides = [np.where(q.real < 0, -q, q) - 0.08 for q in (x, y + 0.02, z)]
    largest = sides[0]
    for side in sides[1:]:
        largest = np.where(largest.real > side.real, largest, side)
    return largest


def wall(x, y, z):
    return z + 0.3 + 0.1 * x


def table(x, y, z):
    """Seen from 35 degrees above; it carries a ball of 0.1 m in the middle."""
    slope = np.radians(35.0)
    return y * np.cos(slope) + z * np.sin(slope) + 0.1


def union(*things):
    def field(x, y, z):
        values = [thing(x, y, z) for thing in things]
        nearest = values[0]
        for value in values[1:]:
            nearest = np.where(nearest.real < value.real, nearest, value)
        return nearest

    return field


def scene(*things, noisy=True, paint=PAINT):
    """A capture of things (fields), each with its paint, and where the first is seen."""

    solid = Solid(union(*things), 0.8, radius_m=0.75, steepness=1.1)
    seen = trace(solid, COLOUR)
    x, y = pixel_rays(COLOUR)
    at = [seen.depth * x / COLOUR.fx, -seen.depth * y / COLOUR.fy, 0.8 - seen.depth]
    which = np.argmin(np.abs([thing(*at) for thing in things]), axis=0)
    random = np.random.default_rng(0)
    texture = 1 + 0.15 * random.normal(size=COLOUR.shape).repeat(3).reshape(*COLOUR.shape, 3)
    photographs = []
    for toward in ([0.3, -0.2, -0.9], [-0.4, -0.1, -0.9], [0.1, 0.4, -0.9]):
        shade = 0.15 + np.maximum(np.nan_to_num(seen.normals @ np.array(toward)), 0)
        photographs.append(0.7 * shade[..., None] * paint[which] * texture)
    sensor = COLOUR.resized(160, 120)
    depth = trace(solid, sensor).depth
    if noisy:
        depth = depth + SensorNoise().at(depth) * random.normal(size=depth.shape)
    object_mask = (which == 0) & np.isfinite(seen.depth)
    capture = Capture(
        photographs=np.round(65535 * np.clip(photographs, 0, 1)).astype(np.uint16),
        depth_m=depth[None].astype(np.float32),
        mask=np.ones(COLOUR.shape, bool),
        camera=COLOUR,
    )
    return capture, object_mask


def overlap(found, truth):
    return (found & truth).sum() / (found | truth).sum()


def cut(capture):
    mask, (finding,) = cut_out(capture)
    assert finding.code == "no-mask"
    assert mask.shape == capture.camera.shape
    assert "mask.png" in finding.remedy
    return mask, finding


def test_an_object_before_a_wall():
    capture, truth = scene(ball, wall)
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.98
    assert finding.severity == "note"
    assert f"{mask.mean():.1%} of the image" in finding.message


def test_an_object_on_a_table():
    # The table is nearer than the ball at the bottom of the image, and touches it.
    capture, truth = scene(ball, table)
    assert np.nanmin(capture.depth_m) < 0.65
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.98
    assert finding.severity == "note"


def test_an_object_on_a_table_before_a_wall():
    capture, truth = scene(ball, table, wall)
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.98
    assert finding.severity == "note"


def test_of_two_objects_the_nearer_with_a_warning():
    near = partial(ball, at=(-0.12, 0.0, 0.05), radius=0.08)
    far = partial(ball, at=(0.12, 0.0, 0.0), radius=0.08)
    capture, truth = scene(near, wall, far)
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.98
    assert finding.severity == "warning"
    assert "another one is 0.7" in finding.message


def test_a_far_object_is_no_rival():
    far = partial(ball, at=(0.2, 0.0, -0.2), radius=0.08)
    capture, truth = scene(ball, wall, far)
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.98
    assert finding.severity == "note"


@pytest.mark.parametrize("background", [wall, table])
def test_nothing_that_is_nearer_than_the_rest(background):
    capture, _ = scene(background)
    mask, finding = cut(capture)
    assert finding.severity == "warning"
    assert "nothing stands out" in finding.message
    np.testing.assert_array_equal(mask, np.isfinite(capture.depth_m[0]).repeat(2, 0).repeat(2, 1))


def test_an_object_at_the_frame_is_doubtful():
    low = partial(ball, at=(0.0, -0.28, 0.0), radius=0.15)
    capture, truth = scene(low, wall)
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.98
    assert finding.severity == "warning"
    assert "edge of the image" in finding.message


def test_a_very_small_object_is_doubtful():
    small = partial(ball, at=(0.05, 0.0, 0.0), radius=0.022)
    capture, truth = scene(small, wall)
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.8
    assert finding.severity == "warning"
    assert "very small" in finding.message


def test_depth_alone_where_colours_say_nothing():
    capture, truth = scene(ball, wall, paint=np.full((2, 3), 0.5))
    mask, _ = cut(capture)
    assert overlap(mask, truth) > 0.98


def test_what_has_depth_alone_is_the_object():
    # Scans whose background was removed: nothing to choose from.
    capture, truth = scene(ball)
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.98
    assert finding.severity == "note"


def test_parts_belong_to_the_object():
    # All around the disc is the ball.
    capture, _ = scene(ball, wall, disc)
    mask, _ = cut(capture)
    assert mask[COLOUR.shape[0] // 2, COLOUR.shape[1] // 2]
    _, truth = scene(ball, wall)
    assert overlap(mask, truth) > 0.98


def test_a_box_stands_out():
    # Its front is a plane, but none that reaches the frame.
    capture, truth = scene(box, table, wall)
    mask, finding = cut(capture)
    assert overlap(mask, truth) > 0.98
    assert finding.severity == "note"


def flat_on_a_table(rows, columns, height_m):
    """A depth map, its noise and camera, and where an object with a flat top is."""
    sensor = COLOUR.resized(160, 120)
    truth = np.zeros(sensor.shape, bool)
    truth[rows, columns] = True
    depth = np.where(truth, 0.8 - height_m, 0.8)
    sigma = SensorNoise().at(depth)
    depth += sigma * np.random.default_rng(0).normal(size=depth.shape)
    return depth, sigma, sensor, truth


@pytest.mark.parametrize("height_m", [0.01, 0.0125])
def test_a_flat_object_that_fills_half_of_the_image(height_m):
    # A plane between its top and the table is within 5 mm and three deviations of both.
    *sensed, truth = flat_on_a_table(slice(18, 102), slice(20, 140), height_m)
    found = nearest_object(*sensed)
    assert overlap(found.mask, truth) > 0.95
    assert found.reasons == ()


def test_a_flat_object_as_high_as_a_thing_at_the_frame():
    depth, *sensed, truth = flat_on_a_table(slice(30, 90), slice(40, 120), 0.02)
    depth[:16, :16] -= 0.02
    found = nearest_object(depth, *sensed)
    assert overlap(found.mask, truth) > 0.95
    assert found.reasons == ()


def test_holes_in_the_depth_are_the_objects_holes_in_the_object_are_not():
    capture, truth = scene(ball, wall)
    depth = capture.depth_m.copy()
    depth[0, 55:60, 75:90] = np.nan
    mask, _ = cut(replace(capture, depth_m=depth))
    assert overlap(mask, truth) > 0.98
    assert mask[110:120, 150:180].all()
    capture, truth = scene(ring, wall)
    mask, _ = cut(capture)
    assert not mask[118, 161]
    assert overlap(mask, truth) > 0.98


@pytest.mark.parametrize("beside", [False, True])
def test_captures_without_a_mask_are_read_with_the_objects(tmp_path, beside):
    capture, truth = scene(ball, wall)
    if beside:
        sensor = Camera(140, 110, fx=137.0, fy=137.0, cx=70.0, cy=54.0)
        pose = RigidTransform(np.eye(3), np.array([0.04, 0.0, 0.0]))
        solid = Solid(union(ball, wall), 0.8, radius_m=0.75, steepness=1.1)
        depth = trace(seen_from(solid, pose), sensor).depth[None].astype(np.float32)
        capture = replace(capture, depth_m=depth, depth_camera=sensor, depth_to_color=pose)
    dark = capture.photographs // 8
    dark[:, truth] = capture.photographs[:, truth]  # what is behind would not do for an object
    dark[:, ~truth] //= 100
    write_capture(replace(capture, photographs=dark), tmp_path / "made")
    (tmp_path / "made" / "mask.png").unlink()
    read = load_capture(tmp_path / "made")
    assert overlap(read.mask, truth) > 0.95
    (note,) = [finding for finding in read.findings if finding.code == "no-mask"]
    assert note.severity == "note"
    assert "median depth" in " ".join(finding.message for finding in read.findings)
    prepared = prepare(read)
    assert note in prepared.findings
    assert overlap(prepared.embed(prepared.mask, 0) > 0, truth) > 0.95


def test_cameras_that_look_elsewhere(tmp_path):
    capture, _ = scene(ball, wall)
    away = RigidTransform(np.diag([-1.0, 1.0, -1.0]), np.zeros(3))
    sensor = COLOUR.resized(160, 120)
    write_capture(replace(capture, depth_camera=sensor, depth_to_color=away), tmp_path / "made")
    (tmp_path / "made" / "mask.png").unlink()
    with pytest.raises(CaptureError, match="sees nothing of what has depth"):
        load_capture(tmp_path / "made")


@pytest.mark.parametrize(("name", "least"), [("mitten", 0.88), ("android", 0.97), ("monkey", 0.98)])
def test_masks_that_people_drew(name, least):
    if not (REAL / name).is_dir():
        pytest.skip("the real captures are not here")
    capture = load_capture(REAL / name)
    few = replace(capture.select([0]), depth_m=capture.depth_m[:4])
    mask, finding = cut(replace(few, mask=np.ones_like(capture.mask)))
    # the mitten's was drawn inside its outline
    assert overlap(mask, capture.mask) > least
    assert (mask & capture.mask).sum() > 0.97 * capture.mask.sum()
    assert finding.severity == "note"


WIDE = Camera(60, 50, fx=60.0, fy=60.0, cx=29.5, cy=24.5)


@pytest.mark.parametrize("at_m", [0.3, 3.0])
def test_planes_are_found_near_and_far(at_m):
    v, u = np.mgrid[:50, :60]
    depth = at_m + 0.002 * np.sin(u) * np.cos(v)
    depth[20:30, 20:35] -= 0.03
    plane = np.ones(depth.shape, bool)
    plane[20:30, 20:35] = False
    found = behind_planes(depth, np.full(depth.shape, 1e-4), WIDE, _frame(depth.shape))
    np.testing.assert_array_equal(found, plane)


def test_what_is_seen_through_a_wall_is_behind_it():
    depth = np.ones((50, 60))
    depth[20:30, 20:35] = 1.5
    assert behind_planes(depth, np.full(depth.shape, 1e-3), WIDE, _frame(depth.shape)).all()
