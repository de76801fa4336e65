"""Pictures put together: titled panels in rows and columns."""

from __future__ import annotations

import cv2
import numpy as np

from rakelight.capture.images import as_rgb, encode_jpeg
from rakelight.model import Array

BACKGROUND = 32
TITLE_PX = 22
GAP_PX = 8


def side_by_side(*images: Array, gap: int = 16) -> Array:
    """Pictures (H, W) or (H, W, 3) uint8 of one size in a row, `gap` dark pixels between them.

    >>> side_by_side(np.zeros((2, 3), np.uint8), np.zeros((2, 3), np.uint8), gap=1).shape
    (2, 7)
    """
    first = images[0]
    space = np.full((first.shape[0], gap, *first.shape[2:]), BACKGROUND, np.uint8)
    row = [first]
    for image in images[1:]:
        row += [space, image]
    return np.concatenate(row, axis=1)


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
    return encode_jpeg(image, 80)
