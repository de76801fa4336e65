"""Depth shift: whether the depth map is registered to the photographs.

By the object's outlines; where the mask lies on the depth, by what photographs tell of its slopes.
"""

from __future__ import annotations

from rakelight.check.camera_motion import in_words
from rakelight.check.depth_match import matched
from rakelight.check.depth_orientation import turned
from rakelight.check.measured import Measured
from rakelight.check.outline import outline_shift
from rakelight.errors import CaptureError
from rakelight.model import Finding

# Shift over the object's width, shift in pixels, and fraction explained, beyond which the depth is
# that of another place.
FARTHEST, FARTHEST_PX, SURELY_EXPLAINED = 0.1, 5.0, 0.8

REMEDY = "give the depth camera's own [depth_intrinsics] and [depth_to_color]"


def depth_shift(measured: Measured) -> tuple[Finding, ...]:
    """A warning where the depth map is shifted against the photographs, with the pixels.

    Raises CaptureError where that is beyond doubt and more than a tenth of the object's width.
    """
    capture = measured.capture
    found, factor, width_px = measured(outline_shift)
    if measured(turned) is not None:
        return ()
    what = "the depth map is not registered to the photographs"
    can_register = len(capture.photographs) > 1 and not capture.register
    remedy = f"register = true in capture.toml, or {REMEDY}" if can_register else REMEDY
    if found is None or not found.plain:
        match = measured(matched)
        if match is None or match.shift is None:
            return ()
        beside = match.shift
        shift = (
            f"its slopes, explained by them to {beside.as_it_is:.0%} as it is and to "
            f"{beside.there:.0%} there, are shifted by about {in_words(beside.shift, 0)}"
        )
        return (Finding("warning", "depth-shifted", f"{what}: {shift}", remedy),)
    shift = f"shifted by about {in_words(factor * found.shift, 0)}"
    limit_px = max(FARTHEST_PX, FARTHEST * width_px)
    if found.length > limit_px and found.explained > SURELY_EXPLAINED:
        limit = f"less than {int(factor * limit_px)} pixels"
        raise CaptureError(what, source=capture.source, seen=shift, needed=limit, remedy=remedy)
    return (Finding("warning", "depth-shifted", f"{what}: {shift}", remedy),)
