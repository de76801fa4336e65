"""Levenberg-Marquardt damping, adapted to whether steps lower the energy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

# Factor of the damping after a refused step, and its inverse after an accepted one (ablation.md:
# halved 0.96, doubled 1.00).
FACTOR = 8.0
# Least damping (ablation.md: halved 0.96, doubled 0.99); the largest is its inverse, with which a
# step is next to nothing.  With a least damping of 1e-6 random draws come out alike, but a coin
# under near lights is 1.1 degrees off instead of 0.7.  With a largest one of 100 they come out
# alike, too.
LEAST = 1e-3


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
    least: float = LEAST,
) -> tuple[State, float]:
    """The proposed state if its energy is lower, else the same one, and the next step's damping.

    damping : a multiple of the diagonal of the step's matrix
    propose : the state after a step of some damping
    least : least damping of the next step; the largest is 1 / LEAST, whatever this is

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Parabola:
    ...     x: float
    ...     energy: float
    >>> def step(damping):
    ...     x = 1.0 - 4.0 / (1.0 + damping)  # four times as far as it should
    ...     return Parabola(x, x**2)
    >>> lowered(Parabola(1.0, 1.0), 8.0, step)
    (Parabola(x=0.5555555555555556, energy=0.308641975308642), 1.0)
    >>> lowered(Parabola(0.0, 0.0), 1.0, step)
    (Parabola(x=0.0, energy=0.0), 8.0)
    """
    tried = propose(damping)
    if tried.energy < state.energy:
        return tried, max(damping / FACTOR, least)
    return state, min(damping * FACTOR, 1 / LEAST)
