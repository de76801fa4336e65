"""Triangles of depth maps: position, orientation, and where the surface is cut."""

import numpy as np
import pytest

from rakelight.errors import InputError
from rakelight.geometry.mesh import STEEPEST, triangulate
from rakelight.model import Camera

CAMERA = Camera(width=32, height=24, fx=100.0, fy=80.0, cx=13.0, cy=10.0)
ALL = np.ones(CAMERA.shape, bool)


def wavy(camera=CAMERA):
    v, u = np.mgrid[: camera.height, : camera.width]
    return 0.8 + 0.01 * np.sin(u / 3) * np.cos(v / 4)


def face_normals(mesh):
    a, b, c = (mesh.vertices_m[mesh.faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a), (a + b + c) / 3


def edges_in_pixels(mesh):
    corners = mesh.pixels[mesh.faces]
    return np.abs(corners - np.roll(corners, 1, axis=1))


def test_whole_grid_has_two_triangles_per_square_and_every_pixel_once():
    mesh = triangulate(wavy(), ALL, CAMERA)
    assert mesh.faces.shape == (2 * 31 * 23, 3)
    assert mesh.vertices_m.shape == (32 * 24, 3)
    assert len(np.unique(mesh.pixels, axis=0)) == 32 * 24
    assert set(np.unique(mesh.faces)) == set(range(32 * 24))


def test_vertices_project_onto_their_pixels_in_metres():
    depth = wavy()
    mesh = triangulate(depth, ALL, CAMERA)
    x, y, z = mesh.vertices_m.T
    rows, columns = mesh.pixels.T
    np.testing.assert_allclose(x / z * 100.0 + 13.0, columns, atol=1e-9)
    np.testing.assert_allclose(y / z * 80.0 + 10.0, rows, atol=1e-9)
    np.testing.assert_array_equal(z, depth[rows, columns])


def test_every_face_is_turned_to_the_camera():
    rng = np.random.default_rng(3)
    mesh = triangulate(0.8 + 0.03 * rng.random(CAMERA.shape), ALL, CAMERA)
    normals, centres = face_normals(mesh)
    assert (np.sum(normals * centres, axis=1) < 0).all()


def test_area_of_a_plane_parallel_to_the_sensor():
    mesh = triangulate(np.full(CAMERA.shape, 2.0), ALL, CAMERA)
    normals, _ = face_normals(mesh)
    area = np.linalg.norm(normals, axis=1).sum() / 2
    assert area == pytest.approx((31 * 2.0 / 100) * (23 * 2.0 / 80), rel=1e-12)


def test_no_triangle_crosses_a_jump():
    depth = np.full(CAMERA.shape, 0.8)
    depth[:, 16:] = 1.2
    mesh = triangulate(depth, ALL, CAMERA)
    z = mesh.vertices_m[:, 2][mesh.faces]
    assert (np.ptp(z, axis=1) == 0).all()
    assert len(mesh.faces) == 2 * 23 * (15 + 15)


def test_a_corner_beyond_a_jump_leaves_one_triangle():
    camera = Camera(2, 2, 100.0, 100.0, 0.5, 0.5)
    for far, kept in (((0, 0), 3), ((0, 1), 3), ((1, 0), 3), ((1, 1), 3)):
        depth = np.ones((2, 2))
        depth[far] = 2.0
        mesh = triangulate(depth, np.ones((2, 2), bool), camera)
        assert mesh.vertices_m.shape == (kept, 3)
        assert mesh.faces.shape == (1, 3)
        assert far not in {tuple(pixel) for pixel in mesh.pixels.tolist()}
        normals, centres = face_normals(mesh)
        assert np.sum(normals * centres) < 0


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(("share", "joined"), [(0.99, True), (1.01, False)])
def test_the_steepest_slope_is_the_threshold(axis, share, joined):
    # Two rows or columns, the second farther by the threshold times the pixel size z/f.
    camera = Camera(2, 2, 100.0, 80.0, 0.0, 0.0)
    focal = (80.0, 100.0)[axis]
    depth = np.ones((2, 2))
    depth[(1, slice(None)) if axis == 0 else (slice(None), 1)] += share * STEEPEST / focal
    faces = triangulate(depth, np.ones((2, 2), bool), camera).faces
    assert (len(faces) == 2) == joined


def test_threshold_follows_the_pixel_footprint():
    # The same slope in metres per metre is joined near and far, at any resolution.
    for scale in (1, 4):
        for distance in (0.3, 3.0):
            camera = Camera(2, 2, 100.0 * scale, 100.0 * scale, 0.0, 0.0)
            depth = np.full((2, 2), distance)
            depth[:, 1] += 5.0 * distance / camera.fx
            assert len(triangulate(depth, np.ones((2, 2), bool), camera).faces) == 2
            assert len(triangulate(depth, np.ones((2, 2), bool), camera, jump=4.9).faces) == 0


def test_the_diagonal_has_the_smaller_depth_difference():
    camera = Camera(2, 2, 10.0, 10.0, 0.5, 0.5)
    everywhere = np.ones((2, 2), bool)
    falling = triangulate(np.array([[1.1, 1.0], [1.3, 1.1]]), everywhere, camera)
    rising = triangulate(np.array([[1.0, 1.1], [1.1, 1.3]]), everywhere, camera)
    for mesh, diagonal in ((falling, {0, 3}), (rising, {1, 2})):
        shared = set(mesh.faces[0]) & set(mesh.faces[1])
        assert shared == diagonal


def test_only_neighbouring_pixels_are_joined():
    mask = np.random.default_rng(0).random(CAMERA.shape) > 0.3
    mesh = triangulate(wavy(), mask, CAMERA)
    assert edges_in_pixels(mesh).max() == 1
    assert mask[tuple(mesh.pixels.T)].all()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 0.0, -0.8])
