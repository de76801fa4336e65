"""The synthetic object of the paper's section 4 under its three scenarios of paint."""

from __future__ import annotations

from dataclasses import replace

from rakelight.model import Capture, Lighting, Truth
from rakelight.synthetic import (
    PAPER_NOISE,
    SceneOptions,
    make_albedo,
    make_shape,
    render_scene,
)

SCENARIOS = ("simple", "pattern", "complicated")

# 640 x 480, as the depth camera's; the depth map has the photographs' resolution, so that the
# table compares methods and not interpolations.
PAPER_OPTIONS = SceneOptions(
    camera=make_shape("head").camera.scaled(4 / 3), depth_noise=PAPER_NOISE, photographs=12
)


def paper_scene(scenario: str, lighting: Lighting, size: float = 1.0) -> tuple[Capture, Truth]:
    """The bust painted as `scenario` says, lit as `lighting` says, and its truth.

    size : scale of the camera's image, 640 x 480 at 1.  Shape, noise and paint are the same for
        every lighting, so that methods which need different lamps are compared on one object.

    >>> capture, truth = paper_scene("simple", "rgb-leds", size=0.25)
    >>> capture.photographs.shape, truth.depth.shape
    ((1, 120, 160, 3), (120, 160))
    """
    camera = PAPER_OPTIONS.camera
    assert camera is not None
    options = replace(PAPER_OPTIONS, lighting=lighting, camera=camera.scaled(size))
    return render_scene(make_shape("head"), make_albedo(scenario), options)
