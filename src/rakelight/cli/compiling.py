"""Compile a part of the kernels: `python -m rakelight.cli.compiling linearize`.

Numba compiles one kernel at a time: the command line has these parts compiled by processes of their
own (first_run.py).  Each kernel is called once on a few pixels; the types of the arguments are
those of every other call.  Without a name, the module prints the parts that are not compiled yet.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from threading import Thread

import numpy as np

from rakelight import jit
from rakelight.model import Camera
from rakelight.photometry.images import LightParameters, Photographs, Surface
from rakelight.solve import assemble, solve
from rakelight.solve.gauss_newton import bordered_step


def linearize(gloss: float = 0.0) -> None:
    """Call a kernel of `Photographs.linearize`."""
    photographs, surface, lights = _few_pixels(gloss)
    photographs.linearize(surface, lights)


def light_terms(gloss: float = 0.0) -> None:
    """Call a kernel of `Photographs.light_terms`."""
    photographs, surface, lights = _few_pixels(gloss)
    photographs.light_terms(surface, lights, np.ones(surface.points.shape), mixed=True)


def solver() -> None:
    """Call every kernel of solve/: on enough pixels for two levels of the multigrid."""
    from scipy.sparse import eye_array

    level = np.zeros((40, 40))
    tensor = np.broadcast_to([1.0, 0.0, 1.0], (*level.shape, 3))
    slope = np.broadcast_to([1.0, 0.0], (*level.shape, 2))
    weight = level.copy()
    weight[0] = 1.0
    solve(assemble(level == 0, tensor, slope, weight, level, laplacian_weight=1.0))
    bordered_step(eye_array(9), np.zeros(9), np.zeros((9, 1)), np.eye(1), np.zeros(1), 0.0)


# The parts: large kernels, by their names, and those of the solver.  Each takes about as long.
CALLS: dict[str, Callable[[], None]] = {
    "linearize": linearize,
    "light_terms": light_terms,
    "solver": solver,
    "linearize_glossy": partial(linearize, 0.1),
    "light_terms_glossy": partial(light_terms, 0.1),
}
# The parts that most captures do not need.
SELDOM = ("linearize_glossy", "light_terms_glossy")


def part_of(kernel: jit.Kernel) -> str:
    """The part that compiles a kernel, or "" where none does.

    >>> from rakelight.photometry import _kernels
    >>> part_of(_kernels.light_terms), part_of(_kernels.halve)
    ('light_terms', '')
    """
    if kernel.__module__ == "rakelight.solve._kernels":
        return "solver"
    named = kernel.__module__ == "rakelight.photometry._kernels" and kernel.__name__ in CALLS
    return kernel.__name__ if named else ""


def load_kernels() -> None:
    """Import the kernels of photographs and the solver, which `jit` knows of from then on."""
    from rakelight.photometry import _kernels as _photographs  # noqa: F401
    from rakelight.solve import _kernels as _solver  # noqa: F401


def not_compiled() -> tuple[str, ...]:
    """Names of the parts of which a kernel was never compiled, and will be cached on disk."""
    load_kernels()
    missing = {part_of(kernel) for kernel in jit.to_be_cached()}
    return tuple(name for name in CALLS if name in missing)


def _few_pixels(gloss: float) -> tuple[Photographs, Surface, LightParameters]:
    """Three photographs of 4 x 4 pixels of a plane."""
    camera = Camera(4, 4, 10.0, 10.0, 1.5, 1.5)
    table = (np.arange(65536) / 65535).astype(np.float32)
    values = np.full((3, 4, 4, 3), 30000, np.uint16)
    photographs = Photographs(values, table, 1, 65534, np.ones((4, 4), bool), camera)
    surface = Surface(np.zeros((4, 4, 2)), np.zeros((4, 4, 3)))
    towards = np.array([[0.3, 0.0, -1.0], [0.0, 0.3, -1.0], [-0.3, 0.0, -1.0]])
    lights = LightParameters.distant(towards[:, None], np.zeros((3, 1)))
    return photographs, surface, replace(lights, gloss=np.full(lights.gloss.shape, gloss))


def end_with_input() -> None:
    """End this process when its standard input ends: whoever began it is gone."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(0)


if __name__ == "__main__":
    if sys.argv[2:] == ["--beside"]:
        Thread(target=end_with_input, daemon=True).start()
    if sys.argv[1:]:
        CALLS[sys.argv[1]]()
    else:
        sys.stdout.writelines(f"{name}\n" for name in not_compiled())
