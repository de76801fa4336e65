"""The synthetic object of the paper's section 4 under its three scenarios of paint."""

from __future__ import annotations

from dataclasses import replace

from rakelight.model import Camera, Capture, Lighting, Truth
from rakelight.synthetic import (
    PAPER_NOISE,
    SceneOptions,
    Shape,
    Surface,
    make_albedo,
    make_shape,
    render_scene,
)
from rakelight.synthetic.albedo import made_once

SCENARIOS = ("simple", "pattern", "complicated")

# 640 x 480, as the depth camera's; the depth map has the photographs' resolution, so that the
# table compares methods and not interpolations.
CAMERA = make_shape("head").camera.scaled(4 / 3)
PAPER_OPTIONS = SceneOptions(camera=CAMERA, depth_noise=PAPER_NOISE, photographs=12)


def paper_object() -> Shape:
    """The bust; its surface is traced once per camera, for however many scenes."""
    bust = make_shape("head")
    traced = made_once(bust.render, cameras=4)

    def render(camera: Camera, rows: slice | None = None) -> Surface:
        return traced(camera) if rows is None else traced(camera).cut(rows)

    return replace(bust, render=render)


def paper_camera(size: float = 1.0) -> Camera:
    """The camera of every scene, 640 x 480 at 1.

    >>> paper_camera(0.5).shape
    (240, 320)
    """
    return CAMERA.scaled(size)


def paper_scene(
    scenario: str, lighting: Lighting, size: float = 1.0, shape: Shape | None = None
) -> tuple[Capture, Truth]:
    """The bust painted as `scenario` says, lit as `lighting` says, and its truth.

    shape : a `paper_object` that several scenes share, which saves most of their time
    size : scale of the camera's image, 640 x 480 at 1.  Shape, noise and paint are the same for
        every lighting, so that methods which need different lights are compared on one object.

    >>> capture, truth = paper_scene("simple", "rgb-leds", size=0.25)
    >>> capture.photographs.shape, truth.depth.shape
    ((1, 120, 160, 3), (120, 160))
    """
    options = replace(PAPER_OPTIONS, lighting=lighting, camera=paper_camera(size))
    return render_scene(shape or paper_object(), make_albedo(scenario), options)
