"""Figure 2: one picture, three explanations: paint, shape, light.

Equation (2) at a pixel, I = rho l.n, has three unknowns and one value.  Three scenes share it out
differently: painted paper under an even lamp, a white relief under a lamp from the side, white
paper under a slide projector.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.model import Array, Floats
from rakelight.paper.runs import Runs
from rakelight.paper.sheet import Sheet
from rakelight.pictures.clay import shaded
from rakelight.pictures.colors import photograph_picture
from rakelight.pictures.montage import in_column, in_row, panel
from rakelight.pictures.shown import object_window
from rakelight.synthetic import make_shape

LAMP = (-0.5, -0.4, -0.77)
CLAY_LAMP = (0.6, -0.6, -0.6)


@dataclass(frozen=True, slots=True)
class Explanation:
    """A scene: what varies over it, and how its picture differs from the first scene's.

    albedo_range, tilt_range_deg, light_range : largest minus smallest albedo, angle between normal
        and optical axis, strength of the light
    largest_difference : between its 16-bit pixel values and the first scene's
    """

    explanation: str
    albedo_range: float
    tilt_range_deg: float
    light_range: float
    pixels: int
    largest_difference: int


@dataclass(frozen=True)
class Scene:
    """Albedo (P,), normals (P, 3) and light (P, 3) at each pixel of a picture."""

    name: str
    lamp: str
    albedo: Floats
    normals: Floats
    light: Floats

    def photograph(self) -> Array:
        """(P,) 16-bit values by equation (2)."""
        shading = np.maximum(np.sum(self.normals * self.light, axis=-1), 0)
        return np.asarray(np.rint(self.albedo * shading * 65535), np.uint16)


def explanations(normals: Floats) -> tuple[Scene, Scene, Scene]:
    """Paint, shape and light that give one picture: that of a white relief (P, 3) under `LAMP`.

    >>> tilted = np.array([[0.0, 0.0, -1.0], [-0.6, 0.0, -0.8]])
    >>> paint, shape, light = (scene.photograph().tolist() for scene in explanations(tilted))
    >>> paint == shape == light
    True
    """
    lamp = np.asarray(LAMP) / np.linalg.norm(LAMP)
    ones, facing = np.ones(len(normals)), np.tile([0.0, 0.0, -1.0], (len(normals), 1))
    brightness = np.maximum(normals @ lamp, 0)
    return (
        Scene("paint", "from the front", brightness, facing, facing),
        Scene("shape", "from the upper left", ones, normals, np.tile(lamp, (len(normals), 1))),
        Scene("light", "a slide projector", ones, facing, brightness[:, None] * facing),
    )


def figure2(runs: Runs) -> Sheet:
    """The medal's picture as paint on paper, as a relief, and as light on paper.

    >>> {row.largest_difference for row in figure2(Runs(size=0.25)).rows}
    {0}
    """
    coin = make_shape("coin")
    surface = coin.render(coin.camera.scaled(runs.size))
    mask = surface.mask
    scenes = explanations(surface.normals[mask])
    first = scenes[0].photograph().astype(int)
    rows = [_row(scene, first) for scene in scenes]
    window = object_window(mask)

    def picture(values: Floats) -> Array:
        image = np.zeros((*mask.shape, 3))
        image[mask] = values[:, None]
        return photograph_picture(image)[window]

    strips = []
    for scene in scenes:
        normals = np.full((*mask.shape, 3), np.nan)
        normals[mask] = scene.normals
        strips.append(
            in_row(
                panel(picture(scene.photograph() / 65535), f"explained by {scene.name}: picture"),
                panel(picture(scene.albedo), "its paint"),
                panel(shaded(normals, mask, CLAY_LAMP)[window], "its shape"),
                panel(picture(np.linalg.norm(scene.light, axis=-1)), f"its light: {scene.lamp}"),
            )
        )
    title = "Figure 2: one picture explained by paint, by shape, by light"
    return Sheet("figure2", title, rows, {"": in_column(*strips)})


def _row(scene: Scene, first: Array) -> Explanation:
    strength = np.linalg.norm(scene.light, axis=-1)
    tilt = np.degrees(np.arccos(np.clip(-scene.normals[:, 2], -1, 1)))
    return Explanation(
        scene.name,
        float(np.ptp(scene.albedo)),
        float(np.ptp(tilt)),
        float(np.ptp(strength)),
        len(first),
        int(np.abs(scene.photograph() - first).max()),
    )
