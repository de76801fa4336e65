"""A tiny scene, and what is on the disk."""

import os

from rakelight.synthetic import DepthNoise, SceneOptions, make_albedo, make_shape, render_scene

QUICK = ("--method", "multi-light-alternating")
"""For `refine` where it does not matter what is refined: 0.07 s, the joint method takes 1.0."""


def small_scene(**changes):
    """A sphere in 48 x 36 pixels under five lights, depth in 24 x 18; and its truth."""
    sphere = make_shape("sphere")
    settings = {
        "camera": sphere.camera.scaled(0.1),
        "photographs": 5,
        "depth_factor": 2,
        "depth_noise": DepthNoise(rms_mm=2.0, correlation_length_px=2.0),
    }
    return render_scene(sphere, make_albedo("pattern"), SceneOptions(**{**settings, **changes}))


def contents(folder):
    """Everything below a folder, hidden files and links too: relative path -> what is there."""
    return {os.fspath(path.relative_to(folder)): _content(path) for path in folder.rglob("*")}


def _content(path):
    if path.is_symlink():
        return os.fspath(path.readlink())
    return None if path.is_dir() else path.read_bytes()
