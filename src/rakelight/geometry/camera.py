"""Pixel convention and back-projection of the pinhole camera."""

from __future__ import annotations

import numpy as np

from rakelight.errors import InputError
from rakelight.geometry.distortion import to_rays
from rakelight.model import Camera, Floats

ALL = slice(None)
"""The rows of an image, where only some can be asked for."""


def pixel_rays(camera: Camera, rows: slice = ALL) -> tuple[Floats, Floats]:
    """Offsets x = u - cx (1, W) and y = v - cy (H, 1) of the pixel centres, in pixels.

    They broadcast against (H, W) images.  Only of these rows, (h, 1), where such are named.  Raises
    InputError for a camera with lens distortion.

    >>> x, y = pixel_rays(Camera(3, 2, fx=10.0, fy=10.0, cx=1.0, cy=0.5))
    >>> x.tolist(), y.tolist()
    ([[-1.0, 0.0, 1.0]], [[-0.5], [0.5]])
    """
    require_ideal(camera)
    x = np.arange(camera.width, dtype=np.float64)[None, :] - camera.cx
    y = np.arange(camera.height, dtype=np.float64)[rows, None] - camera.cy
    return x, y


def focal_px(camera: Camera) -> float:
    """The focal length of a square pixel of the same area, pixels: z over it is a pixel's side.

    >>> focal_px(Camera(3, 2, fx=200.0, fy=800.0, cx=1.0, cy=0.5))
    400.0
    """
    return float(np.sqrt(camera.fx * camera.fy))


def back_project(depth_m: Floats, camera: Camera, rows: slice = ALL) -> Floats:
    """Points (H, W, 3), metres in the camera frame, of a depth map (H, W) in metres.

    rows : those of the camera's image that the depth map has

    Along the undistorted rays of a camera with lens distortion, NaN where it has none.

    >>> camera = Camera(3, 1, fx=10.0, fy=10.0, cx=1.0, cy=0.0)
    >>> back_project(np.full((1, 3), 2.0), camera)[0, 2].tolist()
    [0.2, 0.0, 2.0]
    """
    if camera.distortion is not None:
        u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height))[rows])
        x, y = to_rays(u, v, camera)
        return np.stack([depth_m * x, depth_m * y, depth_m], axis=-1)
    x, y = pixel_rays(camera, rows)
    return np.stack([depth_m * x / camera.fx, depth_m * y / camera.fy, depth_m], axis=-1)


def require_ideal(camera: Camera, source: str = "camera") -> None:
    """Raise InputError where a camera has lens distortion that nothing would take into account.

    >>> require_ideal(Camera(3, 1, 10.0, 10.0, 1.0, 0.0))
    """
    if camera.distortion is not None:
        raise InputError(
            "a camera with lens distortion",
            source=source,
            seen=camera.distortion.model,
            needed="a camera without",
            remedy="hand the capture to rakelight.refine, which undistorts it, or to "
            "rakelight.prepare.undistort.undistorted",
        )
