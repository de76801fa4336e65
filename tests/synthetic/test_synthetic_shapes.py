"""The shapes are exact: on the surface, first hit, true normals, the same at any resolution."""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import binary_fill_holes, gaussian_filter

from rakelight.errors import InputError
from rakelight.geometry.camera import back_project
from rakelight.geometry.normals import normals_from_gradient
from rakelight.model import Camera
from rakelight.synthetic import SHAPES, make_shape
from rakelight.synthetic.shapes import DISTANCE_M, VIEW

SMALL = VIEW.scaled(0.25)


@cache
def rendered(name, camera=SMALL):
    return make_shape(name).render(camera)


@pytest.fixture(params=SHAPES)
def name(request):
    return request.param


def test_sphere_is_the_analytic_one():
    surface = rendered("sphere")
    rays = back_project(np.ones(SMALL.shape), SMALL)
    a, b = np.sum(rays**2, axis=-1), DISTANCE_M
    root = b**2 - a * (DISTANCE_M**2 - 0.1**2)
    depth = (b - np.sqrt(np.where(root > 0, root, np.nan))) / a
    assert np.array_equal(surface.mask, root > 0)
    assert np.nanmax(np.abs(surface.depth - depth)) < 1e-12
    normals = (rays * depth[..., None] - [0, 0, DISTANCE_M]) / 0.1
    clear = root > 1e-5  # at the very rim the depth, and so the normal, is ill-conditioned
    assert np.abs(surface.normals - normals)[clear].max() < 1e-11


def test_points_lie_on_the_surface(name):
    surface = rendered(name)
    x, y, z = back_project(surface.depth, SMALL)[surface.mask].T
    assert np.abs(SHAPES[name].field(x, -y, DISTANCE_M - z)).max() < 1e-13


def test_nothing_stands_before_the_surface(name):
    solid, surface = SHAPES[name], rendered(name)
    rays = back_project(np.ones(SMALL.shape), SMALL)[surface.mask][::7]
    depth = surface.depth[surface.mask][::7]
    start = DISTANCE_M - solid.radius_m
    for share in np.linspace(0, 0.995, 150):
        z = start + share * (depth - start)
        assert solid.along(rays[:, 0], rays[:, 1], z).min() > 0


def test_missing_rays_miss(name):
    solid, surface = SHAPES[name], rendered(name)
    rays = back_project(np.ones(SMALL.shape), SMALL)[~surface.mask][::7]
    for z in np.linspace(DISTANCE_M - solid.radius_m, DISTANCE_M + solid.radius_m, 200):
        assert solid.along(rays[:, 0], rays[:, 1], np.full(len(rays), z)).min() > -1e-5


def test_normals_are_those_of_the_depth(name):
    """Against central differences of the depth over a thousandth of a pixel."""
    surface, finer = rendered(name), 1000
    fx, fy = SMALL.fx * finer, SMALL.fy * finer
    facing = -np.sum(surface.normals * _unit(back_project(np.ones(SMALL.shape), SMALL)), axis=-1)
    rows, columns = np.nonzero(surface.mask & (facing > 0.3))
    for i in np.random.default_rng(1).choice(len(rows), 25, replace=False):
        v, u = rows[i], columns[i]
        cx, cy = 1 - (u - SMALL.cx) * finer, 1 - (v - SMALL.cy) * finer
        around = Camera(3, 3, fx, fy, cx, cy)
        p = np.log(make_shape(name).render(around).depth)
        p_u, p_v = (p[1, 2] - p[1, 0]) / 2, (p[2, 1] - p[0, 1]) / 2
        gradient = np.full((3, 3), p_u), np.full((3, 3), p_v)
        normal = normals_from_gradient(*gradient, around)[0][1, 1]
        assert np.linalg.norm(normal - surface.normals[v, u]) < 1e-5


def test_normals_are_unit_and_face_the_camera(name):
    surface = rendered(name)
    normals = surface.normals[surface.mask]
    assert np.abs(np.linalg.norm(normals, axis=-1) - 1).max() < 1e-12
    assert np.sum(normals * back_project(surface.depth, SMALL)[surface.mask], axis=-1).max() < 0
    assert np.isnan(surface.normals[~surface.mask]).all()


def test_another_resolution_sees_the_same_points(name):
    """Every third pixel of three times the resolution looks along the same ray."""
    fine = rendered(name, SMALL.scaled(3))
    coarse = rendered(name)
    same = coarse.mask & fine.mask[1::3, 1::3]
    assert np.count_nonzero(same) > 0.998 * np.count_nonzero(coarse.mask)
    difference = np.abs(fine.depth[1::3, 1::3] - coarse.depth)[same]
    assert np.count_nonzero(difference > 1e-12) <= 1e-3 * difference.size


@pytest.mark.parametrize("name", ["vase", "cloth", "coin", "sphere"])
def test_no_pinholes(name):
    mask = rendered(name, VIEW.scaled(0.5)).mask
    assert np.array_equal(binary_fill_holes(mask), mask)


def test_objects_fill_the_view_and_stay_inside(name):
    mask = rendered(name).mask
    assert 0.15 < mask.mean() < 0.7
    assert not mask[[0, -1]].any()
    assert not mask[:, [0, -1]].any()


@pytest.mark.parametrize("name", ["head", "vase", "cloth", "coin"])
def test_the_relief_is_below_the_noise_of_a_depth_sensor(name):
    surface = rendered(name, VIEW.scaled(0.5))
    weight = gaussian_filter(surface.mask.astype(float), 6)
    smooth = gaussian_filter(np.where(surface.mask, surface.depth, 0), 6) / np.maximum(weight, 0.5)
    inside = weight > 0.999
    relief_mm = 1000 * np.sqrt(np.median((surface.depth - smooth)[inside] ** 2))
    assert 0.1 < relief_mm < 3


def test_the_head_juts_out_before_the_shoulders():
    """Below the chin the depth jumps by centimetres within two pixels."""
    depth = rendered("head", VIEW.scaled(0.5)).depth
    jumps = np.nanmax(np.abs(np.diff(depth[60:130, 80:150], axis=0)))
    assert jumps > 0.015


def test_unknown_shape():
    with pytest.raises(InputError, match=r"no such shape .seen None"):
        make_shape(None)
    with pytest.raises(InputError, match="no such shape") as caught:
        make_shape("teapot")
    assert "vase" in str(caught.value)


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
