"""A capture that is turned is prepared and refined as it was: rows are no different from columns.

Of a camera whose focal lengths differ by far, so that to take one for the other shows.
"""

from dataclasses import replace

import numpy as np
import pytest

from rakelight import Camera, refine
from rakelight.geometry.grid import Links, surface_links
from rakelight.geometry.normals import surface_normals
from rakelight.prepare.background import beside_the_object
from rakelight.prepare.flying import flying, stray
from rakelight.prepare.jumps import without_measured_jumps
from rakelight.prepare.mask import behind_planes, nearest_object
from rakelight.prepare.surfaces import surfaces
from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

SHAPE = (40, 56)
CAMERA = Camera(56, 40, fx=130.0, fy=470.0, cx=26.3, cy=21.1)
SEEDS = range(30)


def turned(image):
    """Rows for columns, of an image (h, w) or (h, w, 3) whose last axis is x, y, z."""
    other = image.swapaxes(0, 1)
    return np.ascontiguousarray(other if image.ndim == 2 else other[..., [1, 0, 2]])


def turned_camera(camera):
    return Camera(camera.height, camera.width, camera.fy, camera.fx, camera.cy, camera.cx)


def boxes(seed, missing=40):
    """(h, w) depth of a slanted wall with boxes before it, noise, and pixels that fly."""
    rng = np.random.default_rng(seed)
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    depth_m = 1 + 0.0006 * (column - 28) + 0.0011 * (row - 20)
    for _ in range(4):
        top, left = rng.integers(4, SHAPE[0] - 10), rng.integers(4, SHAPE[1] - 10)
        height, width = rng.integers(3, 12, 2)
        depth_m[top : top + height, left : left + width] -= rng.uniform(0.005, 0.2)
    depth_m.flat[rng.integers(0, depth_m.size, 30)] += rng.uniform(-0.1, 0.1, 30)
    depth_m += rng.normal(scale=3e-4, size=SHAPE)
    depth_m.flat[rng.integers(0, depth_m.size, missing)] = np.nan
    return depth_m


def noise(depth_m):
    return np.where(np.isfinite(depth_m), 0.001 * depth_m, 0.001)


def window():
    """(h, w) the pixels that see some of an object, and those that see nothing else."""
    touched, covered = (np.zeros(SHAPE, bool) for _ in range(2))
    touched[5:33, 6:40] = covered[6:32, 7:39] = True
    return touched, covered


def is_beside(depth_m, camera):
    both = window()
    if depth_m.shape != SHAPE:
        both = tuple(turned(each) for each in both)
    return beside_the_object(depth_m, *both, camera, 2.0)


def is_behind_planes(depth_m, camera):
    frame = np.ones(depth_m.shape, bool)
    frame[2:-2, 2:-2] = False
    return behind_planes(depth_m, noise(depth_m), camera, frame)


def object_of(depth_m, camera):
    found = nearest_object(depth_m, noise(depth_m), camera)
    return np.zeros(depth_m.shape, bool) if found is None else found.mask


def same_surface(depth_m, camera):
    """(h, w) whether each pixel is on the surface of the middle one."""
    numbers, _ = surfaces(depth_m, camera)
    middle = numbers[tuple(side // 2 for side in numbers.shape)]
    return numbers == middle


IMAGES = {
    "stray": lambda depth_m, camera: stray(depth_m, noise(depth_m), camera),
    "flying": lambda depth_m, camera: flying(depth_m, noise(depth_m), camera),
    "beside the object": is_beside,
    "behind planes": is_behind_planes,
    "nearest object": object_of,
    "surfaces": same_surface,
}


@pytest.mark.parametrize("name", IMAGES)
def test_masks_of_turned_depth_are_turned(name):
    some = 0
    for seed in SEEDS:
        depth_m = boxes(seed)
        expected = IMAGES[name](depth_m, CAMERA)
        found = IMAGES[name](turned(depth_m), turned_camera(CAMERA))
        np.testing.assert_array_equal(turned(found), expected)
        some += 0 < np.count_nonzero(expected) < expected.size
    assert some > len(SEEDS) / 3


def whole(depth_m):
    return np.ones(depth_m.shape, bool)


LINKS = {
    "surface": lambda depth_m, camera: surface_links(depth_m, whole(depth_m), camera),
    "measured jumps": lambda depth_m, camera: without_measured_jumps(
        Links.of(whole(depth_m)), depth_m, camera
    ),
}


@pytest.mark.parametrize("name", LINKS)
def test_links_of_turned_depth_are_turned(name):
    cut = 0
    for seed in SEEDS:
        depth_m = boxes(seed, missing=0)
        expected = LINKS[name](depth_m, CAMERA)
        found = LINKS[name](turned(depth_m), turned_camera(CAMERA))
        np.testing.assert_array_equal(turned(found.right), expected.down)
        np.testing.assert_array_equal(turned(found.down), expected.right)
        cut += np.count_nonzero(~expected.right[:, :-1])
    assert cut > 100


def test_normals_of_turned_depth_are_turned():
    depth_m = boxes(0)
    measured = np.isfinite(depth_m)
    expected = surface_normals(depth_m, measured, CAMERA)
    found = surface_normals(turned(depth_m), turned(measured), turned_camera(CAMERA))
    np.testing.assert_allclose(turned(found), expected, atol=1e-12)


def narrow_scene(photographs, lighting):
    """A cloth seen by pixels that are twice as wide as high."""
    shape = make_shape("cloth")
    camera = shape.camera.scaled(0.2)
    camera = replace(camera, width=camera.width // 2, fx=camera.fx / 2, cx=(camera.cx - 0.5) / 2)
    options = SceneOptions(
        camera=camera, photographs=photographs, lighting=lighting, image_noise=0.005,
        depth_noise=DepthNoise(rms_mm=1.0),
    )  # fmt: skip
    return render_scene(shape, make_albedo("pattern"), options)[0]


def turned_capture(capture):
    return replace(
        capture,
        photographs=np.ascontiguousarray(capture.photographs.swapaxes(1, 2)),
        depth_m=np.ascontiguousarray(capture.depth_m.swapaxes(1, 2)),
        mask=turned(capture.mask),
        camera=turned_camera(capture.camera),
    )


@pytest.mark.parametrize(
    ("method", "photographs", "lighting", "largest_deg", "largest_mm"),
    [
        ("multi-light", 12, "moving-lamp", 0.01, 0.002),
        ("multi-light-alternating", 12, "moving-lamp", 0.015, 0.001),
        ("rgb-ratio", 1, "rgb-leds", 0.4, 0.05),
        ("fusion-like", 1, "ambient", 0.3, 0.06),
        ("rgbd-fusion", 1, "ambient", 0.04, 0.008),
    ],
)
def test_a_turned_capture_is_refined_alike(method, photographs, lighting, largest_deg, largest_mm):
    """To within what rounding changes before each method's steps end."""
    capture = narrow_scene(photographs, lighting)
    expected, found = refine(capture, method), refine(turned_capture(capture), method)
    np.testing.assert_allclose(
        turned(found.prepared_depth), expected.prepared_depth, rtol=0, atol=1e-6
    )
    off_mm = 1000 * np.abs(turned(found.depth) - expected.depth)
    cosine = np.sum(turned(found.normals) * expected.normals, axis=-1)
    off_deg = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
    assert np.nanmean(off_mm) < largest_mm
    assert np.nanmean(off_deg) < largest_deg
