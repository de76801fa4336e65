"""The checks of the depth against the photographs, by the code of what they find."""

from __future__ import annotations

from collections.abc import Callable

from rakelight.check.depth_orientation import depth_orientation
from rakelight.check.depth_shift import depth_shift
from rakelight.check.inside_out import inside_out
from rakelight.model import Capture, Finding

# Each returns findings of its code, or raises CaptureError where the depth is wrong beyond doubt.
DEPTH_CHECKS: dict[str, Callable[[Capture], tuple[Finding, ...]]] = {
    "depth-shifted": depth_shift,
    "depth-turned": depth_orientation,
    "depth-inside-out": inside_out,
}