def test_unusable_depth_has_no_vertex(bad):
    depth = wavy()
    depth[5, 7] = bad
    mesh = triangulate(depth, ALL, CAMERA)
    assert np.isfinite(mesh.vertices_m).all()
    assert [5, 7] not in mesh.pixels.tolist()
    assert len(mesh.vertices_m) == 32 * 24 - 1


def test_a_region_without_depth_has_no_triangle():
    depth = wavy()
    depth[:, :10] = 0.0
    assert triangulate(depth, ALL, CAMERA).pixels[:, 1].min() == 10


@pytest.mark.parametrize("missing", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_three_corners_give_one_triangle(missing):
    mask = np.ones((2, 2), bool)
    mask[missing] = False
    mesh = triangulate(np.ones((2, 2)), mask, Camera(2, 2, 100.0, 100.0, 0.5, 0.5))
    assert mesh.faces.shape == (1, 3)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("spread", [1.5, 4.0])
def test_same_triangles_as_the_plain_version(seed, spread):
    # Slopes around the threshold and missing pixels: every way of cutting a square occurs.
    rng = np.random.default_rng(seed)
    depth = 1 + spread * STEEPEST / CAMERA.fx * rng.random(CAMERA.shape)
    mask = rng.random(CAMERA.shape) > 0.15
    mesh = triangulate(depth, mask, CAMERA)
    triangles = {frozenset(map(tuple, mesh.pixels[face].tolist())) for face in mesh.faces}
    assert len(triangles) == len(mesh.faces)
    assert triangles == plain_triangles(depth, mask, CAMERA)


def plain_triangles(depth, mask, camera):
    """The rules of `triangulate`, square by square; triangles as sets of (row, column)."""

    def joined(p, q):
        if not (mask[p] and mask[q]):
            return False
        distance = np.hypot((p[1] - q[1]) / camera.fx, (p[0] - q[0]) / camera.fy)
        return abs(depth[p] - depth[q]) <= STEEPEST * distance * min(depth[p], depth[q])

    found = set()
    for v in range(camera.height - 1):
        for u in range(camera.width - 1):
            a, b, c, d = (v, u), (v, u + 1), (v + 1, u), (v + 1, u + 1)
            if mask[a] and mask[b] and mask[c] and mask[d]:
                along_ad = abs(depth[a] - depth[d]) <= abs(depth[b] - depth[c])
            else:
                along_ad = mask[a] and mask[d]
            halves = [(a, c, d), (a, d, b)] if along_ad else [(a, c, b), (b, c, d)]
            found |= {
                frozenset(half)
                for half in halves
                if joined(half[0], half[1]) and joined(half[1], half[2]) and joined(*half[::2])
            }
    return found


def test_single_pixels_and_lines_have_no_triangle():
    mask = np.zeros(CAMERA.shape, bool)
    mask[3, 3] = mask[10, :] = True
    mesh = triangulate(wavy(), mask, CAMERA)
    assert mesh.faces.shape == (0, 3)
    assert mesh.vertices_m.shape == (0, 3)
    assert mesh.pixels.shape == (0, 2)


def test_one_pixel_image():
    mesh = triangulate(np.ones((1, 1)), np.ones((1, 1), bool), Camera(1, 1, 1.0, 1.0, 0.0, 0.0))
    assert mesh.faces.shape == (0, 3)


def test_wrong_sizes_and_jumps_are_refused():
    with pytest.raises(InputError, match="differ in size"):
        triangulate(np.ones((3, 3)), ALL, CAMERA)
    with pytest.raises(InputError, match="positive"):
        triangulate(wavy(), ALL, CAMERA, jump=float("nan"))
