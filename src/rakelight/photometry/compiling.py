"""Compile the two largest kernels: `python -m rakelight.photometry.compiling linearize`.

Each takes a quarter of all compiling, and numba compiles one at a time: the command line has them
compiled by processes of their own (cli/first_run.py).  They are called once on a few pixels; the
types of the arguments are those of every other call.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from rakelight.model import Camera
from rakelight.photometry.images import LightParameters, Photographs, Surface


def linearize() -> None:
    """Call the kernel of `Photographs.linearize`."""
    photographs, surface, lights = _few_pixels()
    photographs.linearize(surface, lights)


def light_terms() -> None:
    """Call the kernel of `Photographs.light_terms`."""
    photographs, surface, lights = _few_pixels()
    photographs.light_terms(surface, lights, np.ones(surface.points.shape), mixed=True)


CALLS: dict[str, Callable[[], None]] = {"linearize": linearize, "light_terms": light_terms}


def _few_pixels() -> tuple[Photographs, Surface, LightParameters]:
    """Three photographs of 4 x 4 pixels of a plane."""
    camera = Camera(4, 4, 10.0, 10.0, 1.5, 1.5)
    table = (np.arange(65536) / 65535).astype(np.float32)
    values = np.full((3, 4, 4, 3), 30000, np.uint16)
    photographs = Photographs(values, table, 1, 65534, np.ones((4, 4), bool), camera)
    surface = Surface(np.zeros((4, 4, 2)), np.zeros((4, 4, 3)))
    towards = np.array([[0.3, 0.0, -1.0], [0.0, 0.3, -1.0], [-0.3, 0.0, -1.0]])
    return photographs, surface, LightParameters.distant(towards[:, None], np.zeros((3, 1)))


if __name__ == "__main__":
    CALLS[sys.argv[1]]()
