"""Albedo or relief: which changes of one photograph are shading of fine relief (texture).

Another albedo has another colour; shading makes it darker or brighter.  But a valley is more
saturated than its ridge, by interreflection, and cameras add colour errors.  So a change of colour
is taken for one of the albedo, unless it is texture, such as yarn:

- it varies from pixel to pixel, and blur removes it; edges and stains remain in a blurred image;
- all its colours lie on one line, from the dark to the bright of one albedo;
- it has no strokes as sharp as drawn ones;
- most of the object has it.

Where an object has several reflectance regions, each is looked at by itself: the borders between
them are no texture, but the yarn beside them is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rakelight.geometry.blur import blurred
from rakelight.geometry.grid import Links, differences, neighbours
from rakelight.model import Floats, Mask

# Standard deviations of Gaussian blurs, pixels: that averages noise; that removes texture; within
# which the colour of a region is compared; and over which the statistics of texture are averaged.
NEAR_PX, AFAR_PX, ALIKE_PX, TEXTURE_PX = 1.0, 4.0, 3.0, 6.0
# Least value that counts as colour, over the object's median: darker ones are noise.
DARKEST = 0.03
# Where each kind of evidence against texture makes the odds even: the change per pixel that remains
# after `AFAR_PX`, over that before; the share of the change of colour off the line; the change of
# log brightness per pixel.
LASTING, OFF_LINE, SHARP = 0.2, 0.13, 0.22
# Fraction of the object that looks like texture at which the prior odds are even; the highest odds.
RULE, SUREST = 0.28, 10.0


def texture_likelihood(colour: Floats, links: Links, regions: Sequence[Mask] = ()) -> Floats:
    """(h, w) 0..1, likelihood that the changes of a photograph (h, w, 3) are texture of one albedo.

    colour : linear light, the object's median about 1, clipped values as they are
    regions : (h, w) each, of one albedo, looked at by themselves; the whole unless given

    >>> rng, mask = np.random.default_rng(0), np.ones((40, 40), bool)
    >>> yarn = 1 + 0.4 * np.sin(np.arange(40))[:, None, None] * [1.0, 0.8, 0.9]
    >>> stain = 1 + 0.4 * (np.arange(40) > 20)[:, None, None] * [1.0, 0.8, 0.9]
    >>> for photograph in (yarn, stain):
    ...     print(texture_likelihood(photograph.repeat(40, axis=1), Links.of(mask)).mean().round(1))
    1.0
    0.0
    """
    mask = links.mask
    likely = np.zeros(mask.shape)
    for region in regions or (mask,):
        likely += np.where(region, 1 / (1 + evidence_against(colour, within(links, region))), 0.0)
    rule = float(likely[mask].mean()) if mask.any() else 0.0
    odds = min((rule / RULE) ** 8, SUREST) * likely / np.maximum(1 - likely, 1e-12)
    return np.where(mask, odds / (1 + odds), 0.0)


def evidence_against(colour: Floats, links: Links) -> Floats:
    """(h, w) >= 0, evidence against texture in a region of one albedo; 1 is even odds."""
    near, afar = (blurred(colour, px, links.mask) for px in (NEAR_PX, AFAR_PX))
    rough, remaining = (
        blurred(change(logarithm(each), links), TEXTURE_PX, links.mask) for each in (near, afar)
    )
    lasting = np.sqrt(remaining / np.maximum(rough, 1e-12))
    dark = logarithm(near.mean(axis=-1, keepdims=True))
    sharp = np.sqrt(blurred(change(dark, links), TEXTURE_PX, links.mask))
    # A channel that the region hardly reflects is mostly noise; see `reflectance_regions`.
    paint = near[links.mask].mean(axis=0) if links.mask.any() else np.ones(3)
    against = (lasting / LASTING) ** 8 + (off_line(near * paint, links) / OFF_LINE) ** 4
    return np.asarray(against + (sharp / SHARP) ** 8)


def within(links: Links, region: Mask) -> Links:
    """The links of `links` inside a region (h, w)."""
    inside = Links.of(links.mask & region)
    return Links(inside.mask, links.right & inside.right, links.down & inside.down)


def shading_weight(colour: Floats, texture: Floats, links: Links, colour_weight: float) -> Floats:
    """(h, w) 0..1, the weight of the shading: less where colour, and so albedo, changes.

    texture : (h, w) `texture_likelihood` of `colour` (h, w, 3), which raises the weight
    colour_weight : inverse of the relative change per pixel that halves it; 0 for a weight of 1
        everywhere
    """
    if not colour_weight:
        return np.ones(links.mask.shape)
    near = blurred(colour, NEAR_PX, links.mask)
    hue = logarithm(near) - logarithm(near.mean(axis=-1, keepdims=True))
    colour_change = blurred(change(hue, links), ALIKE_PX, links.mask)
    return np.asarray(1 - (1 - texture) * (1 - 1 / (1 + colour_weight**2 * colour_change)))


def without_texture(intensity: Floats, texture: Floats, regions: Sequence[Mask]) -> Floats:
    """An intensity (h, w) without its texture: blurred where there is some."""
    return np.asarray(intensity - texture * (intensity - from_afar(intensity, regions)))


def from_afar(intensity: Floats, regions: Sequence[Mask]) -> Floats:
    """An intensity (h, w) averaged over `AFAR_PX` within each of the regions (h, w)."""
    seen = intensity.copy()
    for region in regions:
        seen[region] = blurred(intensity, AFAR_PX, region)[region]
    return seen


def off_line(colour: Floats, links: Links) -> Floats:
    """(h, w) the share of the change of `colour` (h, w, 3) that is not along one line, 0..2/3."""
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
    """The log of linear light, clipped at `DARKEST`, below which is noise."""
    return np.asarray(np.log(np.maximum(colour, DARKEST)))
