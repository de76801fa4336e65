"""The maps that the viewer draws, encoded as text: what viewer/encoded_maps.js reads.

Every map is cut to the object's window and, as rows of whole numbers, predicted from its
neighbours, deflated and written in base64.
"""

from __future__ import annotations

import zlib
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from rakelight.export.confidence import confidence_values
from rakelight.geometry.fill import nearest_fill
from rakelight.geometry.grid import STEEPEST, all_finite
from rakelight.geometry.normals import surface_normals
from rakelight.model import Array, Camera, Floats, Mask, Result
from rakelight.pictures.shown import object_window, shown_at, shown_depth, shown_normals
from rakelight.prepare.linear import srgb

MOST_TRIANGLES = 150_000
# Largest code of a depth, and of a normal's octahedral coordinates.
DEEPEST = 65535
OCTAHEDRAL = 4095


@dataclass(frozen=True, slots=True)
class EncodedMap:
    """One map: its name, bits per value (8 or 16), and its text, which is safe in HTML."""

    name: str
    bits: int
    text: Markup


@dataclass(frozen=True, slots=True)
class Maps:
    """What the viewer shows of a result, at the resolution that it shows.

    before_m, after_m : (h, w) metres, NaN outside; before, after : (h, w, 3) normals
    albedo : (h, w, 3) linear; confidence : (h, w) 0..1; shrunk : pixels of the result per pixel
    """

    camera: Camera
    before_m: Floats
    after_m: Floats
    before: Floats
    after: Floats
    albedo: Floats
    confidence: Floats
    shrunk: int = 1


def viewer_maps(result: Result) -> Maps:
    """The maps of a result in the object's window, with a resolution that a page can hold."""
    camera, factor, before_m, after_m = shown_depth(result)
    window = object_window(result.mask)
    albedo, confidence = (
        shown_at(image[window], factor) for image in (result.albedo, result.confidence)
    )
    return Maps(
        camera,
        before_m,
        after_m,
        surface_normals(before_m, np.isfinite(before_m), camera),
        shown_normals(result.normals[window], factor),
        albedo,
        confidence,
        shrunk=factor,
    )


def pack(maps: Maps) -> tuple[list[EncodedMap], dict[str, Any]]:
    """The encoded maps, and the facts that the viewer needs to decode them."""
    depths = np.stack([maps.before_m, maps.after_m])
    known = depths[np.isfinite(depths)]  # none of an object that is thinner than a block
    nearest, deepest = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    step = max((deepest - nearest) / (DEEPEST - 1), 1e-9)
    encoded = []
    for name, values in _values(maps, nearest, step):
        encoded.append(EncodedMap(name, 8 * values.dtype.itemsize, encode(values)))
    camera = maps.camera
    sizes = {"width": camera.width, "height": camera.height}
    facts = {
        "maps": [{"name": each.name, "bits": each.bits, **sizes} for each in encoded],
        "camera": {name: getattr(camera, name) for name in (*sizes, "fx", "fy", "cx", "cy")},
        "depth": {"nearest_m": nearest, "step_m": step},
        "mesh": {"most_triangles": MOST_TRIANGLES, "steepest": STEEPEST},
    }
    return encoded, facts


def _values(maps: Maps, nearest_m: float, step_m: float) -> Iterator[tuple[str, Array]]:
    for name, depth_m, normals in (
        ("before", maps.before_m, maps.before),
        ("after", maps.after_m, maps.after),
    ):
        yield f"depth-{name}", quantised(depth_m, nearest_m, step_m)
        inside = all_finite(normals)
        first, second = octahedral(_continued(normals, inside))
        yield f"{name}-a", first
        yield f"{name}-b", second
    inside = np.asarray(np.isfinite(maps.after_m))
    colours = np.rint(255 * srgb(_continued(maps.albedo, inside))).astype(np.uint8)
    for channel, name in enumerate(("red", "green", "blue")):
        yield name, np.ascontiguousarray(colours[..., channel])
    yield "confidence", confidence_values(_continued(maps.confidence, inside))


def quantised(depth_m: Floats, nearest_m: float, step_m: float) -> Array:
    """uint16 steps of a depth (h, w) from the nearest, counted from 1; 0 where it is NaN.

    >>> quantised(np.array([[0.5, np.nan, 0.502]]), 0.5, 0.001).tolist()
    [[1, 0, 3]]
    """
    inside = np.isfinite(depth_m)
    steps = np.rint((np.where(inside, depth_m, nearest_m).astype(float) - nearest_m) / step_m)
    return np.where(inside, np.clip(steps, 0, DEEPEST - 1) + 1, 0).astype(np.uint16)


def octahedral(normals: Floats) -> tuple[Array, Array]:
    """Unit normals (h, w, 3) on the unfolded octahedron: two images of 12 bits, uint16.

    The middle of the square faces the camera.

    >>> [int(image[0, 0]) for image in octahedral(np.array([[[0.0, 0.0, -1.0]]]))]
    [2048, 2048]
    """
    n = normals / np.maximum(np.abs(normals).sum(axis=-1, keepdims=True), 1e-12)
    x, y = n[..., 0], n[..., 1]
    away = n[..., 2] > 0
    folded = (
        np.where(away, (1 - np.abs(y)) * np.where(x < 0, -1, 1), x),
        np.where(away, (1 - np.abs(x)) * np.where(y < 0, -1, 1), y),
    )
    first, second = (
        np.rint(np.clip(0.5 * image + 0.5, 0, 1) * OCTAHEDRAL).astype(np.uint16) for image in folded
    )
    return first, second


def encode(values: Array) -> Markup:
    """uint8 or uint16 (h, w) as text.

    >>> values = np.array([[5, 6], [7, 9]], np.uint8)
    >>> import base64
    >>> zlib.decompress(base64.b64decode(encode(values))).hex()
    '05010201'
    """
    # Differences wrap around, and so does the sum that undoes them.
    rows = np.diff(values, axis=1, prepend=np.zeros_like(values[:, :1]))
    left = np.diff(rows, axis=0, prepend=np.zeros_like(rows[:1]))
    if values.dtype == np.uint16:
        data = (left & 255).astype(np.uint8).tobytes() + (left >> 8).astype(np.uint8).tobytes()
    else:
        data = left.tobytes()
    # What is left repeats itself in runs of zeros only: the search for more would take long.
    deflate = zlib.compressobj(strategy=zlib.Z_RLE)
    return Markup(b64encode(deflate.compress(data) + deflate.flush()).decode("ascii"))


def _continued(image: Floats, inside: Mask) -> Floats:
    """An image (h, w[, C]) whose pixels outside have the value of the nearest one inside.

    Textures are read between pixels: at the outline they must not mix with a background.
    """
    return nearest_fill(image, inside) if inside.any() else np.nan_to_num(image)
