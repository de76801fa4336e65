"""Scenes and results that several tables and figures show, each made once."""

from __future__ import annotations

from rakelight.model import Capture, Lighting, Progress, ProgressCallback, Result, Truth, silent
from rakelight.paper.rows import ROWS, Row
from rakelight.paper.scenes import paper_object, paper_scene
from rakelight.pipeline import refine
from rakelight.synthetic import Shape

MAIN = "pattern"
"""The scenario of the figures that show one."""


class Runs:
    """The paper's scenes at one size, and what the methods make of them.

    size : scale of the photographs, 640 x 480 at 1
    capture : somebody's own, for the figures that show one

    >>> runs = Runs(size=0.25)
    >>> runs.scene("simple", "ambient") is runs.scene("simple", "ambient")
    True
    """

    def __init__(
        self,
        size: float = 1.0,
        capture: Capture | None = None,
        progress: ProgressCallback = silent,
    ) -> None:
        self.size, self.capture, self.progress = size, capture, progress
        self.bust: Shape = paper_object()
        self._scenes: dict[tuple[str, Lighting], tuple[Capture, Truth]] = {}
        self._results: dict[tuple[str, str], Result] = {}
        self._refined: Result | None = None

    def scene(self, scenario: str, lighting: Lighting) -> tuple[Capture, Truth]:
        """The bust of `scenes.paper_scene`."""
        key = scenario, lighting
        if key not in self._scenes:
            self._scenes[key] = paper_scene(scenario, lighting, self.size, self.bust)
        return self._scenes[key]

    def result(self, row: Row, scenario: str) -> Result:
        """What the method of `row` makes of its scene."""
        key = row.label, scenario
        if key not in self._results:
            self.progress(Progress(f"{scenario}: {row.label}"))
            self._results[key] = row.run(self.scene(scenario, row.lighting)[0], silent)
        return self._results[key]

    def joint(self, scenario: str = MAIN) -> Result:
        """What our joint method makes of a scenario."""
        return self.result(row_of("multi-light"), scenario)

    def refined(self) -> tuple[Capture, Result] | None:
        """Somebody's own capture and what our joint method makes of it, when there is one."""
        if self.capture is None:
            return None
        if self._refined is None:
            self.progress(Progress("the capture"))
            self._refined = refine(self.capture, "multi-light")
        return self.capture, self._refined


def row_of(method: str) -> Row:
    """The last of table 1's rows with that method: the one with its default options.

    >>> row_of("rgbd-fusion").label
    'RGB-Fusion'
    """
    return next(row for row in reversed(ROWS) if row.method == method)
