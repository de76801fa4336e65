"""A capture, and what is measured of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from rakelight.model import Capture, photograph_names

T = TypeVar("T")


class Measured:
    """A capture for its checks; what several of them, or the report, measure is measured once.

    >>> import numpy as np
    >>> photographs = np.zeros((2, 6, 8, 3), np.uint8)
    >>> measured = Measured(Capture(photographs, np.ones((1, 6, 8)), np.ones((6, 8), bool), None))
    >>> def brightness(capture):
    ...     print("measures")
    ...     return float(capture.photographs.mean())
    >>> measured(brightness) == measured(brightness)
    measures
    True
    """

    def __init__(self, capture: Capture) -> None:
        self.capture = capture
        self._values: dict[Callable[[Capture], Any], Any] = {}

    def __call__(self, measure: Callable[[Capture], T]) -> T:
        """What `measure` returns of the capture; it is called the first time alone."""
        if measure not in self._values:
            self._values[measure] = measure(self.capture)
        value: T = self._values[measure]
        return value

    @property
    def names(self) -> tuple[str, ...]:
        """Of the photographs, for messages."""
        count = len(self.capture.photographs)
        return photograph_names(self.capture.names, count)
