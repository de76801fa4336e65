"""The formats of the mesh file, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rakelight.export.glb import glb_parts
from rakelight.export.mesh import Surface
from rakelight.export.ply import ply_parts
from rakelight.export.stl import stl_parts

DEFAULT_MESH = "ply"
NO_MESH = "none"
"""Stands where a format could, for no mesh file."""


@dataclass(frozen=True, slots=True)
class MeshFormat:
    """What writes a mesh file.

    parts : makes the file's content, in parts, of a surface with at least one triangle
    axes : of the file's points, in words for `--help`
    """

    parts: Callable[[Surface], Iterator[bytes]]
    axes: str


# Name, which is the file's suffix -> format.
MESH_FORMATS = {
    "ply": MeshFormat(ply_parts, "the camera's axes"),
    "glb": MeshFormat(glb_parts, "those of glTF (y up)"),
    "stl": MeshFormat(stl_parts, "y up and millimetres"),
}
MESH_CHOICES = (*MESH_FORMATS, NO_MESH)


def mesh_file(name: str) -> str:
    """The name of the mesh file in that format.

    >>> mesh_file("glb")
    'mesh.glb'
    """
    return f"mesh.{name}"
