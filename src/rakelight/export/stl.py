"""mesh.stl: binary STL, for printers and CAD.

Written here rather than by a mesh library, as mesh.ply is: fast for millions of triangles.  STL has
no unit, and programs that print or mill take its numbers for millimetres.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from rakelight.export.mesh import Y_UP_FROM_CAMERA, Surface

# 80 bytes; one that begins with "solid" would mark the text format.
_HEADER = b"rakelight: millimetres, x right, y up, z to the viewer".ljust(80)
_MM_PER_METRE = 1000.0
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def stl_parts(surface: Surface) -> Iterator[bytes]:
    """Binary STL in millimetres, y up, with a normal per triangle and no colours, in parts."""
    yield _HEADER + struct.pack("<I", surface.faces)
    for rows in surface.strips():
        # The triangles that begin in the last row end in the one below.
        points = surface.points(slice(rows.start, rows.stop + 1))[0]
        points *= _MM_PER_METRE * Y_UP_FROM_CAMERA
        corners = points[surface.triangles(rows) - surface.starts[rows.start]]
        a, b, c = np.moveaxis(corners, 1, 0)
        normals = np.cross(b - a, c - a)
        triangles = np.zeros(len(corners), _TRIANGLE)
        triangles["corners"] = corners
        triangles["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        yield triangles.tobytes()
