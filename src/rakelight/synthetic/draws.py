"""Values drawn at random from stated distributions, each field from a stream of its own."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Range:
    """Numbers from `low` to `high`, all alike likely; their logarithms with `log`.

    absent : the probability that what the number measures is not there, always so in an easy draw
    none : the number then
    """

    low: float
    high: float
    log: bool = False
    whole: bool = False
    absent: float = 0.0
    none: float = 0.0

    def draw(self, rng: np.random.Generator, easy: bool) -> float | int:
        """A number; `none` where it is absent."""
        missing = rng.random() < self.absent
        # whole numbers get as much room each
        low, high = (self.low - 0.5, self.high + 0.5) if self.whole else (self.low, self.high)
        if self.log:
            value = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        else:
            value = float(rng.uniform(low, high))
        if missing or (easy and self.absent):
            value = self.none
        return round(value) if self.whole else value

    def holds(self, value: float) -> bool:
        """Whether such a number can be drawn."""
        return bool(self.low <= value <= self.high or (self.absent > 0 and value == self.none))


@dataclass(frozen=True, slots=True)
class OneOf:
    """One of several values, by weight; `plain` in an easy draw, if that is given."""

    weights: Mapping[Any, float]
    plain: Any = None

    def draw(self, rng: np.random.Generator, easy: bool) -> Any:
        """A value."""
        share = np.array(list(self.weights.values()), float)
        value = list(self.weights)[rng.choice(len(share), p=share / share.sum())]
        return self.plain if easy and self.plain is not None else value

    def holds(self, value: Any) -> bool:
        """Whether that value can be drawn."""
        return value in self.weights or (self.plain is not None and value == self.plain)


def drawn(distribution: Range | OneOf) -> Any:
    """A dataclass field that is drawn from this distribution."""
    return field(metadata={"distribution": distribution})


def distributions(kind: type[Any]) -> dict[str, Range | OneOf]:
    """Field -> its distribution, of a dataclass's drawn fields."""
    return {
        item.name: item.metadata["distribution"]
        for item in fields(kind)
        if "distribution" in item.metadata
    }


def stream(seed: int, aspect: str) -> np.random.Generator:
    """The generator of one aspect of a draw: a child of the seed's that owes nothing to the others.

    >>> bool(stream(1, "shape").random() == stream(1, "paint").random())
    False
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(zlib.crc32(aspect.encode()),))
    return np.random.default_rng(sequence)
