"""mesh.ply and mesh.glb: the object's surface with normals and colours.

Written here rather than by a mesh library: PLY has to be fast for millions of triangles, and
glTF needs 16-bit linear colours (8 bits band in the dark) and a material that is not glossy.
"""

from __future__ import annotations

import struct

import msgspec
import numpy as np

from rakelight.export.pictures import object_window
from rakelight.geometry.camera import back_project
from rakelight.geometry.mesh import DepthMesh, triangulate
from rakelight.model import Array, Floats, Mesh, PointCloud, Result
from rakelight.prepare.linear import srgb

# Camera frame (x right, y down, z forward) to glTF's (x right, y up, z to the viewer): a half
# turn around x, so the triangles keep their winding.
GLTF_FROM_CAMERA = np.array([1.0, -1.0, -1.0])

_PLY_HEADER = """ply
format binary_little_endian 1.0
comment rakelight: metres, camera frame, x right, y down, z forward
element vertex {vertices}
property float x
property float y
property float z
property float nx
property float ny
property float nz
property uchar red
property uchar green
property uchar blue
element face {faces}
property list uchar int vertex_indices
end_header
"""
_PLY_VERTEX = np.dtype([("position", "<f4", 3), ("normal", "<f4", 3), ("colour", "u1", 3)])
_PLY_FACE = np.dtype([("count", "u1"), ("indices", "<i4", 3)])


def result_triangles(result: Result) -> DepthMesh:
    """The triangles of a result's depth map; empty when no pixel has neighbours."""
    window = object_window(result.mask, margin=0)
    mesh = triangulate(result.depth[window], result.mask[window], result.camera.cropped(*window))
    corner = np.array([side.start for side in window], dtype=np.int32)
    return mesh._replace(pixels=mesh.pixels + corner)


def result_mesh(result: Result) -> Mesh:
    """What mesh.ply holds, in memory: what `Result.mesh` returns."""
    mesh = result_triangles(result)
    rows, columns = mesh.pixels.T
    return Mesh(
        vertices_m=mesh.vertices_m.astype(np.float32),
        faces=mesh.faces,
        normals=result.normals[rows, columns].astype(np.float32),
        colors=vertex_colors(result.albedo[rows, columns]),
    )


def result_points(result: Result) -> PointCloud:
    """Every pixel of the object as a point: what `Result.point_cloud` returns."""
    inside = result.mask
    return PointCloud(
        points_m=back_project(result.depth, result.camera)[inside].astype(np.float32),
        normals=result.normals[inside].astype(np.float32),
        colors=vertex_colors(result.albedo[inside]),
    )


def vertex_colors(albedo: Floats) -> Array:
    """uint8 sRGB of linear albedo (V, 3); what is brighter than 1 is clipped.

    >>> vertex_colors(np.array([[0.0, 0.2140, 1.3]])).tolist()
    [[0, 127, 255]]
    """
    return np.rint(srgb(albedo) * 255).astype(np.uint8)


def mesh_ply(mesh: DepthMesh, normals: Floats, albedo: Floats) -> bytes:
    """Binary PLY in metres and the camera frame, with vertex normals and sRGB colours.

    normals, albedo : (H, W, 3) maps that the mesh was made from, camera frame and linear
    """
    rows, columns = mesh.pixels.T
    vertices = np.empty(len(mesh.vertices_m), _PLY_VERTEX)
    vertices["position"] = mesh.vertices_m
    vertices["normal"] = normals[rows, columns]
    vertices["colour"] = vertex_colors(albedo[rows, columns])
    faces = np.empty(len(mesh.faces), _PLY_FACE)
    faces["count"] = 3
    faces["indices"] = mesh.faces
    header = _PLY_HEADER.format(vertices=len(vertices), faces=len(faces)).encode()
    return header + vertices.tobytes() + faces.tobytes()


def mesh_glb(mesh: DepthMesh, normals: Floats, albedo: Floats) -> bytes:
    """Binary glTF 2.0 in metres and glTF's frame, with vertex normals and linear colours.

    normals, albedo : (H, W, 3) maps that the mesh was made from, camera frame and linear.
    The mesh must not be empty: glTF has no way to say so.
    """
    rows, columns = mesh.pixels.T
    positions = (mesh.vertices_m * GLTF_FROM_CAMERA).astype("<f4")
    directions = (normals[rows, columns] * GLTF_FROM_CAMERA).astype("<f4")
    # glTF wants rows of a multiple of four bytes: three 16-bit colours and an alpha.
    colours = np.full((len(positions), 4), 65535, "<u2")
    colours[:, :3] = np.rint(np.clip(albedo[rows, columns], 0, 1) * 65535)
    arrays = [positions, directions, colours, mesh.faces.astype("<u4").ravel()]
    tree = msgspec.json.encode(_gltf_tree(arrays))
    return _glb_container(tree, b"".join(array.tobytes() for array in arrays))


def _gltf_tree(arrays: list[Array]) -> dict[str, object]:
    """The JSON part of a glTF file whose buffer is positions, normals, colours, indices."""
    positions, _, _, indices = arrays
    float32, uint16, uint32, vertex_buffer, index_buffer = 5126, 5123, 5125, 34962, 34963
    count = len(positions)
    sizes = [array.nbytes for array in arrays]
    views = [
        {
            "buffer": 0,
            "byteOffset": sum(sizes[:i]),
            "byteLength": size,
            "target": vertex_buffer if i < 3 else index_buffer,
        }
        for i, size in enumerate(sizes)
    ]
    bounds = {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
    accessors: list[dict[str, object]] = [
        {"componentType": float32, "count": count, "type": "VEC3", **bounds},
        {"componentType": float32, "count": count, "type": "VEC3"},
        {"componentType": uint16, "count": count, "type": "VEC4", "normalized": True},
        {"componentType": uint32, "count": len(indices), "type": "SCALAR"},
    ]
    for view, accessor in enumerate(accessors):
        accessor["bufferView"] = view
    attributes = {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}
    matte = {"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}
    return {
        "asset": {"version": "2.0", "generator": "rakelight"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 3, "material": 0}]}],
        "materials": [{**matte, "doubleSided": True}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": sum(sizes)}],
    }


def _glb_container(tree: bytes, buffer: bytes) -> bytes:
    """A GLB file: a header and two chunks, each padded to four bytes."""
    tree += b" " * (-len(tree) % 4)
    buffer += b"\0" * (-len(buffer) % 4)
    chunks = struct.pack("<I4s", len(tree), b"JSON") + tree
    chunks += struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
