"""How the figures are put together: titled panels in rows, surfaces from the side, profiles."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

import cv2
import numpy as np

from rakelight.capture.images import as_rgb
from rakelight.export.pictures import BACKGROUND, object_window, shaded
from rakelight.geometry.mesh import triangulate
from rakelight.geometry.normals import normals_from_depth
from rakelight.metrics import color_errors
from rakelight.model import Array, Camera, Floats, Mask
from rakelight.prepare.linear import srgb

Window = tuple[slice, slice]
"""Rows and columns."""

TITLE_PX = 22
GAP_PX = 8
MARGIN_PX = 8


def panel(picture: Array, title: str, width: int = 0) -> Array:
    """A picture as RGB under its title, scaled to `width` when one is given.

    >>> panel(np.zeros((10, 20), np.uint8), "nothing", width=40).shape
    (42, 40, 3)
    """
    image = as_rgb(picture)
    if width:
        height = round(image.shape[0] * width / image.shape[1])
        method = cv2.INTER_AREA if width < image.shape[1] else cv2.INTER_CUBIC
        image = np.asarray(cv2.resize(image, (width, height), interpolation=method))
    strip = np.full((TITLE_PX, image.shape[1], 3), BACKGROUND, np.uint8)
    scale = 0.45
    length = cv2.getTextSize(title, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)[0][0]
    scale *= min(1.0, (image.shape[1] - 4) / max(length, 1))
    white = (230, 230, 230)
    place = (2, TITLE_PX - 7)
    cv2.putText(strip, title, place, cv2.FONT_HERSHEY_SIMPLEX, scale, white, 1, cv2.LINE_AA)
    return np.concatenate([strip, image])


def in_row(*panels: Array) -> Array:
    """Panels side by side, from their tops, on the dark background.

    >>> in_row(np.zeros((4, 5, 3), np.uint8), np.zeros((6, 5, 3), np.uint8)).shape
    (6, 18, 3)
    """
    return _joined(panels, axis=1)


def in_column(*panels: Array) -> Array:
    """Panels below each other, from their left."""
    return _joined(panels, axis=0)


def _joined(panels: tuple[Array, ...], axis: int) -> Array:
    other = 1 - axis
    longest = max(each.shape[other] for each in panels)
    padded = []
    for number, each in enumerate(panels):
        edges = [(0, 0), (0, 0), (0, 0)]
        edges[other] = (0, longest - each.shape[other])
        edges[axis] = (GAP_PX if number else 0, 0)
        padded.append(np.pad(each, edges, constant_values=BACKGROUND))
    return np.concatenate(padded, axis=axis)


def small_jpeg(picture: Array, width: int) -> bytes:
    """A picture as JPEG, at most `width` pixels wide, for pages.

    >>> small_jpeg(np.zeros((20, 30), np.uint8), 10)[:2]
    b'\\xff\\xd8'
    """
    image = as_rgb(picture)
    if image.shape[1] > width:
        height = round(image.shape[0] * width / image.shape[1])
        image = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA))
    bgr = np.ascontiguousarray(image[..., ::-1])
    return bytes(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes())


def clay(depth_m: Floats, mask: Mask, camera: Camera) -> Array:
    """(H, W) a depth map as bare clay, dark where there is none."""
    valid = mask & np.isfinite(depth_m)
    return shaded(normals_from_depth(depth_m, valid, camera), valid)


def depth_colors(depth_m: Floats, mask: Mask) -> Array:
    """(H, W, 3) near is blue, far is red, white is no measurement; 2 % of either end are cut."""
    low, high = np.nanquantile(np.where(mask, depth_m, np.nan), [0.02, 0.98])
    shown = np.where(mask, depth_m - low, np.nan)
    picture = color_errors(np.maximum(shown, 0), max(float(high - low), 1e-6))
    return np.where(mask[..., None], picture, BACKGROUND).astype(np.uint8)


def photograph_picture(linear: Floats) -> Array:
    """(H, W, 3) uint8 sRGB of linear light, white being 1."""
    return np.rint(srgb(linear) * 255).astype(np.uint8)


FACE = (0.27, 0.45)
"""Where the bust's eyes and nose are: down and across its window."""


def close_up(mask: Mask, where: tuple[float, float] = FACE, share: float = 0.2) -> Window:
    """A square window around `where` (down, across) in the object's window.

    share : its side over the object's height

    >>> close_up(np.ones((100, 80), bool))
    (slice(17, 37, None), slice(26, 46, None))
    """
    rows, columns = object_window(mask, margin=0)
    height, width = rows.stop - rows.start, columns.stop - columns.start
    side = max(4, round(share * height))
    top = rows.start + round(where[0] * height - side / 2)
    left = columns.start + round(where[1] * width - side / 2)
    return slice(max(0, top), top + side), slice(max(0, left), left + side)


def turned(depth_m: Floats, mask: Mask, camera: Camera, yaw_deg: float) -> Array:
    """A depth map as clay, turned about the upright axis through its middle, cropped to it.

    90 degrees shows its profile, the front to the left.  Parallel projection, a pixel is as large
    as a pixel in the middle of the object.  Nothing is drawn across depth jumps.

    >>> camera = Camera(9, 9, fx=9.0, fy=9.0, cx=4.0, cy=4.0)
    >>> turned(np.ones((9, 9)), np.ones((9, 9), bool), camera, 60.0).shape
    (25, 21)
    """
    mesh = triangulate(depth_m, mask & np.isfinite(depth_m), camera)
    middle_m = np.median(mesh.vertices_m, axis=0)
    cos, sin = np.cos(radians(yaw_deg)), np.sin(radians(yaw_deg))
    turn = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    pixels = (mesh.vertices_m - middle_m) @ turn.T * camera.fx / middle_m[2]
    corners = pixels[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    grey = shaded(normals[None], np.ones((1, len(normals)), bool))[0]
    return _splatted(corners, grey)


def _splatted(corners: Floats, grey: Array) -> Array:
    """A picture that just holds triangles (F, 3, 3), in pixels, the nearest in front."""
    steps = np.arange(5) / 4
    share = np.array([(1 - a - b, a, b) for a in steps for b in steps if a + b <= 1])
    points = np.einsum("kc,fcd->fkd", share, corners).reshape(-1, 3)
    place = np.rint(points[:, :2] - points[:, :2].min(axis=0)).astype(int) + MARGIN_PX
    width, height = place.max(axis=0) + 1 + MARGIN_PX
    order = np.argsort(-points[:, 2], kind="stable")  # the farthest first, then overdrawn
    picture = np.full((height, width), BACKGROUND, np.uint8)
    picture[place[order, 1], place[order, 0]] = np.repeat(grey, len(share))[order]
    return picture


@dataclass(frozen=True, slots=True)
class Sample:
    """One pixel of a line across several depth maps, millimetres; None where there is no depth."""

    pixel: int
    depth: str
    mm: float | None


def profile(line: tuple[slice | int, slice | int], **depth_m: Floats) -> list[Sample]:
    """The depth maps along a line of pixels, such as (row, slice).

    >>> profile((0, slice(1, 2)), truth=np.array([[1.0, 2.0]]))
    [Sample(pixel=1, depth='truth', mm=2000.0)]
    """
    along = next(each for each in line if isinstance(each, slice))
    return [
        Sample(along.start + k, name, round(1000 * float(z), 4) if np.isfinite(z) else None)
        for name, depth in depth_m.items()
        for k, z in enumerate(depth[line])
    ]
