"""mesh.ply, mesh.glb and mesh.stl, read back by an independent parser and by trimesh."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from rakelight.export import write_result
from tests.export.conftest import CENTRE_M, RADIUS_M
from tests.export.readers import from_srgb, read_ply

trimesh = pytest.importorskip("trimesh")


@pytest.fixture
def ply(sphere, tmp_path):
    write_result(sphere, tmp_path / "out", mesh="ply")
    assert not (tmp_path / "out" / "mesh.glb").exists()
    return tmp_path / "out" / "mesh.ply"


@pytest.fixture
def glb(sphere, tmp_path):
    write_result(sphere, tmp_path / "out", mesh="glb")
    assert not (tmp_path / "out" / "mesh.ply").exists()
    return tmp_path / "out" / "mesh.glb"


def load(path):
    return trimesh.load(path, process=False, force="mesh")


def test_ply_is_the_sphere_in_metres_in_the_camera_frame(ply):
    vertices, _ = read_ply(ply.read_bytes())
    distance = np.linalg.norm(vertices[:, :3] - CENTRE_M, axis=1)
    np.testing.assert_allclose(distance, RADIUS_M, atol=1e-6)
    np.testing.assert_allclose(vertices[:, 3:6], (vertices[:, :3] - CENTRE_M) / RADIUS_M, atol=1e-5)


def test_ply_colours_are_srgb_albedo_of_the_right_pixel(sphere, ply):
    vertices, _ = read_ply(ply.read_bytes())
    x, y, z = vertices[:, :3].T
    columns = np.rint(x / z * 300.0 + 29.0).astype(int)
    rows = np.rint(y / z * 280.0 + 26.5).astype(int)
    np.testing.assert_allclose(
        vertices[:, 6:] / 255,
        np.where(
            (albedo := sphere.albedo[rows, columns]) <= 0.0031308,
            12.92 * albedo,
            1.055 * albedo ** (1 / 2.4) - 0.055,
        ),
        atol=0.5 / 255 + 1e-6,
    )


def test_trimesh_reads_the_same_ply(ply):
    vertices, faces = read_ply(ply.read_bytes())
    mesh = load(ply)
    np.testing.assert_allclose(mesh.vertices, vertices[:, :3])
    np.testing.assert_array_equal(mesh.faces, faces)
    np.testing.assert_array_equal(mesh.visual.vertex_colors[:, :3], vertices[:, 6:])


def test_ply_faces_are_turned_to_the_camera(ply):
    mesh = load(ply)
    assert (np.sum(mesh.face_normals * mesh.triangles_center, axis=1) < 0).all()
    assert (np.sum(mesh.face_normals * (mesh.triangles_center - CENTRE_M), axis=1) > 0).all()


def test_glb_is_the_sphere_in_gltf_frame(glb):
    mesh = load(glb)
    centre = CENTRE_M * [1, -1, -1]
    assert centre[1] > 0  # above the optical axis: up is positive
    assert (mesh.vertices[:, 2] < 0).all()  # in front of the camera, which looks along -z
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - centre, axis=1), RADIUS_M, atol=1e-6)
    # trimesh computes normals of its own when it loads a scene as one mesh: read ours directly.
    tree, buffer = glb_parts(glb.read_bytes())
    normals = accessor(tree, buffer, 1)
    np.testing.assert_allclose(normals, (mesh.vertices - centre) / RADIUS_M, atol=1e-5)
    assert (np.sum(mesh.face_normals * mesh.triangles_center, axis=1) < 0).all()


def test_glb_and_ply_are_the_same_surface(sphere, glb, tmp_path):
    write_result(sphere, tmp_path / "a", mesh="ply")
    vertices, faces = read_ply((tmp_path / "a" / "mesh.ply").read_bytes())
    mesh = load(glb)
    np.testing.assert_allclose(mesh.vertices * [1, -1, -1], vertices[:, :3], atol=1e-7)
    np.testing.assert_array_equal(mesh.faces, faces)


def test_glb_structure_and_linear_colours(sphere, glb):
    tree, buffer = glb_parts(glb.read_bytes())
    primitive = tree["meshes"][0]["primitives"][0]
    positions = accessor(tree, buffer, primitive["attributes"]["POSITION"])
    declared = tree["accessors"][primitive["attributes"]["POSITION"]]
    np.testing.assert_array_equal(positions.min(axis=0), np.float32(declared["min"]))
    np.testing.assert_array_equal(positions.max(axis=0), np.float32(declared["max"]))
    colours = accessor(tree, buffer, primitive["attributes"]["COLOR_0"]) / 65535
    x, y, z = positions.T
    columns = np.rint(-x / z * 300.0 + 29.0).astype(int)
    rows = np.rint(y / z * 280.0 + 26.5).astype(int)
    np.testing.assert_allclose(colours[:, :3], sphere.albedo[rows, columns], atol=1e-5)
    assert (colours[:, 3] == 1).all()
    material = tree["materials"][primitive["material"]]["pbrMetallicRoughness"]
    assert material["metallicFactor"] == 0
    for view in tree["bufferViews"]:
        assert view["byteOffset"] % 4 == 0


def test_colours_of_glb_and_ply_agree(sphere, ply, tmp_path):
    write_result(sphere, tmp_path / "b", mesh="glb")
    tree, buffer = glb_parts((tmp_path / "b" / "mesh.glb").read_bytes())
    vertices, _ = read_ply(ply.read_bytes())
    linear = accessor(tree, buffer, 2)[:, :3] / 65535
    np.testing.assert_allclose(from_srgb(vertices[:, 6:] / 255), linear, atol=0.006)


def test_stl_is_the_same_surface_in_millimetres_y_up(sphere, tmp_path, monkeypatch):
    monkeypatch.setattr("rakelight.export.mesh.STRIP_ROWS", 7)  # several strips
    for name in ("ply", "stl"):
        write_result(sphere, tmp_path / name, mesh=name)
    data = (tmp_path / "stl" / "mesh.stl").read_bytes()
    assert not data.startswith(b"solid")
    mesh, other = load(tmp_path / "stl" / "mesh.stl"), load(tmp_path / "ply" / "mesh.ply")
    np.testing.assert_allclose(mesh.triangles, 1000 * other.triangles * [1, -1, -1], atol=1e-3)
    count = struct.unpack_from("<I", data, 80)[0]
    assert count == len(other.faces)
    assert len(data) == 84 + 50 * count
    stated = np.frombuffer(data, np.dtype("12f4,u2"), offset=84)["f0"][:, :3]
    np.testing.assert_allclose(stated, other.face_normals * [1, -1, -1], atol=1e-4)


def glb_parts(data):
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<I4s", data, 12)
    assert kind == b"JSON"
    start = 20 + size
    binary_size, binary_kind = struct.unpack_from("<I4s", data, start)
    assert binary_kind == b"BIN\0"
    assert size % 4 == binary_size % 4 == 0
    assert start + 8 + binary_size == len(data)
    tree = json.loads(data[20 : 20 + size])
    assert tree["buffers"][0]["byteLength"] <= binary_size
    return tree, data[start + 8 :]


def accessor(tree, buffer, number):
    item = tree["accessors"][number]
    view = tree["bufferViews"][item["bufferView"]]
    dtype = {5126: "<f4", 5123: "<u2", 5125: "<u4"}[item["componentType"]]
    part = buffer[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    return np.frombuffer(part, dtype).reshape(item["count"], -1)


def test_colours_brighter_than_white_are_white(sphere, tmp_path):
    write_result(replace(sphere, albedo=3 * sphere.albedo), tmp_path / "bright", mesh="glb")
    tree, buffer = glb_parts((tmp_path / "bright" / "mesh.glb").read_bytes())
    red, plain = accessor(tree, buffer, 2)[:, 0], 3 * sphere.albedo[..., 0][sphere.mask]
    assert red.min() >= 0.95 * 65535 * min(1, plain.min())
    assert (red == 65535).mean() > 0.5


def test_the_bounds_are_those_of_all_strips(sphere, tmp_path, monkeypatch):
    monkeypatch.setattr("rakelight.export.mesh.STRIP_ROWS", 7)
    write_result(sphere, tmp_path / "strips", mesh="glb")
    tree, buffer = glb_parts((tmp_path / "strips" / "mesh.glb").read_bytes())
    positions, stated = accessor(tree, buffer, 0), tree["accessors"][0]
    np.testing.assert_allclose(stated["min"], positions.min(axis=0))
    np.testing.assert_allclose(stated["max"], positions.max(axis=0))
