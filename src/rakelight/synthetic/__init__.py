"""Captures with known truth to test against: shapes, paints, lights and sensors."""

from rakelight.synthetic.albedo import ALBEDOS, Albedo, make_albedo, texture_from_file
from rakelight.synthetic.depth_file import shape_from_depth, shape_from_file
from rakelight.synthetic.implicit import Surface
from rakelight.synthetic.lens import distorted
from rakelight.synthetic.noise import (
    PAPER_NOISE,
    DepthNoise,
    add_depth_noise,
    calibrate_noise,
)
from rakelight.synthetic.options import SceneOptions
from rakelight.synthetic.random_capture import Draw, draw, random_capture, render_draw
from rakelight.synthetic.reliefs import RELIEFS, make_relief
from rakelight.synthetic.scene import DEMO_OPTIONS, demo_scene, render_scene, write_scene
from rakelight.synthetic.shapes import SHAPES, Shape, make_shape

__all__ = [
    "ALBEDOS",
    "DEMO_OPTIONS",
    "PAPER_NOISE",
    "RELIEFS",
    "SHAPES",
    "Albedo",
    "DepthNoise",
    "Draw",
    "SceneOptions",
    "Shape",
    "Surface",
    "add_depth_noise",
    "calibrate_noise",
    "demo_scene",
    "distorted",
    "draw",
    "make_albedo",
    "make_relief",
    "make_shape",
    "random_capture",
    "render_draw",
    "render_scene",
    "shape_from_depth",
    "shape_from_file",
    "texture_from_file",
    "write_scene",
]
