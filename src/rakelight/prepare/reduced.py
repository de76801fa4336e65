"""A capture at lower resolution, cut to its object: for a quick look at it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rakelight.geometry.grid import area_mean, bounding_window
from rakelight.model import Camera, Capture, Floats
from rakelight.prepare import shrunk_photographs
from rakelight.prepare.sensor import SensorGrid, depth_camera_of, sensor_shape

# Pixels around the object that are kept, so that its outline has an outside.
MARGIN_PX = 8
# Fraction of the nearest depth in a block, beyond which depth there is another surface's: 2 % is 10
# mm at 0.5 m, more than a sensor's noise, less than most jumps.
SAME_SURFACE = 0.02
# Least fraction of the pixels expected at a resolution: a narrow object would be lost below.
KEPT = 0.5


def reduced(capture: Capture, most_pixels: int) -> Capture:
    """The capture with at most about `most_pixels` of the object, where its sides allow it.

    Photographs are averaged in linear light (`shrunk_photographs`).  Depth is averaged over blocks
    where its pixels would be smaller than the photographs'.  What is already small is only cut.

    >>> capture = Capture(np.full((3, 40, 40, 3), 9, np.uint8), np.ones((1, 20, 20), np.float32),
    ...                   np.ones((40, 40), bool), Camera(40, 40, 50.0, 50.0, 19.5, 19.5))
    >>> small = reduced(capture, 100)
    >>> small.photographs.shape, small.depth_m.shape, small.camera.fx
    ((3, 10, 10, 3), (1, 10, 10), 12.5)
    """
    ratio = SensorGrid(sensor_shape(capture), capture.camera.shape).factor
    if ratio != int(ratio):  # no block of colour pixels is a whole number of depth pixels
        own, pose = depth_camera_of(capture)
        capture = replace(capture, depth_camera=own, depth_to_color=pose)
    for shrink in reversed(_shrinks(capture, ratio, most_pixels)):
        small = _at(capture, shrink, ratio)
        if small.mask.sum() >= KEPT * capture.mask.sum() / shrink**2:
            return small
    return _at(capture, 1, ratio)


def _shrinks(capture: Capture, ratio: float, most_pixels: int) -> list[int]:
    """Colour pixels along each side of a pixel, up to the first that leaves few enough of them.

    ratio : colour pixels per depth pixel; whole where depth is on the photographs' grid, of which
        one is a multiple of the other then, so that depth pixels stay whole.
    """
    most = max(min(capture.mask.shape) // 4, 1)
    whole = capture.depth_camera is None
    fits = [k for k in range(1, most + 1) if not whole or k % ratio == 0 or ratio % k == 0]
    few = next((i for i, k in enumerate(fits) if capture.mask.sum() <= most_pixels * k**2), None)
    return fits if few is None else fits[: few + 1]


def _at(capture: Capture, shrink: int, ratio: float) -> Capture:
    """The capture with `shrink` times fewer pixels along each side."""
    own = capture.depth_camera
    block = shrink if own is not None else max(shrink, int(ratio))
    window = bounding_window(capture.mask, MARGIN_PX)
    parts = []
    for part, side in zip(window, capture.mask.shape, strict=True):
        most = side // block * block
        parts.append(slice(part.start // block * block, min(-(-part.stop // block) * block, most)))
    rows, columns = parts
    join = max(int(shrink / ratio), 1)
    if own is None:
        inside = [slice(part.start // int(ratio), part.stop // int(ratio)) for part in parts]
        depth_m, depth_camera = joined(capture.depth_m[:, *inside], join), None
    else:
        depth_m = joined(capture.depth_m, join)
        depth_camera = shrunk_camera(own, join)
    cut = replace(
        capture,
        photographs=np.ascontiguousarray(capture.photographs[:, rows, columns]),
        mask=np.ascontiguousarray(capture.mask[rows, columns]),
        camera=capture.camera.cropped(rows, columns),
        depth_m=depth_m,
        depth_camera=depth_camera,
        register=False,
    )
    if shrink == 1:
        return cut
    return replace(
        cut,
        photographs=shrunk_photographs(cut, shrink),
        mask=area_mean(cut.mask, shrink) == 1,
        camera=shrunk_camera(cut.camera, shrink),
    )


def shrunk_camera(camera: Camera, factor: int) -> Camera:
    """The camera with blocks of factor x factor pixels as pixels; what fills none is cut off.

    >>> shrunk_camera(Camera(5, 4, 9.0, 9.0, 2.0, 1.5), 2).shape
    (2, 2)
    """
    height, width = (side // factor for side in camera.shape)
    whole = camera.cropped(slice(0, height * factor), slice(0, width * factor))
    return whole.resized(width, height)


def joined(depth_m: Floats, factor: int) -> Floats:
    """Depth maps (K, h, w) averaged over blocks; of a block at a jump the nearer surface alone.

    NaN where less than half of a block is measured.

    >>> joined(np.array([[[1.0, 1.01, 1.0, 2.0], [1.0, 1.01, np.nan, np.nan]]]), 2).tolist()
    [[[1.0049..., 1.0]]]
    """
    if factor == 1:
        return depth_m
    height, width = (side // factor * factor for side in depth_m.shape[1:])
    blocks = np.stack(
        [depth_m[:, row:height:factor, column:width:factor]
         for row, column in np.ndindex(factor, factor)]
    )  # fmt: skip
    measured = np.isfinite(blocks)
    nearest = np.fmin.reduce(blocks, axis=0)
    same = measured & (np.where(measured, blocks, np.inf) <= (1 + SAME_SURFACE) * nearest)
    total = np.where(same, blocks, 0.0).sum(axis=0)
    mean = total / np.maximum(same.sum(axis=0), 1)
    enough = measured.sum(axis=0) >= factor**2 / 2
    return np.where(enough, mean, np.nan).astype(np.float32)
