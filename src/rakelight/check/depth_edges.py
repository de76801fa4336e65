"""Depth edges: whether the depth map is blurred across the object's outline, or into its holes."""

from __future__ import annotations

import numpy as np

from rakelight.check.measured import Measured
from rakelight.model import Finding
from rakelight.prepare.average import robust_average
from rakelight.prepare.mixed_holes import mixed_with_holes
from rakelight.prepare.sensor import SensorGrid, sensor_shape
from rakelight.prepare.soft_edges import HALF, edge_blur

# Width of a blurred step from a tenth to nine tenths of its height, standard deviations.
STEP = 2.56


def depth_edges(measured: Measured) -> tuple[Finding, ...]:
    """Warnings where the depth runs from the object to its background, or to holes, without a jump.

    Depth of a camera of its own is not looked at: the mask is not in its view.
    """
    capture = measured.capture
    if capture.depth_camera is not None:
        return ()
    grid = SensorGrid(sensor_shape(capture), capture.camera.shape)
    on_object = grid.touched(capture.mask)
    mixed = int(mixed_with_holes(robust_average(capture.depth_m), on_object).sum())
    if mixed:
        seen = f"{mixed} of {np.count_nonzero(on_object)} depth pixels of the object"
        message = (
            f"the depth runs from the object down to 0 beside its holes, in {seen}: it was resized "
            "or filtered with 0 for no measurement; those are left out"
        )
        remedy = "resize depth by the nearest neighbour (cv2.INTER_NEAREST), or NaN for holes first"
        return (Finding("warning", "depth-mixed-with-holes", message, remedy),)
    blur_px = edge_blur(capture.depth_m[0], grid.share(capture.mask) >= HALF)
    if not blur_px:
        return ()
    message = (
        f"the depth is blurred across the object's outline, over about {STEP * blur_px:.0f} depth "
        "pixels: measurements that are mixed with the background are left out"
    )
    remedy = "record and align the depth without smoothing, filled holes and interpolation"
    return (Finding("warning", "depth-blurred", message, remedy),)
