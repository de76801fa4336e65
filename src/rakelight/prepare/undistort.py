"""Lens distortion taken out of a capture, once, before anything else looks at it.

The photographs are resampled in linear light to an ideal camera's pixels, each the mean of what
it covers.  Depth that covers the photographs' view is not resampled: as of a camera of its own, at
the colour camera's place and with its distortion, its points are registered along their rays
(rakelight.prepare.register), which mixes nothing across jumps and holes.  Of a vase, 240 x 180, the
refined depth is 0.70 mm off then, 0.92 mm with the nearest measurement of every pixel, 0.65 mm
without distortion (tests/pipeline/test_lens.py has such captures).
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, lcm

import numpy as np

from rakelight.errors import CaptureError
from rakelight.files import in_threads
from rakelight.geometry.distortion import to_pixels, to_rays
from rakelight.geometry.grid import outline
from rakelight.memory import require_memory
from rakelight.model import (
    BLACK,
    SATURATED,
    Array,
    Camera,
    Capture,
    Finding,
    Floats,
    Mask,
)
from rakelight.prepare.linear import linear_table, srgb
from rakelight.prepare.sensor import depth_camera_of, sensor_shape
from rakelight.scratch import large_empty, release

# Most that the image grows on each side to show the object whole, over its own side.
WIDEST = 0.5
WHITE_16_BIT = np.iinfo(np.uint16).max
# Bytes per pixel of the map between both images, and of each photograph while it is resampled.
_BYTES_OF_MAP, _BYTES_OF_PHOTOGRAPH = 150, 70


def undistorted(capture: Capture, *, whole: bool = True) -> Capture:
    """The capture as a camera without lens distortion would have made it.

    whole : whether the image grows where the object (the mask) would leave it; else it is cut off

    The camera keeps its focal lengths and its principal point on the object; its image has the
    photographs' size, unless it has to grow.  Photographs come with 16 bits, encoded as they were:
    8 would round away what shading is made of.  Pixels that mix saturated ones are saturated,
    those nearest to a black one black, and those that the lens did not show 0, outside the mask.

    A capture without distortion is returned as it is, and a distorted depth camera stays one: its
    depth is registered along its undistorted rays.

    Raises CaptureError where the object lies too far from the optical axis for such a camera.

    >>> from rakelight.model import Distortion
    >>> camera = Camera(8, 6, 20.0, 20.0, 3.5, 2.5, Distortion("brown-conrady", [0.1, 0, 0, 0]))
    >>> capture = Capture(np.full((3, 6, 8, 3), 90, np.uint8), np.ones((1, 6, 8)),
    ...                   np.ones((6, 8), bool), camera, "srgb")
    >>> ideal = undistorted(capture)
    >>> ideal.camera.distortion, ideal.photographs[0, 3, 4].tolist(), 90 * 257
    (None, [23130, 23130, 23130], 23130)
    """
    own, camera = capture.depth_camera, _without_zeros(capture.camera)
    if own is not None and (own := _without_zeros(own)) is not capture.depth_camera:
        capture = replace(capture, depth_camera=own)
    if camera.distortion is None:
        return capture if camera is capture.camera else replace(capture, camera=camera)
    ideal = _ideal_camera(capture, whole)
    require_memory(
        ideal.width * ideal.height * _BYTES_OF_MAP
        + camera.width * camera.height * _BYTES_OF_PHOTOGRAPH,
        source=capture.source,
        remedy="close other programs, or crop to the object",
    )
    place = _places(ideal, camera)
    mask = _seen(capture.mask, place)
    own, pose = depth_camera_of(replace(capture, camera=camera))
    return replace(
        capture,
        photographs=_resampled(capture, place),
        mask=mask,
        camera=ideal,
        depth_camera=own,
        depth_to_color=pose,
        findings=(*capture.findings, _finding(capture, ideal, place, mask)),
    )


def shown_by_lens(mask: Mask, ideal: Camera, camera: Camera) -> Mask:
    """A mask (h, w) of the ideal camera's image in that (H, W) of the camera with its distortion.

    >>> camera = Camera(3, 1, 10.0, 10.0, 1.0, 0.0)
    >>> shown_by_lens(np.array([[True, False, True]]), camera, camera).tolist()
    [[True, False, True]]
    """
    x, y = to_rays(*_pixels(camera), camera)
    u, v = to_pixels(x, y, ideal)
    inside = (u > -0.5) & (u < ideal.width - 0.5) & (v > -0.5) & (v < ideal.height - 0.5)
    shown = np.zeros(camera.shape, dtype=bool)
    shown[inside] = mask[np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)]
    return shown


def _without_zeros(camera: Camera) -> Camera:
    """The camera; without distortion where that is one of zeros."""
    lens = camera.distortion
    return replace(camera, distortion=None) if lens is not None and lens.is_none else camera


def _pixels(camera: Camera) -> tuple[Floats, Floats]:
    """u and v of every pixel, each (H, W)."""
    u, v = np.meshgrid(np.arange(float(camera.width)), np.arange(float(camera.height)))
    return u, v


def _ideal_camera(capture: Capture, whole: bool) -> Camera:
    """The camera without distortion, its image grown by whole depth pixels to show the mask."""
    camera = capture.camera
    ideal = replace(camera, distortion=None)
    # The lens maps the mask continuously, so its outline bounds it.
    rows, columns = (each.astype(float) for each in np.nonzero(outline(capture.mask)))
    u, v = to_pixels(*to_rays(columns, rows, camera), ideal)
    lost = not np.isfinite(u).all()
    step = _grows_by(capture)
    margins, most = [], []
    for place, side in ((u, camera.width), (v, camera.height)):
        place = place[np.isfinite(place)]
        beyond = (-place.min(initial=0), place.max(initial=0) - (side - 1))
        allowed = int(WIDEST * side / step) * step
        needed = [step * max(ceil(edge / step - 1e-6), 0) for edge in beyond]
        lost |= max(needed) > allowed
        margins.append([min(margin, allowed) for margin in needed])
        most.append(allowed)
    if lost and whole:
        raise CaptureError(
            "the object lies too far from the optical axis for an image without lens distortion",
            source=capture.source or "mask",
            seen=f"the mask reaches columns {np.nanmin(u):.0f} to {np.nanmax(u):.0f}, rows "
            f"{np.nanmin(v):.0f} to {np.nanmax(v):.0f} of {camera.width}x{camera.height}"
            if np.isfinite(u).any()
            else "the mask lies beyond 84 degrees from it",
            needed=f"at most {most[0]} columns and {most[1]} rows beyond the image",
            remedy="take the object into the middle of the image, or leave what is at the border "
            "out of the mask",
        )
    (left, right), (top, bottom) = margins
    return replace(
        ideal,
        width=left + camera.width + right,
        height=top + camera.height + bottom,
        cx=camera.cx + left,
        cy=camera.cy + top,
    )


def _grows_by(capture: Capture) -> int:
    """Pixels by which the image may grow, so that depth pixels and output scales still fit."""
    colour = capture.camera
    own = capture.depth_camera
    if own is None:
        return max(colour.width // sensor_shape(capture)[1], 1)
    factor = max(round(colour.fx / own.fx), 1)
    return lcm(*(s for s in range(1, factor + 1) if not colour.width % s and not colour.height % s))


def _places(ideal: Camera, camera: Camera) -> Floats:
    """(h, w, 2) u and v in the camera's image of the ideal camera's pixels; NaN = nowhere."""
    return np.stack(to_pixels(*to_rays(*_pixels(ideal), ideal), camera), axis=-1)


def _resampled(capture: Capture, place: Floats) -> Array:
    """(N, h, w, 3) uint16 photographs, encoded as they were."""
    from rakelight.prepare._kernels import resample

    dtype = capture.photographs.dtype
    table = linear_table(dtype, capture.encoding)
    saturated = table[ceil(SATURATED * capture.white)]
    black = table[int(BLACK * capture.white)]
    jacobian = np.broadcast_to(np.eye(2), (*place.shape[:2], 2, 2))
    if min(place.shape[:2]) > 1:
        derivatives = np.stack([np.gradient(place, axis=axis) for axis in (1, 0)], axis=-2)
        jacobian = np.where(np.isfinite(derivatives), derivatives, jacobian)
    weights = _lanczos()
    images = large_empty(
        (len(capture.photographs), *place.shape[:2], 3),
        "uint16",
        capture.source or "photographs",
        "crop to the object",
    )

    def resample_one(i: int) -> None:
        linear = table.take(capture.photographs[i])
        out = np.empty((*place.shape[:2], 3), dtype=np.float32)
        total = np.empty(3)
        resample(0, len(out), linear, place, jacobian, saturated, black, weights, total, out)
        code = srgb(out) if capture.encoding == "srgb" else out
        images[i] = np.rint(WHITE_16_BIT * code)
        release(images)
        release(capture.photographs)

    in_threads(resample_one, range(len(images)))
    return images


def _lanczos() -> Floats:
    """(1025, 6) weights of the six pixels around a fraction 0, 1/1024, ... 1 of a pixel.

    Lanczos' of three lobes.  Normals of a vase, 240 x 180, through lenses that move the object by
    3.5 pixels: 1.68 degrees off, 1.83 with Keys' cubic, 2.25 with linear interpolation, which blur.
    """
    offset = np.arange(6) - 2 - np.linspace(0, 1, 1025)[:, None]
    weights = np.sinc(offset) * np.sinc(offset / 3)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _seen(mask: Mask, place: Floats) -> Mask:
    """(h, w) the ideal pixels whose centre the lens shows in the mask (H, W).

    Between pixels the mask is interpolated: its outline runs where half of it is.
    """
    from scipy.ndimage import map_coordinates

    height, width = mask.shape
    with np.errstate(invalid="ignore"):  # NaN is not inside, either
        within = (place >= -0.5) & (place <= (width - 0.5, height - 0.5))
    inside = within[..., 0] & within[..., 1]
    seen = np.zeros(inside.shape, dtype=bool)
    seen[inside] = (
        map_coordinates(mask.astype(np.float32), place[inside].T[::-1], order=1, mode="nearest")
        > 0.5
    )
    return seen


def _finding(capture: Capture, ideal: Camera, place: Floats, mask: Mask) -> Finding:
    lens, camera = capture.camera.distortion, capture.camera
    u, v = _pixels(ideal)
    left, top = ideal.cx - camera.cx, ideal.cy - camera.cy
    moved = np.hypot(place[..., 0] - u + left, place[..., 1] - v + top)[mask]
    message = (
        f"lens distortion ({lens.model if lens else ''}) taken out, up to "
        f"{moved.max(initial=0):.1f} pixels on the object"
    )
    if ideal.shape != camera.shape:
        message += f"; the image grew to {ideal.width}x{ideal.height} to show it whole"
    return Finding("note", "undistorted", message)


__all__ = ["shown_by_lens", "undistorted"]
