"""Paint or relief: what the colours of one photograph say about its shading.

Paint changes the colour; shading makes it darker or brighter.  But a fold is more colourful than
its ridge, for light goes to and fro in it, and cameras add their own.  So colour that changes is
paint, unless it is the shading of fine relief, such as yarn:

- it varies from pixel to pixel, and from afar there is nothing of it; edges and stains are seen
  from afar too;
- all its colours lie on one line, from the dark to the bright of one paint;
- it has no strokes as sharp as drawn ones;
- it is the rule on the object, not the exception.

Where an object has several paints, each is looked at by itself: their borders are no relief, but
the yarn beside them is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rakelight.geometry.blur import blurred
from rakelight.geometry.grid import Links, differences, neighbours
from rakelight.model import Floats, Mask

# Where the photograph is seen: near, its noise averaged, and from afar.  Paint's colour is alike
# within the third, a texture within the last.
NEAR_PX, AFAR_PX, ALIKE_PX, TEXTURE_PX = 1.0, 4.0, 3.0, 6.0
# Darker colours, relative to the object's typical one, are noise.
DARKEST = 0.03
# Evidence against fine relief has the weight 1 at: what is left from afar of the change per pixel;
# the part of the colour that is off the line; the change of log brightness per pixel.
LASTING, OFF_LINE, SHARP = 0.2, 0.13, 0.22
# So much of the object looking like fine relief makes it even odds; and the highest odds.
RULE, SUREST = 0.28, 10.0


def fine_relief(colour: Floats, links: Links, areas: Sequence[Mask] = ()) -> Floats:
    """How surely the changes of a photograph (h, w, 3) are fine relief in one paint, (h, w) 0..1.

    colour : linear light, the object's typical one about 1, clipped values as they are
    areas : (h, w) each, of one paint, looked at by themselves; the whole unless given

    >>> rng, mask = np.random.default_rng(0), np.ones((40, 40), bool)
    >>> yarn = 1 + 0.4 * np.sin(np.arange(40))[:, None, None] * [1.0, 0.8, 0.9]
    >>> stain = 1 + 0.4 * (np.arange(40) > 20)[:, None, None] * [1.0, 0.8, 0.9]
    >>> for photograph in (yarn, stain):
    ...     print(fine_relief(photograph.repeat(40, axis=1), Links.of(mask)).mean().round(1))
    1.0
    0.0
    """
    mask = links.mask
    likely = np.zeros(mask.shape)
    for area in areas or (mask,):
        likely += np.where(area, 1 / (1 + evidence_against(colour, within(links, area))), 0.0)
    rule = float(likely[mask].mean()) if mask.any() else 0.0
    odds = min((rule / RULE) ** 8, SUREST) * likely / np.maximum(1 - likely, 1e-12)
    return np.where(mask, odds / (1 + odds), 0.0)


def evidence_against(colour: Floats, links: Links) -> Floats:
    """(h, w) >= 0, what speaks against fine relief in an area of one paint; 1 is even odds."""
    near, afar = (blurred(colour, px, links.mask) for px in (NEAR_PX, AFAR_PX))
    rough, left = (
        blurred(change(logarithm(each), links), TEXTURE_PX, links.mask) for each in (near, afar)
    )
    lasting = np.sqrt(left / np.maximum(rough, 1e-12))
    dark = logarithm(near.mean(axis=-1, keepdims=True))
    sharp = np.sqrt(blurred(change(dark, links), TEXTURE_PX, links.mask))
    # What a channel that the paint hardly reflects does is mostly noise; see `paints`.
    paint = near[links.mask].mean(axis=0) if links.mask.any() else np.ones(3)
    against = (lasting / LASTING) ** 8 + (off_line(near * paint, links) / OFF_LINE) ** 4
    return np.asarray(against + (sharp / SHARP) ** 8)


def within(links: Links, area: Mask) -> Links:
    """The links of `links` inside an area (h, w)."""
    inside = Links.of(links.mask & area)
    return Links(inside.mask, links.right & inside.right, links.down & inside.down)


def believed(colour: Floats, relief: Floats, links: Links, doubt: float) -> Floats:
    """How far shading is believed, (h, w) 0..1: less where the colour changes, as paint does.

    relief : (h, w) what `fine_relief` says of `colour` (h, w, 3); there it is believed all the same
    doubt : the inverse of the change per pixel, relative, that halves it; 0 believes everything
    """
    if not doubt:
        return np.ones(links.mask.shape)
    near = blurred(colour, NEAR_PX, links.mask)
    hue = logarithm(near) - logarithm(near.mean(axis=-1, keepdims=True))
    painted = blurred(change(hue, links), ALIKE_PX, links.mask)
    return np.asarray(1 - (1 - relief) * (1 - 1 / (1 + doubt**2 * painted)))


def without_relief(intensity: Floats, relief: Floats, areas: Sequence[Mask]) -> Floats:
    """An intensity (h, w) with its fine relief taken away: what it is from afar."""
    return np.asarray(intensity - relief * (intensity - from_afar(intensity, areas)))


def from_afar(intensity: Floats, areas: Sequence[Mask]) -> Floats:
    """An intensity (h, w) averaged over `AFAR_PX` within each of the areas (h, w) of one paint."""
    seen = intensity.copy()
    for area in areas:
        seen[area] = blurred(intensity, AFAR_PX, area)[area]
    return seen


def off_line(colour: Floats, links: Links) -> Floats:
    """(h, w) the part of the change of `colour` (h, w, 3) that is not along one line, 0..2/3."""
    products = np.zeros((*links.mask.shape, 6))
    first, second = np.triu_indices(3)
    for axis in (0, 1):
        step = np.stack([differences(each, links, axis)[0] for each in np.moveaxis(colour, -1, 0)])
        products += np.moveaxis(step[first] * step[second], 0, -1)
    products = blurred(products, TEXTURE_PX, links.mask)
    # Of a positive matrix of rank one, the norm is the trace.
    norm = np.sqrt((products**2 * np.where(first == second, 1, 2)).sum(axis=-1))
    trace = products[..., first == second].sum(axis=-1)
    return np.asarray(1 - norm / np.maximum(trace, 1e-12))


def change(image: Floats, links: Links) -> Floats:
    """(h, w) mean square of the differences of an image (h, w, C) to the linked neighbours."""
    squares, count = np.zeros(links.mask.shape), np.zeros(links.mask.shape)
    for axis in (0, 1):
        for channel in np.moveaxis(image, -1, 0):
            for step in differences(channel, links, axis):
                squares += step**2
        for side in neighbours(links, axis):
            count += side
    return np.asarray(squares / np.maximum(count, 1))


def logarithm(colour: Floats) -> Floats:
    """The log of linear light, noise in the dark left out."""
    return np.asarray(np.log(np.maximum(colour, DARKEST)))
