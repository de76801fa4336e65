"""Depth edges: whether the depth map is blurred across the object's outline."""

from __future__ import annotations

from rakelight.check.measured import Measured
from rakelight.model import Finding
from rakelight.prepare.sensor import SensorGrid, sensor_shape
from rakelight.prepare.soft_edges import HALF, edge_blur

# Width of a blurred step from a tenth to nine tenths of its height, standard deviations.
STEP = 2.56


def depth_edges(measured: Measured) -> tuple[Finding, ...]:
    """A warning where the depth runs from the object to its background without a jump.

    Depth of a camera of its own is not looked at: the mask is not in its view.
    """
    capture = measured.capture
    if capture.depth_camera is not None:
        return ()
    grid = SensorGrid(sensor_shape(capture), capture.camera.shape)
    blur_px = edge_blur(capture.depth_m[0], grid.share(capture.mask) >= HALF)
    if not blur_px:
        return ()
    message = (
        f"the depth is blurred across the object's outline, over about {STEP * blur_px:.0f} depth "
        "pixels: measurements that are mixed with the background are left out"
    )
    remedy = "record and align the depth without smoothing, filled holes and interpolation"
    return (Finding("warning", "depth-blurred", message, remedy),)
