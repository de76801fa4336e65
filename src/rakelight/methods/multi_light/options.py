"""What can be set of `multi_light`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rakelight.methods.base import require_options, require_ranges, require_types


@dataclass(frozen=True, slots=True)
class MultiLight:
    """What can be set; a good result needs none of it.

    depth_weight : weight of the sensor's depth, as a multiple of what white noise of the sensor's
        size would have; None chooses it from the data.  Raised, the surface keeps to the
        sensor's shape, its faults included; lowered, it follows the photographs and may slide
        along the bas-relief valley.
    lights : "white" for one light in all channels, "coloured" for one per channel, "auto"
    distance : "distant" for parallel light, "near" for lights at a place, "auto"
    beam : "narrow" for lamps whose light falls off to the sides of where they are aimed, "wide" for
        others, "auto"
    max_iterations : most Gauss-Newton steps of a descent at the coarsest level, and of each of the
        last two at the finest; those between take at most three
    tolerance : a level ends when a step lowers the energy by less than this fraction of the
        photographs' term
    coarse_pixels : size of the coarsest level, where lights and depth move together exactly
    """

    depth_weight: float | None = None
    lights: Literal["auto", "white", "coloured"] = "auto"
    distance: Literal["auto", "distant", "near"] = "auto"
    beam: Literal["auto", "wide", "narrow"] = "auto"
    max_iterations: int = 100
    tolerance: float = 2e-3
    coarse_pixels: int = 4000

    def __post_init__(self) -> None:
        require_types(self)
        require_ranges(self, above_0=("depth_weight",))
        require_options(
            self,
            lights=(self.lights in ("auto", "white", "coloured"), "auto, white or coloured"),
            distance=(self.distance in ("auto", "distant", "near"), "auto, distant or near"),
            beam=(self.beam in ("auto", "wide", "narrow"), "auto, wide or narrow"),
            max_iterations=(self.max_iterations >= 1, "at least 1"),
            tolerance=(0 < self.tolerance < 1, "above 0, below 1"),
            coarse_pixels=(self.coarse_pixels >= 100, "at least 100"),
        )
