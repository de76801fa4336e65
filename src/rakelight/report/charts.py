"""The report's drawings: where every chart's marks lie.  The template draws them as SVG."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import acos, atan2, degrees, hypot, isfinite, log10
from typing import Any

import numpy as np

from rakelight.model import Lights

# Radius of the hemisphere's drawing.
RADIUS = 100.0
# Of the energy's curve: the drawing, and its margins.
WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 440.0, 180.0, 64.0, 12.0, 10.0, 28.0


@dataclass(frozen=True, slots=True)
class DrawnLight:
    """A photograph's light, drawn on the hemisphere over the object as the camera sees it.

    x, y : on the drawing, whose rim has the radius 100; right and down
    size : radius of the dot
    azimuth, elevation : degrees, clockwise from the top and over the picture plane
    tilt : degrees from the camera's axis
    strength : intensity over the strongest lamp's
    """

    photograph: int
    name: str
    channel: str
    x: float
    y: float
    size: float
    azimuth: float
    elevation: float
    tilt: float
    strength: float
    ambient: float
    distance_m: float | None


def drawn_lights(lights: Lights, names: tuple[str, ...]) -> list[DrawnLight]:
    """Every lamp that shines, one per channel where they are coloured.

    >>> lights = Lights(np.array([[[0.6, 0.0, -0.8]]]), np.zeros((1, 1)))
    >>> lamp = drawn_lights(lights, ("000.png",))[0]
    >>> round(lamp.x), round(lamp.y), round(lamp.azimuth), round(lamp.tilt)
    (60, 0, 90, 37)
    """
    channels = ("white",) if lights.vector.shape[1] == 1 else ("red", "green", "blue")
    strongest = max(float(np.nanmax(lights.intensity, initial=0.0)), np.finfo(float).tiny)
    drawn = []
    for i in range(len(lights)):
        for c, channel in enumerate(channels):
            x, y, z = (float(number) for number in lights.direction[i, c])
            strength = float(lights.intensity[i, c]) / strongest
            if not isfinite(x + y + z) or strength <= 0:
                continue
            distance = None
            if lights.distance_m is not None and np.isfinite(lights.distance_m[i, c]):
                distance = float(lights.distance_m[i, c])
            drawn.append(
                DrawnLight(
                    photograph=i,
                    name=names[i] if i < len(names) else f"photograph {i}",
                    channel=channel,
                    x=RADIUS * x,
                    y=RADIUS * y,
                    size=2.5 + 4 * strength,
                    azimuth=degrees(atan2(x, -y)) % 360,
                    elevation=90 - degrees(acos(min(1.0, max(-1.0, -z)))),
                    tilt=degrees(acos(min(1.0, max(-1.0, -z)))),
                    strength=strength,
                    ambient=float(lights.ambient[i, c]),
                    distance_m=distance,
                )
            )
    return drawn


def tilts(drawn: list[DrawnLight]) -> tuple[float, float, float]:
    """Least, middle and largest tilt of the lights, degrees."""
    found = [lamp.tilt for lamp in drawn]
    return min(found), float(np.median(found)), max(found)


@dataclass(frozen=True, slots=True)
class Curve:
    """The energy of every iteration: a path, its dots, and labelled lines across.

    dots : (x, y, iteration, energy); lines : (y, label); logarithmic : the scale upwards
    """

    path: str
    dots: tuple[tuple[float, float, int, float], ...]
    lines: tuple[tuple[float, str], ...]
    logarithmic: bool


def energy_curve(energy: tuple[float, ...]) -> Curve | None:
    """The energy over the iterations; None where there are not two finite values.

    >>> curve = energy_curve((8.0, 4.0, 3.0))
    >>> curve.dots[0][1] < curve.dots[2][1], [label for _, label in curve.lines]
    (True, ['3', '4', '5', '6', '7', '8'])
    """
    points = [(i, value) for i, value in enumerate(energy) if isfinite(value)]
    if len(points) < 2:
        return None
    low, high = min(v for _, v in points), max(v for _, v in points)
    logarithmic = low > 0 and high > 20 * low

    def height(value: float) -> float:
        return log10(value) if logarithmic else value

    bottom, top = height(low), height(high)
    span = (top - bottom) or max(abs(top), 1e-12)
    last = max(points[-1][0], 1)

    def place(i: int, value: float) -> tuple[float, float]:
        x = LEFT + (WIDTH - LEFT - RIGHT) * i / last
        share = (height(value) - bottom) / span
        return round(x, 1), round(HEIGHT - BOTTOM - 8 - share * (HEIGHT - BOTTOM - TOP - 8), 1)

    dots = tuple((*place(i, value), i, value) for i, value in points)
    ticks = _powers(low, high) if logarithmic else _ticks(low, high)
    label = "{:.4g}".format if logarithmic or len(ticks) < 2 else _labels(ticks)
    return Curve(
        path="M" + "L".join(f"{x} {y}" for x, y, *_ in dots),
        dots=dots,
        lines=tuple((place(0, value)[1], label(value)) for value in ticks),
        logarithmic=logarithmic,
    )


def _ticks(low: float, high: float) -> list[float]:
    """Round values between, two to six of them."""
    # Of the steps one is at most 2.5 times as large.
    rough = max((high - low) / 5, 1e-12 * max(abs(high), 1e-300))
    power = 10.0 ** np.floor(log10(rough))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= rough)
    first = int(np.ceil(low / step))
    return [float(k * step) for k in range(first, int(np.floor(high / step)) + 1)]


def _labels(ticks: list[float]) -> Callable[[float], str]:
    """How to write ticks: with as many digits as tell them apart."""
    step, largest = ticks[1] - ticks[0], max(map(abs, ticks))
    if not 1e-3 <= largest < 1e6:
        return f"{{:.{int(log10(largest / step)) + 1}e}}".format
    return f"{{:.{max(0, -int(np.floor(log10(step) + 1e-9)))}f}}".format


def _powers(low: float, high: float) -> list[float]:
    """Powers of ten between; where there are few of them, twice and five times these as well."""
    powers = [10.0**k for k in range(int(np.floor(log10(low))), int(np.floor(log10(high))) + 1)]
    ticks = [each for each in powers if each >= low]
    if len(ticks) > 2:
        return ticks
    return [k * each for each in powers for k in (1, 2, 5) if low <= k * each <= high]


def error_bars(errors: tuple[float, ...], names: tuple[str, ...]) -> list[dict[str, Any]]:
    """Every photograph's prediction error in per cent, and its bar's length beside the largest's.

    >>> error_bars((0.02, 0.04), ("a", "b"))[0]
    {'name': 'a', 'percent': 2.0, 'length': 50.0}
    """
    finite = [error for error in errors if isfinite(error)]
    largest = max(finite, default=0.0) or 1.0
    return [
        {
            "name": names[i] if i < len(names) else f"photograph {i}",
            "percent": 100 * error if isfinite(error) else None,
            "length": round(100 * error / largest, 1) if isfinite(error) else 0.0,
        }
        for i, error in enumerate(errors)
    ]


def viewer_lights(drawn: list[DrawnLight]) -> dict[str, dict[str, float]]:
    """Photograph -> direction of its lamp, for the viewer; the middle of coloured ones.

    Those with a lamp behind the object are left out: the viewer's lamp is in front.
    """
    facts: dict[str, dict[str, float]] = {}
    for i in dict.fromkeys(lamp.photograph for lamp in drawn):
        these = [lamp for lamp in drawn if lamp.photograph == i]
        if max(lamp.tilt for lamp in these) > 90:
            continue
        x, y = (sum(getattr(lamp, axis) for lamp in these) / len(these) for axis in ("x", "y"))
        facts[str(i)] = {
            "azimuth": degrees(atan2(x, -y)) % 360,
            "elevation": degrees(acos(min(1.0, hypot(x, y) / RADIUS))),
        }
    return facts
