"""Levenberg-Marquardt damping, adapted to whether steps lower the energy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

# Factor of the damping after a refused step, and its inverse after an accepted one (ablation.md:
# halved 1.11, doubled 1.00).
FACTOR = 8.0
# Largest damping of the next step: with more a step is next to nothing (no draw of ablation.md
# changes by 5 %).
LARGEST = 1e2


class Evaluated(Protocol):
    """A state of the unknowns, with its energy."""

    @property
    def energy(self) -> float:
        """The energy that steps lower."""


State = TypeVar("State", bound=Evaluated)


def lowered(
    state: State,
    damping: float,
    propose: Callable[[float], State],
    tries: int,
    least: float = 1e-6,
) -> tuple[State, float]:
    """The first proposed state of lower energy, else the same one, and the next step's damping.

    damping : a multiple of the diagonal of the step's matrix
    propose : the state after a step of some damping; it is called at most `tries` times
    least : damping; smaller ones make no difference, and a try costs as much with them

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Parabola:
    ...     x: float
    ...     energy: float
    >>> def step(damping):
    ...     x = 1.0 - 4.0 / (1.0 + damping)  # four times as far as it should
    ...     return Parabola(x, x**2)
    >>> lowered(Parabola(1.0, 1.0), 1.0, step, tries=3)
    (Parabola(x=0.5555555555555556, energy=0.308641975308642), 1.0)
    >>> lowered(Parabola(0.0, 0.0), 1.0, step, tries=2)
    (Parabola(x=0.0, energy=0.0), 64.0)
    """
    for _ in range(tries):
        tried = propose(damping)
        if tried.energy < state.energy:
            return tried, max(damping / FACTOR, least)
        damping *= FACTOR
    return state, min(damping, LARGEST)
