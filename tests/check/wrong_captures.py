"""Sound captures of solid objects, and what goes wrong with captures."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

SOLIDS = ("vase", "head")
NOISE = DepthNoise(rms_mm=3.3, correlation_length_px=5.0, step_mm=1.0)


@cache
def sound(shape, photographs=8, noise=NOISE):
    """A capture and its truth: a painted solid under a ring of lights, a noisy depth sensor."""
    options = SceneOptions(
        camera=make_shape(shape).camera.scaled(0.3), photographs=photographs, depth_noise=noise
    )
    return render_scene(make_shape(shape), make_albedo("pattern"), options)


def with_photograph(capture, number, change):
    """The capture with one of its photographs changed."""
    photographs = capture.photographs.copy()
    photographs[number] = change(photographs[number])
    return replace(capture, photographs=photographs)


def with_turned_photographs(capture, turn):
    """The capture with all photographs and the mask turned, the depth as it was."""
    photographs = np.stack([turn(each) for each in capture.photographs])
    return replace(capture, photographs=photographs, mask=np.ascontiguousarray(turn(capture.mask)))


def one_lamp(capture, seed=1):
    """Six photographs under the first lamp that differ by noise alone."""
    rng = np.random.default_rng(seed)
    light = capture.photographs[0] + rng.normal(0, 655, (6, *capture.photographs.shape[1:]))
    photographs = np.clip(light, 0, 65535).astype(np.uint16)
    return replace(capture, photographs=photographs, names=capture.names[:6])


def noise_alone(capture, seed=1):
    """Photographs of nothing but noise."""
    rng = np.random.default_rng(seed)
    photographs = rng.integers(3000, 60000, capture.photographs.shape).astype(np.uint16)
    return replace(capture, photographs=photographs)


def disparity(capture):
    """Disparity for depth: the farther, the smaller."""
    middle_m = np.nanmedian(capture.depth_m)
    return replace(capture, depth_m=(middle_m**2 / capture.depth_m).astype(np.float32))


def with_background(capture, behind_m):
    """The capture with a wall, so far behind the object's median depth, wherever there was none."""
    wall = float(np.nanmedian(capture.depth_m)) + behind_m
    return replace(capture, depth_m=np.nan_to_num(capture.depth_m, nan=wall).astype(np.float32))


def flat_depth(capture):
    """A depth that somebody invented: the same everywhere."""
    flat = np.where(np.isfinite(capture.depth_m), np.nanmedian(capture.depth_m), np.nan)
    return replace(capture, depth_m=flat.astype(np.float32))


ODD = {
    "blurred": lambda photograph: cv2.GaussianBlur(photograph, (0, 0), 5),
    "turned": lambda photograph: photograph[::-1, ::-1],
    "inverted": lambda photograph: 65535 - photograph,
    "moved": lambda photograph: np.roll(photograph, 40, axis=1),
}
