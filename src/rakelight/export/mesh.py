"""mesh.ply and mesh.glb: the object's surface with normals and colours.

Written here rather than by a mesh library: PLY has to be fast for millions of triangles, and
glTF needs 16-bit linear colours (8 bits band in the dark) and a material that is not glossy.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import row_strips
from rakelight.geometry.mesh import pixel_triangles, pixel_vertices
from rakelight.model import Array, Camera, Floats, Mask, Mesh, PointCloud, Result
from rakelight.pictures.shown import object_window
from rakelight.prepare.linear import srgb

# Camera frame (x right, y down, z forward) to glTF's (x right, y up, z to the viewer): a half
# turn around x, so the triangles keep their winding.
GLTF_FROM_CAMERA = np.array([1.0, -1.0, -1.0])

# Rows of the object that are made into triangles at a time, which take a hundred bytes a pixel.
STRIP_ROWS = 512

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


@dataclass(frozen=True, eq=False)
class Surface:
    """The triangles of a result's depth map, made a strip of rows at a time.

    window : rows and columns of the object; used : (h, w) its pixels that have a vertex
    starts : (h + 1,) the number of the first vertex in each row; faces : how many triangles
    """

    result: Result
    window: tuple[slice, slice]
    used: Mask
    starts: Array
    faces: int

    @classmethod
    def of(cls, result: Result) -> Surface:
        """That of a result; without triangles when no pixel has neighbours."""
        window = object_window(result.mask, margin=0)
        used, faces = np.zeros(result.depth[window].shape, bool), 0
        empty = cls(result, window, used, np.zeros(len(used) + 1, np.int64), 0)
        for rows in empty.strips():
            corners = empty.corners(rows)
            used[rows.start : rows.stop + 1].reshape(-1)[corners] = True
            faces += len(corners)
        starts = np.concatenate([[0], np.cumsum(used.sum(axis=1))])
        return cls(result, window, used, starts, faces)

    @property
    def vertices(self) -> int:
        """How many vertices."""
        return int(self.starts[-1])

    def strips(self) -> Iterator[slice]:
        """Rows of the window, from the first to the last."""
        return row_strips(len(self.used), STRIP_ROWS)

    def part(self, image: Array, rows: slice) -> Array:
        """An image (H, W[, C]) of the result in rows of the window."""
        return image[self.window][rows]

    def camera(self, rows: slice) -> Camera:
        """The camera of rows of the window."""
        return self.result.camera.cropped(*self.window).cropped(rows, slice(0, self.used.shape[1]))

    def corners(self, rows: slice) -> Array:
        """(F, 3) pixels, counted from the first row on, of the triangles that begin in the rows."""
        wider = slice(rows.start, min(rows.stop + 1, len(self.used)))
        depth_m = self.part(self.result.depth, wider)
        return pixel_triangles(depth_m, np.isfinite(depth_m), self.camera(wider))

    def points(self, rows: slice) -> tuple[Floats, Floats, Floats]:
        """Vertices in metres, their normals and linear colours, each (V, 3), of rows."""
        used = self.used[rows]
        points, _ = pixel_vertices(self.part(self.result.depth, rows), used, self.camera(rows))
        normals, albedo = (
            self.part(image, rows)[used] for image in (self.result.normals, self.result.albedo)
        )
        return points, normals, albedo

    def triangles(self, rows: slice) -> Array:
        """(F, 3) int32 into all vertices, the triangles that begin in the rows."""
        wider = self.used[rows.start : rows.stop + 1]
        number = np.cumsum(wider, dtype=np.int32) + np.int32(self.starts[rows.start] - 1)
        return number[self.corners(rows)]


def result_mesh(result: Result) -> Mesh:
    """What mesh.ply holds, in memory: what `Result.mesh` returns."""
    surface = Surface.of(result)
    points, normals, albedo = (
        np.concatenate(parts)
        for parts in zip(*(surface.points(rows) for rows in surface.strips()), strict=True)
    )
    return Mesh(
        vertices_m=points.astype(np.float32),
        faces=np.concatenate([surface.triangles(rows) for rows in surface.strips()]),
        normals=normals.astype(np.float32),
        colors=vertex_colors(albedo),
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


def ply_parts(surface: Surface) -> Iterator[bytes]:
    """Binary PLY in metres and the camera frame, with vertex normals and sRGB colours, in parts."""
    yield _PLY_HEADER.format(vertices=surface.vertices, faces=surface.faces).encode()
    for rows in surface.strips():
        points, normals, albedo = surface.points(rows)
        vertices = np.empty(len(points), _PLY_VERTEX)
        vertices["position"], vertices["normal"] = points, normals
        vertices["colour"] = vertex_colors(albedo)
        yield vertices.tobytes()
    for rows in surface.strips():
        triangles = surface.triangles(rows)
        faces = np.empty(len(triangles), _PLY_FACE)
        faces["count"] = 3
        faces["indices"] = triangles
        yield faces.tobytes()


def glb_parts(surface: Surface) -> Iterator[bytes]:
    """Binary glTF 2.0 in metres and glTF's frame, with normals and linear colours, in parts.

    The surface must not be empty: glTF has no way to say so.
    """
    bounds = [
        [end(surface.points(rows)[0] * GLTF_FROM_CAMERA, axis=0).astype("<f4")
         for rows in surface.strips() if surface.used[rows].any()]
        for end in (np.min, np.max)
    ]  # fmt: skip
    lowest, highest = np.min(bounds[0], axis=0), np.max(bounds[1], axis=0)
    sizes = [12 * surface.vertices, 12 * surface.vertices, 8 * surface.vertices, 12 * surface.faces]
    tree = msgspec.json.encode(_gltf_tree(surface, sizes, lowest.tolist(), highest.tolist()))
    tree += b" " * (-len(tree) % 4)
    yield struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(tree) + 8 + sum(sizes))
    yield struct.pack("<I4s", len(tree), b"JSON") + tree
    yield struct.pack("<I4s", sum(sizes), b"BIN\0")
    for k in range(2):
        for rows in surface.strips():
            yield (surface.points(rows)[k] * GLTF_FROM_CAMERA).astype("<f4").tobytes()
    for rows in surface.strips():
        # glTF wants rows of a multiple of four bytes: three 16-bit colours and an alpha.
        albedo = surface.points(rows)[2]
        colours = np.full((len(albedo), 4), 65535, "<u2")
        colours[:, :3] = np.rint(np.clip(albedo, 0, 1) * 65535)
        yield colours.tobytes()
    for rows in surface.strips():
        yield surface.triangles(rows).astype("<u4").tobytes()


def _gltf_tree(
    surface: Surface, sizes: list[int], lowest: list[float], highest: list[float]
) -> dict[str, object]:
    """The JSON part of a glTF file whose buffer is positions, normals, colours, indices.

    sizes : of these, bytes; lowest, highest : of the positions
    """
    float32, uint16, uint32, vertex_buffer, index_buffer = 5126, 5123, 5125, 34962, 34963
    count = surface.vertices
    views = [
        {
            "buffer": 0,
            "byteOffset": sum(sizes[:i]),
            "byteLength": size,
            "target": vertex_buffer if i < 3 else index_buffer,
        }
        for i, size in enumerate(sizes)
    ]
    bounds = {"min": lowest, "max": highest}
    accessors: list[dict[str, object]] = [
        {"componentType": float32, "count": count, "type": "VEC3", **bounds},
        {"componentType": float32, "count": count, "type": "VEC3"},
        {"componentType": uint16, "count": count, "type": "VEC4", "normalized": True},
        {"componentType": uint32, "count": 3 * surface.faces, "type": "SCALAR"},
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
