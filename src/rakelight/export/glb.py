"""mesh.glb: binary glTF 2.0.

Written here rather than by a mesh library: it needs 16-bit linear colours (8 bits band in the dark)
and a material that is not glossy.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import msgspec
import numpy as np

from rakelight.errors import InputError
from rakelight.export.mesh import Y_UP_FROM_CAMERA, Surface


def glb_parts(surface: Surface) -> Iterator[bytes]:
    """Binary glTF 2.0 in metres and glTF's frame, with normals and linear colours, in parts.

    The surface must not be empty: glTF has no way to say so.
    """
    bounds = [
        [end(surface.points(rows)[0] * Y_UP_FROM_CAMERA, axis=0).astype("<f4")
         for rows in surface.strips() if surface.used[rows].any()]
        for end in (np.min, np.max)
    ]  # fmt: skip
    lowest, highest = np.min(bounds[0], axis=0), np.max(bounds[1], axis=0)
    sizes = [12 * surface.vertices, 12 * surface.vertices, 8 * surface.vertices, 12 * surface.faces]
    tree = msgspec.json.encode(_gltf_tree(surface, sizes, lowest.tolist(), highest.tolist()))
    tree += b" " * (-len(tree) % 4)
    size = 12 + 8 + len(tree) + 8 + sum(sizes)
    if size >= 1 << 32:
        raise InputError(
            "the mesh is too large for glb", source="mesh", seen=f"{size / 1e9:.1f} GB",
            needed="at most 4.3 GB", remedy="--mesh ply, or mesh='ply'",
        )  # fmt: skip
    yield struct.pack("<4sII", b"glTF", 2, size)
    yield struct.pack("<I4s", len(tree), b"JSON") + tree
    yield struct.pack("<I4s", sum(sizes), b"BIN\0")
    for k in range(2):
        for rows in surface.strips():
            yield (surface.points(rows)[k] * Y_UP_FROM_CAMERA).astype("<f4").tobytes()
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
