"""Normals of log depth: against analytic surfaces, against differences, and their invariances."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import (
    gradient_directions,
    normal_derivatives,
    normals_from_depth,
    normals_from_gradient,
    squared_normal_derivative,
    surface_normals,
    towards_camera,
)
from rakelight.model import Camera

CAMERA = Camera(width=48, height=36, fx=60.0, fy=52.0, cx=20.3, cy=19.1)
ALL = np.ones(CAMERA.shape, bool)


def rays(camera):
    return back_project(np.ones(camera.shape), camera)


def plane(normal, distance, camera=CAMERA):
    """Depth (H, W) of the points X with normal . X = -distance."""
    return -distance / (rays(camera) @ normal)


def sphere(camera, centre=(0.02, -0.03, 1.0), radius=0.25):
    """Depth and exact normals of a sphere's front, NaN beside it."""
    ray, centre = rays(camera), np.array(centre)
    square, half = (ray**2).sum(-1), ray @ centre
    root = half**2 - square * (centre @ centre - radius**2)
    depth = (half - np.sqrt(np.where(root > 0, root, np.nan))) / square
    return depth, (ray * depth[..., None] - centre) / radius


def angle_deg(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(-1)))


def unit(*vector):
    return np.array(vector) / np.linalg.norm(vector)


def test_plane_parallel_to_the_sensor_is_exact():
    n = normals_from_depth(np.full(CAMERA.shape, 0.7), ALL, CAMERA)
    np.testing.assert_array_equal(n, np.broadcast_to([0.0, 0.0, -1.0], n.shape))


@pytest.mark.parametrize(("p_u", "p_v"), [(0.003, 0.0), (0.0, -0.02), (0.05, 0.04)])
def test_surface_with_constant_gradient_of_log_depth_is_exact(p_u, p_v):
    # Differences of a linear function are exact, so all that is left is the formula: compare
    # with the cross product of the surface's own tangents.
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    depth = 0.8 * np.exp(p_u * u + p_v * v)
    ray = rays(CAMERA)
    along_u = ray * p_u + np.array([1 / CAMERA.fx, 0, 0])
    along_v = ray * p_v + np.array([0, 1 / CAMERA.fy, 0])
    exact = -np.cross(along_u, along_v)
    n = normals_from_depth(depth, ALL, CAMERA)
    assert angle_deg(n, exact).max() < 1e-9


@pytest.mark.parametrize("slant_deg", [0, 20, 45, 55])
@pytest.mark.parametrize("azimuth_deg", [0, 90, 130, 250])
def test_planes_of_any_slope(slant_deg, azimuth_deg):
    # log z of a plane is not linear in the pixel; the central difference misses its third
    # derivative: the error falls by 4 when the pixels halve.
    slant, azimuth = np.radians([slant_deg, azimuth_deg])
    direction = [np.sin(slant) * np.cos(azimuth), np.sin(slant) * np.sin(azimuth), -np.cos(slant)]
    worst = []
    for factor in (2, 4):
        camera = CAMERA.scaled(factor)
        n = normals_from_depth(plane(direction, 0.8, camera), np.ones(camera.shape, bool), camera)
        # the same part of the view at both resolutions, away from the border
        part = (slice(6 * factor, -6 * factor), slice(6 * factor, -6 * factor))
        worst.append(angle_deg(n, np.broadcast_to(direction, n.shape))[part].max())
    assert worst[0] < 0.3
    assert worst[1] < max(worst[0] / 3.5, 1e-9)


def test_sphere_converges_with_second_order():
    errors = []
    for factor in (4, 8, 16):
        camera = CAMERA.scaled(factor)
        depth, exact = sphere(camera)
        mask = np.isfinite(depth)
        # up to 60 degrees off the line of sight
        facing = -(exact * rays(camera)).sum(-1) / np.linalg.norm(rays(camera), axis=-1)
        counted = mask & (np.where(mask, facing, 0) > 0.5)
        error = angle_deg(normals_from_depth(depth, mask, camera), exact)[counted]
        errors.append(np.sqrt(np.mean(error**2)))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.1)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)
    assert errors[2] < 0.01


@pytest.mark.parametrize("scale", [0.01, 3.0, 250.0])
def test_normals_do_not_depend_on_the_scale_of_depth(scale):
    depth, _ = sphere(CAMERA)
    mask = np.isfinite(depth)
    first = normals_from_depth(depth, mask, CAMERA)[mask]
    np.testing.assert_allclose(
        normals_from_depth(scale * depth, mask, CAMERA)[mask], first, atol=1e-12
    )


