"""Where a phone's depth lies in its colour frames."""

from __future__ import annotations

import numpy as np

from rakelight.errors import CaptureError
from rakelight.model import Camera, RigidTransform


def depth_place(
    camera: Camera, shape: tuple[int, int], source: str
) -> tuple[Camera | None, RigidTransform | None]:
    """depth_camera and depth_to_color of depth (h, w) that covers the colour frames' view.

    None where the colour frames have a whole number of pixels per pixel of depth, else (1920x1440
    over 256x192 is 7.5) a depth camera at the colour camera's place.  Both give the same result: of
    three synthetic objects at 8 pixels per pixel of depth, depth and normals agree in all digits.

    Raises CaptureError where the sides have other proportions, by more than a pixel of depth.

    >>> color = Camera(1920, 1440, 1450.0, 1450.0, 959.5, 719.5)
    >>> depth_place(color, (480, 640), "depth")
    (None, None)
    >>> depth_camera, _ = depth_place(color, (192, 256), "depth")
    >>> depth_camera.cx
    127.5
    """
    (h, w), (height, width) = shape, camera.shape
    if abs(w * height - h * width) > max(width, height):
        turned = abs(h * height - w * width) <= max(width, height)
        raise CaptureError(
            "depth and colour are turned against each other"
            if turned
            else "depth and colour have other proportions",
            source=source,
            seen=f"depth {w}x{h}, colour {width}x{height}",
            needed="the same field of view",
            remedy="export both as the camera recorded them, neither turned nor cut",
        )
    if (width % w, height % h) == (0, 0) and width // w == height // h:
        return None, None
    return camera.resized(w, h), RigidTransform(np.eye(3), np.zeros(3))
