"""Objects without fine paint before a tiled wall, as at somebody's desk."""

from dataclasses import replace

import numpy as np

from rakelight import Camera, Capture
from rakelight.prepare.linear import srgb

SIZE = 170, 220
CAMERA = Camera(SIZE[1], SIZE[0], 400.0, 400.0, 109.5, 84.5)
PIXEL_M = 0.6 / CAMERA.fx


def cloth(x, y):
    """A relief that repeats, and where it is; metres."""
    waves = 0.006 * np.sin(2 * np.pi * (x + 0.4 * y) / 0.055)
    waves += 0.003 * np.sin(2 * np.pi * (y - 0.3 * x) / 0.033 + 1)
    threads = 0.0008 * np.sin(2 * np.pi * (0.8 * x + y) / 0.009)
    return waves + threads, (abs(x) < 0.1) & (abs(y) < 0.075)


def ball(x, y):
    """A sphere with a dent in it."""
    inside = 0.095**2 - x**2 - y**2
    dent = 0.008 * np.exp(-((x - 0.03) ** 2 + (y + 0.025) ** 2) / 0.0003)
    return np.sqrt(np.maximum(inside, 0)) - dent, inside > 0


def mask_shape(x, y):
    """Half an egg, narrow below, with a nose and one cheek: alike in a mirror but for that."""
    inside = 1 - (x / 0.075) ** 2 - (y / 0.098) ** 2
    nose = 0.022 * np.exp(-((x / 0.010) ** 2 + ((y - 0.005) / 0.022) ** 2) / 2)
    cheek = 0.004 * np.exp(-(((x - 0.04) / 0.01) ** 2 + ((y - 0.03) / 0.01) ** 2) / 2)
    return 0.06 * np.sqrt(np.maximum(inside, 0)) + nose + cheek, inside > 0


def tiled_scene(relief, off_px=0.0, exposure=1.0, count=12):
    """A capture under a ring of lamps, 8 bits; the object is `off_px` left of the image's middle.

    exposure : brightness; at 1 nothing is saturated
    """
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    x = (columns - CAMERA.cx + off_px) * PIXEL_M
    y = (rows - CAMERA.cy) * PIXEL_M
    height, mask = relief(x, y)
    down, right = np.gradient(np.where(mask, height, 0.0), PIXEL_M)
    normals = np.stack([right, down, -np.ones(SIZE)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[~mask] = (0, 0, -1)
    tiles = 0.15 + 0.25 * ((x // 0.02 + y // 0.02) % 2)
    stripes = 0.55 + 0.2 * np.tanh(6 * np.sin(2 * np.pi * (x - 0.3 * y) / 0.09))
    paint = np.where(mask, stripes, tiles)
    azimuth = 2 * np.pi * 0.381966 * np.arange(count)
    tilt = np.radians(rng.uniform(25, 50, count))
    lamps = np.stack(
        [np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), -np.cos(tilt)], axis=-1
    )
    light = np.maximum(np.einsum("hwc,nc->nhw", normals, lamps), 0) + 0.02
    light = exposure * paint * light + rng.normal(0, 0.002, (count, *SIZE))
    photographs = np.rint(255 * srgb(np.clip(light, 0, 1))).astype(np.uint8)
    depth_m = np.where(mask, 0.6 - height, 0.8) + rng.normal(0, 0.0005, SIZE)
    return Capture(
        photographs=photographs[..., None].repeat(3, axis=-1),
        depth_m=depth_m[None, ::2, ::2].astype(np.float32),
        mask=mask,
        camera=CAMERA,
        encoding="srgb",
    )


def with_depth_turned(capture, turn):
    """The capture with its depth maps turned."""
    return replace(capture, depth_m=np.ascontiguousarray(turn(capture.depth_m[0]))[None])
