"""Recordings whose depth and colour show the same view, as those of phones and recorders.

Where a file beside the frames states a depth camera of its own, that is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rakelight.capture.readers.stated_depth_camera import stated_depth_camera
from rakelight.capture.recording import Recording, Stream
from rakelight.errors import CaptureError
from rakelight.model import Camera, Finding, RigidTransform


def recording_of_one_view(
    path: Path,
    camera: Camera,
    color: Stream,
    depth: Stream,
    *,
    depth_source: str,
    names: Sequence[str],
    findings: Sequence[Finding],
    beside: Sequence[str] = (),
    texts: Sequence[Path] = (),
) -> Recording:
    """The recording at `path` of a depth stream that covers the colour frames' field of view.

    camera : of the colour frames; depth_source : names the depth in messages
    names : of the colour frames; beside : as of Recording
    texts : files that may state a depth camera of its own, which is then taken

    Raises CaptureError where the sides have other proportions, by more than a pixel of depth.
    """
    stated = stated_depth_camera(path, texts, camera, depth.shape)
    depth_camera, depth_to_color = stated.camera, stated.to_color
    if depth_camera is None:
        depth_camera, depth_to_color = depth_place(camera, depth.shape, depth_source)
    return Recording(
        source=str(path),
        camera=camera,
        color=color,
        depth=depth,
        depth_camera=depth_camera,
        depth_to_color=depth_to_color,
        names=tuple(names),
        findings=(*findings, *stated.findings),
        beside=tuple(beside),
    )


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
