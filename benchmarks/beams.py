"""Lamps whose light falls off to the sides of where they are aimed, on captures drawn at random.

    python benchmarks/beams.py --seeds 3440:3470 --jobs 2 -o out/beams.json
    python benchmarks/beams.py --seeds 3440:3470 --jobs 2 --wide -o out/wide.json
    python benchmarks/random_captures.py --compare out/wide.json out/beams.json

The draws of random_captures.py, in 16 bit, under a torch: of each photograph its light is a
Gaussian of the angle to the axis, which leaves 0.5 to 0.95 of the light at the object's radius, the
same for all photographs of a capture.  The axis misses the object's middle by 0.3 radii in each
coordinate (standard deviation).  Lamps that are drawn as distant stand at eight radii.  `--wide`
leaves the beam away.  Errors as random_captures.py prints them.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from rakelight import Capture, Truth
from rakelight.geometry.camera import back_project
from rakelight.synthetic import draw
from random_captures import Record, changed_draw, run_changed_draws

# Distance of lamps that are drawn as distant, in the object's radii.
FAR_RADII = 8.0
# Standard deviation of where the axis meets the object, in each coordinate, radii.
AIM_RADII = 0.3
# Brightness that 0.5 % of the object's values exceed, white being 1.
PEAK = 0.9


def aimed(capture: Capture, truth: Truth, seed: int, wide: bool) -> Capture:
    """The capture, in 16 bit and linear, under a lamp with a beam; itself if that is wide."""
    if wide:
        return capture
    rng, lights = np.random.default_rng(seed), truth.lights
    assert lights is not None
    filled = np.where(truth.mask, truth.depth, np.nanmedian(truth.depth))
    points = back_project(filled, capture.camera)
    middle = points[truth.mask].mean(axis=0)
    radius = np.sqrt(2 * ((points[truth.mask] - middle)[:, :2] ** 2).sum(axis=1).mean())
    toward = lights.vector.mean(axis=1)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    places = middle + FAR_RADII * radius * toward
    if lights.position_m is not None:
        places = lights.position_m.mean(axis=1)
    at_radius = rng.uniform(0.5, 0.95)
    light = capture.photographs / 65535.0
    for one, place in zip(light, places, strict=True):
        width2 = (radius / np.linalg.norm(place - middle)) ** 2 / np.log(1 / at_radius)
        axis = middle + rng.normal(0, AIM_RADII * radius, 3) - place
        way = points - place
        cosine = way @ axis / (np.linalg.norm(way, axis=-1) * np.linalg.norm(axis))
        one *= np.exp(-(np.arccos(np.clip(cosine, -1, 1)) ** 2) / width2)[..., None]
    light *= PEAK / np.quantile(light[:, truth.mask], 0.995)
    values = np.round(65535 * np.clip(light, 0, 1)).astype(np.uint16)
    return replace(capture, photographs=values)


def assess(seed: int, arguments: argparse.Namespace) -> Record:
    """All about one draw."""
    drawn = draw(
        seed, 1.0, arguments.scans, arguments.pictures, bits=16, encoding="linear", gamma=1.0
    )
    return changed_draw(
        drawn, lambda capture, truth: (aimed(capture, truth, seed, arguments.wide), truth)
    )


if __name__ == "__main__":
    wide = "lamps without a beam"
    run_changed_draws(__doc__, assess, range(3440, 3470), "out/beams.json", "--wide", wide)
