"""A surface as bare clay, which shows its shape alone."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.normals import normals_from_depth
from rakelight.model import Array, Camera, Floats, Mask
from rakelight.pictures.montage import BACKGROUND
from rakelight.prepare.linear import srgb

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


def clay(depth_m: Floats, mask: Mask, camera: Camera) -> Array:
    """(H, W) a depth map as bare clay, dark where there is none."""
    valid = mask & np.isfinite(depth_m)
    return shaded(normals_from_depth(depth_m, valid, camera), valid)
