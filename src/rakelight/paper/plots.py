"""Curves, drawn with matplotlib: the one thing of the paper that needs the [paper] extra."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from io import BytesIO
from typing import Any

from rakelight.capture.images import as_rgb, decode_image
from rakelight.extras import needs
from rakelight.model import Array

Curves = Mapping[str, Sequence[tuple[float, float]]]


def curves(points: Iterable[tuple[str, float, float]]) -> Curves:
    """Name -> points (x, y), of points (name, x, y).

    >>> curves([("a", 1, 2), ("b", 1, 3), ("a", 2, 4)])
    {'a': [(1, 2), (2, 4)], 'b': [(1, 3)]}
    """
    found: dict[str, list[tuple[float, float]]] = {}
    for name, x, y in points:
        found.setdefault(name, []).append((x, y))
    return found


def require_matplotlib() -> Any:
    """matplotlib's module of figures; raises MissingExtraError where it is not installed."""
    return needs("matplotlib.figure", "paper", "figure 7")


def plotted(
    panels: Mapping[str, Curves],
    x_label: str,
    shaded: tuple[float, float] | None = None,
    shaded_label: str = "",
) -> Array:
    """(H, W, 3) uint8: a panel per y label, from zero, with a shaded range of x.

    Raises MissingExtraError without matplotlib.
    """
    figure = require_matplotlib().Figure(figsize=(5 * len(panels), 3.6), layout="constrained")
    for number, (y_label, lines) in enumerate(panels.items()):
        axes = figure.add_subplot(1, len(panels), number + 1)
        if shaded is not None:
            axes.axvspan(*shaded, color="0.92", label=shaded_label)
        for label, points in lines.items():
            axes.plot(*zip(*points, strict=True), marker="o", label=label)
        axes.set(xlabel=x_label, ylabel=y_label, ylim=(0, None))
        axes.grid(alpha=0.3)
        if number == 0:
            axes.legend(fontsize="small")
    drawn = BytesIO()
    figure.savefig(drawn, format="png", dpi=110)
    return as_rgb(decode_image(drawn.getvalue()))
