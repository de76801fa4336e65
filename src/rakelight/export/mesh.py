"""The object's surface as triangles with normals and colours: what every mesh file holds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.geometry.grid import row_strips
from rakelight.geometry.mesh import pixel_triangles, pixel_vertices
from rakelight.model import Array, Camera, Floats, Mask, Mesh, PointCloud, Result
from rakelight.pictures.shown import object_window
from rakelight.prepare.linear import srgb

# Rows of the object that are made into triangles at a time, which take a hundred bytes a pixel.
STRIP_ROWS = 512
# Camera frame (x right, y down, z forward) to x right, y up, z to the viewer, glTF's and that of
# mesh.stl: a half turn around x, so the triangles keep their winding.
Y_UP_FROM_CAMERA = np.array([1.0, -1.0, -1.0])


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
