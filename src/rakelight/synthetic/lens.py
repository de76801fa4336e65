"""Captures through a lens that distorts: the opposite of rakelight.prepare.undistort, for tests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rakelight.errors import InputError
from rakelight.files import in_threads
from rakelight.geometry.camera import require_ideal
from rakelight.geometry.distortion import to_pixels, to_rays
from rakelight.geometry.grid import area_mean
from rakelight.model import Array, Camera, Capture, Distortion, Floats, Mask
from rakelight.prepare.linear import srgb, to_linear
from rakelight.synthetic.noise import PERFECT, DepthNoise, add_depth_noise

# Rays through each side of a pixel of the finer capture.
_RAYS = 2


def distorted(
    capture: Capture,
    distortion: Distortion,
    shrink: int = 2,
    *,
    image_noise: float = 0.0,
    depth_noise: DepthNoise = PERFECT,
    bits: int = 16,
    seed: int = 0,
) -> Capture:
    """What a camera with that lens sees of what an ideal one saw `shrink` times as finely.

    capture : rendered without noise, 16 bit, its depth in the colour camera's frame
    shrink : pixels of `capture` along each side of one of the result, 2 or more so that hardly
        anything is lost: every pixel is the mean of rays through all it covers
    image_noise, depth_noise, bits, seed : as of `SceneOptions`, added behind the lens

    The truth is that of the ideal camera `capture.camera.scaled(1 / shrink)`, into which
    `undistorted` brings the result back.  Where the lens shows more than `capture` has nothing is
    seen, and the mask leaves out pixels that the object does not cover whole.

    Raises InputError where sizes do not fit, or the capture's camera has distortion already.

    >>> from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene
    >>> ball, lens = make_shape("sphere"), Distortion("brown-conrady", [0.1, 0.0, 0.0, 0.0])
    >>> options = SceneOptions(camera=ball.camera.scaled(0.2), photographs=3, image_noise=0.0)
    >>> seen = distorted(render_scene(ball, make_albedo("white"), options)[0], lens)
    >>> seen.photographs.shape, seen.depth_m.shape, seen.camera.distortion == lens
    ((3, 36, 48, 3), (1, 36, 48), True)
    """
    require_ideal(capture.camera, "capture.camera")
    small = capture.depth_m.shape[1:]
    factor = capture.camera.width // small[1]
    if any(side % (shrink * factor) for side in capture.camera.shape) or capture.depth_camera:
        raise InputError(
            "this capture cannot be seen through a lens",
            source="capture",
            seen=f"photographs {capture.camera.shape}, depth {small}",
            needed=f"depth in the colour camera's frame, sides divisible by {shrink * factor}",
        )
    camera = replace(capture.camera.scaled(1 / shrink), distortion=distortion)
    rays = shrink * _RAYS
    u, v = _through(camera, capture.camera, rays)
    random = np.random.default_rng([seed, 0])
    mask = area_mean(_nearest(capture.mask, u, v, False), rays) == 1
    depth_camera = camera.resized(camera.width // factor, camera.height // factor)
    own = capture.camera.resized(small[1], small[0])
    places = _through(depth_camera, own, rays)
    depth_m = np.stack(
        [area_mean(_nearest(each, *places, np.nan), rays) for each in capture.depth_m]
    )
    light = in_threads(
        lambda photograph: _light(to_linear(photograph, capture.encoding), u, v, rays),
        capture.photographs,
    )
    return replace(
        capture,
        photographs=np.stack(
            [
                _developed(each, image_noise, bits, capture.encoding == "srgb", random)
                for each in light
            ]
        ),
        depth_m=np.stack(
            [add_depth_noise(each, depth_noise, [seed, 1, i]) for i, each in enumerate(depth_m)]
        ),
        mask=mask,
        camera=camera,
    )


def _through(camera: Camera, ideal: Camera, rays: int) -> tuple[Floats, Floats]:
    """Pixels (u, v) in the ideal image that `rays` x `rays` rays of each pixel see, NaN = none."""
    u, v = np.meshgrid(
        *((np.arange(side * rays) + 0.5) / rays - 0.5 for side in (camera.width, camera.height))
    )
    return to_pixels(*to_rays(u, v, camera), ideal)


def _nearest(image: Array, u: Floats, v: Floats, outside: float) -> Floats | Mask:
    """The values (H, W) of the pixels that hold the places u, v."""
    height, width = image.shape
    inside = (u >= -0.5) & (u < width - 0.5) & (v >= -0.5) & (v < height - 0.5)
    found = np.full(u.shape, outside, image.dtype)
    found[inside] = image[np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)]
    return found


def _light(linear: Floats, u: Floats, v: Floats, rays: int) -> Floats:
    """(h, w, 3) linear light: the mean over each pixel's rays, of cubic splines."""
    from scipy.ndimage import map_coordinates

    places = np.nan_to_num(np.stack([v, u]), nan=-9.0)
    channels = [
        area_mean(map_coordinates(linear[..., c], places, order=3, mode="constant"), rays)
        for c in range(3)
    ]
    return np.stack(channels, axis=-1)


def _developed(
    light: Floats, noise: float, bits: int, encoded: bool, random: np.random.Generator
) -> Array:
    """Pixel values with noise, clipped, encoded, rounded."""
    exposed = np.clip(light + noise * random.standard_normal(light.shape), 0, 1)
    code = srgb(exposed) if encoded else exposed
    values: Array = np.rint((2**bits - 1) * code).astype(np.uint8 if bits == 8 else np.uint16)
    return values
