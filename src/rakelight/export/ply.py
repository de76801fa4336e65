"""mesh.ply: binary PLY.

Written here rather than by a mesh library: it has to be fast for millions of triangles.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rakelight.export.mesh import Surface, vertex_colors

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
