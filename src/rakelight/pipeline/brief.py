"""multi-light at low resolution and ended early: for a quick look at a capture."""

from __future__ import annotations

from rakelight.check.depth_quality import some_maps
from rakelight.methods.multi_light import MultiLight
from rakelight.model import Capture
from rakelight.prepare.reduced import reduced

# Most pixels of the object, about.  The mitten's expected depth error is 0.49 mm at 9,100 pixels,
# 0.32 at 37,000, 0.38 at all 149,000; uw-owl takes 1.9 s at 2,800 pixels and 2.6 s at 11,600.
MOST_PIXELS = 12_000
# multi-light, ended early: of the mitten it takes 0.8 s instead of 1.9 at the same pixels, and its
# expected errors, 0.48 mm and 12.6 degrees, are then 30 and 8 % larger.
BRIEF = MultiLight(coarse_pixels=1000, tolerance=0.05, max_iterations=4)


def at_low_resolution(capture: Capture) -> Capture:
    """The capture with few pixels of its object, and some of its depth maps."""
    return reduced(some_maps(capture), MOST_PIXELS)