def test_normals_of_rough_depth_are_unit_and_face_the_camera():
    # n . ray = -1/|m| for every gradient: even noise never turns a normal away.
    depth = 0.8 * np.exp(np.random.default_rng(0).normal(size=CAMERA.shape))
    n = normals_from_depth(depth, ALL, CAMERA)
    np.testing.assert_allclose(np.linalg.norm(n, axis=-1), 1, atol=1e-14)
    assert ((n * rays(CAMERA)).sum(-1) < 0).all()


def test_pixels_outside_the_mask_are_neither_read_nor_written():
    depth, _ = sphere(CAMERA)
    mask = np.isfinite(depth)
    n = normals_from_depth(depth, mask, CAMERA)
    assert np.isnan(n[~mask]).all()
    for junk in (0.0, -1.0, np.inf, 1e9):
        other = np.where(mask, depth, junk)
        np.testing.assert_array_equal(normals_from_depth(other, mask, CAMERA), n)


def test_float32_depth_is_taken_in_double_precision():
    depth = plane(unit(0.1, 0.2, -1.0), 0.8).astype(np.float32)
    expected = normals_from_depth(depth.astype(np.float64), ALL, CAMERA)
    np.testing.assert_array_equal(normals_from_depth(depth, ALL, CAMERA), expected)


def test_axes_right_down_forward():
    # Deeper to the right: the surface looks left.  Deeper below: it looks up.
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    middle = (19, 20)
    to_the_right = normals_from_depth(np.exp(0.01 * u), ALL, CAMERA)[middle]
    below = normals_from_depth(np.exp(0.01 * v), ALL, CAMERA)[middle]
    assert to_the_right[0] > 0.1
    assert abs(to_the_right[1]) < 1e-12
    assert below[1] > 0.1
    assert abs(below[0]) < 1e-12


gradients = st.floats(-0.3, 0.3)


@settings(deadline=None)
@given(p_u=gradients, p_v=gradients)
def test_derivatives_are_those_of_the_normals(p_u, p_v):
    camera = Camera(width=5, height=4, fx=30.0, fy=40.0, cx=-3.0, cy=9.0)
    flat, step = np.zeros(camera.shape), 1e-6

    def normals(u, v):
        return normals_from_gradient(flat + u, flat + v, camera)[0]

    n, length = normals_from_gradient(flat + p_u, flat + p_v, camera)
    by_u, by_v = normal_derivatives(n, length, camera)
    along_u = (normals(p_u + step, p_v) - normals(p_u - step, p_v)) / (2 * step)
    along_v = (normals(p_u, p_v + step) - normals(p_u, p_v - step)) / (2 * step)
    scale = 40 / length.min()  # the largest derivatives are about f / |m|
    np.testing.assert_allclose(by_u, along_u, atol=1e-6 * scale)
    np.testing.assert_allclose(by_v, along_v, atol=1e-6 * scale)
    # a unit vector changes at right angles to itself
    assert np.abs((by_u * n).sum(-1)).max() < 1e-12 * scale


@settings(deadline=None)
@given(p_u=gradients, p_v=gradients)
def test_the_unnormalised_normal_is_linear_in_the_gradient(p_u, p_v):
    flat = np.zeros(CAMERA.shape)
    n, length = normals_from_gradient(flat + p_u, flat + p_v, CAMERA)
    u, v = gradient_directions(CAMERA)
    m = p_u * u + p_v * v + np.array([0, 0, -1])
    np.testing.assert_allclose(n * length[..., None], m, atol=1e-12)


def test_focal_lengths_that_differ():
    camera = Camera(5, 4, fx=10.0, fy=20.0, cx=1.0, cy=3.0)
    slopes = np.random.default_rng(0).normal(0, 0.05, (2, 4, 5))
    normals, length = normals_from_gradient(*slopes, camera)
    np.testing.assert_allclose(towards_camera(normals, camera), 1 / length)
    pixel = Camera(1, 1, fx=10.0, fy=20.0, cx=0.0, cy=0.0)
    assert squared_normal_derivative(np.array([1.0]), pixel).tolist() == [200.0]


def test_a_strip_of_one_pixel_between_jumps_has_the_slope_to_its_neighbours():
    depth = np.ones((5, 5))
    depth[:, 2], depth[:, 3:] = 0.5, 1.02
    camera = Camera(5, 5, fx=100.0, fy=100.0, cx=2.0, cy=2.0)
    assert abs(surface_normals(depth, np.ones((5, 5), bool), camera)[2, 2, 0]) > 0.1
