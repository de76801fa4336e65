"""Cast shadows of a depth map, which is opaque to infinity behind the surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight import jit
from rakelight.model import Camera, Floats, Mask

# First step of the march, pixels, and the growth of each: occluders far away look larger.
STEP_PX = 0.5
STEP_GROWTH = 1.02
# Depth behind the surface, in pixel sizes, beyond which a point is hidden; less is its own slope.
CLEARANCE_PX = 1.5


def in_sight(depth_m: Floats, camera: Camera, points_m: Floats, to_light_m: Floats) -> Mask:
    """(M,) True where the ray to the light is free.

    depth_m : (H, W), NaN outside the object
    points_m, to_light_m : (M, 3) camera frame, points and vectors to the light (for a distant one
        far enough to leave the object)

    The surface extends from its depth to infinity along each ray.

    >>> camera = Camera(9, 1, fx=9.0, fy=9.0, cx=4.0, cy=0.0)
    >>> depth = np.where(np.arange(9) < 5, 0.5, 1.0)[None]
    >>> point, lamp = np.array([[2 / 9, 0.0, 1.0]]), np.array([[-4.0, 0.0, -1.0]])
    >>> in_sight(depth, camera, point, lamp).tolist()
    [False]
    """
    return Occluder.of(depth_m, camera).in_sight(points_m, to_light_m)


@dataclass(frozen=True, eq=False)
class Occluder:
    """A depth map that stands before lights, for many of them or many parts of its points.

    depth_m : (H, W) float64, infinite outside the object
    nearest_m : the least of it
    """

    depth_m: Floats
    camera: Camera
    nearest_m: float

    @classmethod
    def of(cls, depth_m: Floats, camera: Camera) -> Occluder:
        """That of a depth map (H, W), NaN outside the object."""
        solid = np.ascontiguousarray(np.where(np.isfinite(depth_m), depth_m, np.inf), np.float64)
        return cls(solid, camera, float(solid.min()))

    def in_sight(self, points_m: Floats, to_light_m: Floats) -> Mask:
        """(M,) True where the ray to the light is free; see `in_sight`."""
        camera = self.camera
        optics = (camera.fx, camera.fy, camera.cx, camera.cy)
        points, lights = (np.ascontiguousarray(a, np.float64) for a in (points_m, to_light_m))
        free = np.ones(len(points), dtype=bool)
        given = (self.depth_m, optics, self.nearest_m, points, lights, free)
        jit.in_parts(_march, 0, len(points), len(points), *given)
        return free


@jit.kernel
def _march(first, last, depth, optics, nearest, points, lights, free):  # type: ignore[no-untyped-def]
    fx, fy, cx, cy = optics
    height, width = depth.shape
    for i in range(first, last):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        lx, ly, lz = lights[i, 0], lights[i, 1], lights[i, 2]
        pixel_m = z / fx
        # pixels sideways, or as much in depth for lights near the axis
        sideways = max(np.hypot(lx - lz * x / z, ly - lz * y / z), 0.2 * abs(lz))
        step = STEP_PX * pixel_m / max(sideways, 1e-12)
        t = step
        while t < 1:
            zt = z + t * lz
            if zt <= nearest:
                break
            u = int(np.floor(fx * (x + t * lx) / zt + cx + 0.5))
            v = int(np.floor(fy * (y + t * ly) / zt + cy + 0.5))
            if u < 0 or v < 0 or u >= width or v >= height:
                break
            if depth[v, u] < zt - CLEARANCE_PX * pixel_m:
                free[i] = False
                break
            step *= STEP_GROWTH
            t += step
