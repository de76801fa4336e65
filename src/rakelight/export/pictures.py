"""Pictures for people: clay shading, before beside after."""

from __future__ import annotations

import numpy as np

from rakelight.capture.images import encode_png
from rakelight.export.normals import normal_map
from rakelight.geometry.grid import area_mean, bounding_window
from rakelight.geometry.normals import surface_normals
from rakelight.model import Array, Camera, Floats, Mask, Result
from rakelight.prepare.linear import srgb

BACKGROUND = 32

# Most pixels of a picture or map that is shown, and along a side; larger ones are averaged.  A page
# with maps of 1.5 megapixels takes 15 MB, where they are all object and noisy.
MOST_PIXELS, LONGEST_SIDE = 1_400_000, 4096

# Confidence 0 to 1, as even steps of lightness that the colour-blind see too (cividis).
CONFIDENCE_COLORS = (
    (0, 34, 78), (66, 78, 108), (125, 124, 120), (187, 174, 109), (254, 232, 56)
)  # fmt: skip

# Towards a lamp low at the upper left, camera frame (x right, y down, z forward).
RAKING = (-0.75, -0.6, -0.3)


def shaded(normals: Floats, mask: Mask, light: tuple[float, float, float] = RAKING) -> Array:
    """Grey clay under a raking lamp and a weak headlight.

    Parameters
    ----------
    normals : (H, W, 3) unit vectors, camera frame
    mask : (H, W) True = object; the rest is dark grey
    light : towards the raking lamp, camera frame, any length

    Returns
    -------
    (H, W) uint8, sRGB encoded

    Examples
    --------
    >>> facing_the_lamp = np.array([[[0.0, 0.0, -1.0]]])
    >>> int(shaded(facing_the_lamp, np.array([[True]]), light=(0, 0, -1))[0, 0])
    255
    """
    lamp = np.asarray(light, np.float32) / np.linalg.norm(light)
    n = np.where(mask[..., None], normals, 0).astype(np.float32)
    brightness = 0.9 * np.clip(n @ lamp.astype(np.float32), 0, 1) + 0.1 * np.clip(-n[..., 2], 0, 1)
    return np.where(mask, np.rint(srgb(brightness) * 255), BACKGROUND).astype(np.uint8)


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


def albedo_picture(albedo: Floats, mask: Mask) -> Array:
    """(H, W, 3) uint8 sRGB of a linear albedo (H, W, 3).

    >>> albedo_picture(np.ones((1, 1, 3)), np.array([[True]])).tolist()
    [[[255, 255, 255]]]
    """
    return _on_background(np.rint(255 * srgb(albedo)), mask)


def normals_picture(normals: Floats, mask: Mask) -> Array:
    """(H, W, 3) uint8 of normals (H, W, 3) in OpenGL's colours.

    >>> normals_picture(np.array([[[0.0, 0.0, -1.0]]]), np.array([[True]])).tolist()
    [[[128, 128, 255]]]
    """
    return _on_background(normal_map(normals), mask)


def confidence_picture(confidence: Floats, mask: Mask) -> Array:
    """(H, W, 3) uint8 of a confidence (H, W) in the colours of `CONFIDENCE_COLORS`.

    >>> confidence_picture(np.array([[1.0]]), np.array([[True]])).tolist()
    [[[254, 232, 56]]]
    """
    stops = np.linspace(0, 1, len(CONFIDENCE_COLORS))
    colors = np.array(CONFIDENCE_COLORS, float)
    picture = [np.interp(confidence, stops, column) for column in colors.T]
    return _on_background(np.rint(np.stack(picture, axis=-1)), mask)


def _on_background(picture: Array, mask: Mask) -> Array:
    return np.where(mask[..., None], np.nan_to_num(picture), BACKGROUND).astype(np.uint8)


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
    camera = camera if factor == 1 else camera.cropped(*whole_blocks(camera, factor))
    before_m = np.where(prepared_mask(result)[window], result.prepared_depth[window], np.nan)
    after_m = np.where(result.mask[window], result.depth[window], np.nan)
    before_m, after_m = (shown_at(each, factor) for each in (before_m, after_m))
    return (camera if factor == 1 else camera.scaled(1 / factor)), factor, before_m, after_m


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


def preview(result: Result) -> Array:
    """The prepared depth (left) and the refined one (right) as clay, cropped to the object."""
    camera, factor, before_m, after_m = shown_depth(result)
    prepared = np.isfinite(before_m)
    before = shaded(surface_normals(before_m, prepared, camera), prepared)
    normals = shown_normals(result.normals[object_window(result.mask)], factor)
    return side_by_side(before, shaded(normals, np.isfinite(after_m)))


def preview_png(result: Result) -> bytes:
    """8-bit grey PNG of `preview`."""
    return encode_png(preview(result))
