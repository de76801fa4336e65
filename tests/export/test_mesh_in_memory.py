"""Result.mesh and Result.point_cloud: the surface without a file."""

from dataclasses import replace

import numpy as np
import pytest

from rakelight.export import write_result
from tests.export.conftest import CENTRE_M, RADIUS_M
from tests.export.readers import read_ply


def pixels_of(points, camera):
    x, y, z = points.T.astype(float)
    columns, rows = x / z * camera.fx + camera.cx, y / z * camera.fy + camera.cy
    np.testing.assert_allclose([columns, rows], np.rint([columns, rows]), atol=1e-3)
    return np.rint(rows).astype(int), np.rint(columns).astype(int)


def test_the_mesh_is_what_mesh_ply_holds(sphere, tmp_path):
    write_result(sphere, tmp_path / "out", mesh="ply")
    vertices, faces = read_ply((tmp_path / "out" / "mesh.ply").read_bytes())
    mesh = sphere.mesh()
    np.testing.assert_array_equal(mesh.vertices_m, vertices[:, :3])
    np.testing.assert_array_equal(mesh.normals, vertices[:, 3:6])
    np.testing.assert_array_equal(mesh.colors, vertices[:, 6:])
    np.testing.assert_array_equal(mesh.faces, faces)
    dtypes = [array.dtype for array in (mesh.vertices_m, mesh.normals, mesh.colors, mesh.faces)]
    assert dtypes == [np.float32, np.float32, np.uint8, np.int32]


def test_the_faces_look_at_the_camera(sphere):
    mesh = sphere.mesh()
    a, b, c = (mesh.vertices_m[mesh.faces[:, k]].astype(float) for k in range(3))
    right_handed = np.cross(b - a, c - a)
    assert (np.sum(right_handed * a, axis=1) < 0).all()


@pytest.mark.parametrize("kind", ["mesh", "points"])
def test_places_normals_and_colours_are_those_of_the_pixels(sphere, kind):
    if kind == "mesh":
        shape = sphere.mesh()
        points_m = shape.vertices_m
    else:
        shape = sphere.point_cloud()
        points_m = shape.points_m
        assert len(points_m) == np.count_nonzero(sphere.mask)
    np.testing.assert_allclose(np.linalg.norm(points_m - CENTRE_M, axis=1), RADIUS_M, atol=1e-6)
    np.testing.assert_allclose(shape.normals, (points_m - CENTRE_M) / RADIUS_M, atol=1e-5)
    rows, columns = pixels_of(points_m, sphere.camera)
    linear = np.clip(sphere.albedo[rows, columns], 0, 1).astype(float)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(shape.colors, 255 * srgb, atol=0.501)


def test_points_come_row_by_row(sphere):
    rows, columns = pixels_of(sphere.point_cloud().points_m, sphere.camera)
    np.testing.assert_array_equal(np.stack([rows, columns]), np.nonzero(sphere.mask))


def test_a_jump_has_points_and_no_triangle(sphere):
    depth = sphere.depth.copy()
    depth[:, 30:] += 0.2  # metres
    cut = replace(sphere, depth=depth)
    edges = cut.mesh().vertices_m[cut.mesh().faces]
    assert np.ptp(edges[..., 2], axis=1).max() < 0.05
    assert len(cut.point_cloud().points_m) == len(sphere.point_cloud().points_m)


def test_where_no_pixel_has_a_neighbour_the_mesh_is_empty(sphere):
    lonely = np.full_like(sphere.depth, np.nan)
    lonely[20, 30] = sphere.depth[20, 30]
    alone = replace(sphere, depth=lonely)
    mesh, cloud = alone.mesh(), alone.point_cloud()
    shapes = [array.shape for array in (mesh.vertices_m, mesh.faces, mesh.normals, mesh.colors)]
    assert shapes == [(0, 3)] * 4
    assert cloud.points_m.shape == (1, 3)
