"""Pixel convention and back-projection of the pinhole camera."""

from __future__ import annotations

import numpy as np

from rakelight.model import Camera, Floats


def pixel_rays(camera: Camera) -> tuple[Floats, Floats]:
    """Offsets x = u - cx (1, W) and y = v - cy (H, 1) of the pixel centres, in pixels.

    They broadcast against (H, W) images.

    >>> x, y = pixel_rays(Camera(3, 2, fx=10.0, fy=10.0, cx=1.0, cy=0.5))
    >>> x.tolist(), y.tolist()
    ([[-1.0, 0.0, 1.0]], [[-0.5], [0.5]])
    """
    x = np.arange(camera.width, dtype=np.float64)[None, :] - camera.cx
    y = np.arange(camera.height, dtype=np.float64)[:, None] - camera.cy
    return x, y


def back_project(depth_m: Floats, camera: Camera) -> Floats:
    """Points (H, W, 3), metres in the camera frame, of a depth map (H, W) in metres.

    >>> camera = Camera(3, 1, fx=10.0, fy=10.0, cx=1.0, cy=0.0)
    >>> back_project(np.full((1, 3), 2.0), camera)[0, 2].tolist()
    [0.2, 0.0, 2.0]
    """
    x, y = pixel_rays(camera)
    return np.stack([depth_m * x / camera.fx, depth_m * y / camera.fy, depth_m], axis=-1)
