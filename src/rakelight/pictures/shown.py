"""What a screen shows of a result: its object, at no more pixels than a screen has."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.grid import area_mean, bounding_window
from rakelight.model import Camera, Floats, Mask, Result

# Most pixels of a picture or map that is shown, and along a side; larger ones are averaged.  A page
# with maps of 1.5 megapixels takes 15 MB, where they are all object and noisy.
MOST_PIXELS, LONGEST_SIDE = 1_400_000, 4096


def object_window(mask: Mask, *, margin: int = 8) -> tuple[slice, slice]:
    """Rows and columns of the object with `margin` pixels around it, inside the image.

    >>> mask = np.zeros((50, 60), bool)
    >>> mask[20:30, 5:40] = True
    >>> object_window(mask)
    (slice(12, 38, None), slice(0, 48, None))
    """
    height, width = mask.shape
    return bounding_window(mask, margin) if mask.any() else (slice(0, height), slice(0, width))


def prepared_mask(result: Result) -> Mask:
    """(H, W) where the object had a depth before it was refined."""
    before_m = result.prepared_depth
    return np.asarray(result.mask & np.isfinite(before_m) & (np.nan_to_num(before_m) > 0))


def display_factor(camera: Camera) -> int:
    """Pixels along the side of a block that is averaged, so that a screen can show an image.

    >>> display_factor(Camera(1000, 1000, 1.0, 1.0, 0.0, 0.0))
    1
    >>> display_factor(Camera(6000, 4000, 1.0, 1.0, 0.0, 0.0))
    5
    """
    factor = 1
    while (
        camera.width * camera.height > MOST_PIXELS * factor**2
        or max(camera.shape) > LONGEST_SIDE * factor
    ):
        factor += 1
    return factor


def shown_depth(result: Result) -> tuple[Camera, int, Floats, Floats]:
    """What a screen shows of a result: camera, `display_factor`, and two depths, metres.

    The prepared and the refined one (h, w), cropped to the object, NaN outside.  Averaged over
    blocks where there are more pixels than a screen shows; what does not fill a block is cut off.
    """
    window = object_window(result.mask)
    camera = result.camera.cropped(*window)
    factor = display_factor(camera)
    # An object so thin that it fills no block is shown finer, up to twice along both sides.
    for finer in range(factor, max(factor // 2, 1) - 1, -1):
        if (shown_at(1.0 * result.mask[window], finer) == 1).any():
            factor = finer
            break
    camera = camera.cropped(*whole_blocks(camera, factor)).scaled(1 / factor)
    before_m = np.where(prepared_mask(result)[window], result.prepared_depth[window], np.nan)
    after_m = np.where(result.mask[window], result.depth[window], np.nan)
    before_m, after_m = (shown_at(each, factor) for each in (before_m, after_m))
    return camera, factor, before_m, after_m


def whole_blocks(camera: Camera, factor: int) -> tuple[slice, slice]:
    """The rows and columns of a camera's image that fill blocks of factor x factor pixels."""
    height, width = (side // factor * factor for side in camera.shape)
    return slice(0, height), slice(0, width)


def shown_at(image: Floats, factor: int) -> Floats:
    """An image (H, W[, C]) averaged over blocks, itself for a factor of 1."""
    if factor == 1:
        return image
    height, width = (side // factor * factor for side in image.shape[:2])
    return area_mean(image[:height, :width], factor)


def shown_normals(normals: Floats, factor: int) -> Floats:
    """Unit normals (h, w, 3) averaged over blocks, themselves for a factor of 1."""
    if factor == 1:
        return normals
    mean = shown_at(normals, factor)
    return np.asarray(mean / np.maximum(np.linalg.norm(mean, axis=-1, keepdims=True), 1e-12))
