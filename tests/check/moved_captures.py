"""A scene whose photographs or depth maps lie beside each other."""

from dataclasses import replace

import cv2
import numpy as np

from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene


def still_scene(shape="sphere", albedo="pattern", size=0.4, **changes):
    """A noisy capture of a shape in 192 x 144 pixels under five lights, depth in 96 x 72."""
    solid = make_shape(shape)
    settings = {
        "photographs": 5,
        "depth_factor": 2,
        "depth_noise": DepthNoise(rms_mm=2.0, correlation_length_px=2.0, hole_fraction=0.05),
        "supersampling": 1,
    }
    options = SceneOptions(camera=solid.camera.scaled(size), **{**settings, **changes})
    return render_scene(solid, make_albedo(albedo), options)[0]


def with_photographs_moved(capture, which, right, down):
    """The capture with these photographs moved by so many pixels."""
    photographs = capture.photographs.copy()
    shift = np.array([[1.0, 0.0, right], [0.0, 1.0, down]])
    height, width = capture.camera.shape
    for i in which:
        photographs[i] = cv2.warpAffine(
            photographs[i], shift, (width, height), borderMode=cv2.BORDER_REPLICATE
        )
    return replace(capture, photographs=photographs)


def with_depth_moved(capture, right, down):
    """The capture with its depth maps moved by so many depth pixels."""
    moved = np.roll(capture.depth_m, (down, right), axis=(1, 2))
    return replace(capture, depth_m=moved)
