"""The reflectance regions of one photograph, and the brightness of each pixel.

Shading multiplies all channels of a region alike: the colour of a pixel is S u, u being the
direction of its region's colour.  Channels have about the same noise in linear light, so that by
least squares

    S = sum u_c I_c / sum u_c^2        over the usable channels c

A channel that the region hardly reflects, or that is clipped, then does not blur the others: on red
yarn whose green and blue are black, S is the red channel.  u is the mean colour around the pixel,
with clipped values as they are, a good approximation.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.blur import blurred
from rakelight.methods.single_image.texture import DARKEST
from rakelight.model import Floats, Mask
from rakelight.photometry.color_modes import commonest_colors

# Standard deviation, pixels, of the blur that gives the mean colour around a pixel; least fraction
# of the object that is a region.
PAINT_PX, LEAST_AREA = 3.0, 0.05


def brightness(colour: Floats, usable: Mask, mask: Mask) -> Floats:
    """The brightness S (h, w) of linear light (h, w, 3), the median over the object being 1.

    usable : (h, w, 3); without a usable channel, clipped values count as they are
    mask : (h, w) the object

    >>> red = np.tile([0.5, 0.0, 0.02], (1, 9, 1))
    >>> red[0, 4] *= 0.5
    >>> some = np.tile([True, False, True], (1, 9, 1))
    >>> brightness(red, some, np.ones((1, 9), bool))[0, 3:6].round(2).tolist()
    [1.0, 0.5, 1.0]
    """
    paint = direction(blurred(colour, PAINT_PX, mask))
    counted = np.where(usable.any(axis=-1, keepdims=True), usable, True) * paint
    tiny = np.finfo(float).tiny
    found = (counted * colour).sum(axis=-1) / np.maximum((counted * paint).sum(axis=-1), tiny)
    observed = found[mask & usable.any(axis=-1)]
    return np.asarray(found / max(float(np.median(observed)), tiny) if observed.size else found)


def reflectance_regions(colour: Floats, mask: Mask) -> list[Mask]:
    """The regions of an object (h, w) with one direction of colour (h, w, 3), a mask of each.

    A pixel belongs to a region if it has its colour itself and the pixels around it have, too: not
    at a border, nor where another albedo shows through.

    >>> colour = np.tile([0.5, 0.0, 0.0], (1, 40, 1))
    >>> colour[0, 20:] = 0.5
    >>> colour[0, 5] = [0.5, 0.4, 0.4]
    >>> regions = reflectance_regions(colour, np.ones((1, 40), bool))
    >>> [bool(region[0, [2, 35]].tolist() in ([True, False], [False, True])) for region in regions]
    [True, True]
    >>> any(region[0, 5] for region in regions)
    False
    """
    if not mask.any():
        return []
    around = blurred(colour, PAINT_PX, mask)
    colors, label = commonest_colors(direction(around)[mask])
    # Dark pixels take the colour around them.
    dark = colour.sum(axis=-1) < DARKEST * np.median(colour.sum(axis=-1)[mask])
    alone = direction(np.where(dark[..., None], around, colour))[mask]
    own = ((colors**2).sum(axis=1) / 2 - alone @ colors.T).argmin(axis=1)
    regions = []
    for k in range(len(colors)):
        region = np.zeros(mask.shape, dtype=bool)
        region[mask] = (label == k) & (own == k)
        if np.count_nonzero(region) > LEAST_AREA * np.count_nonzero(mask):
            regions.append(region)
    return regions


def direction(colour: Floats) -> Floats:
    """Colours (..., 3) of length 1."""
    length = np.linalg.norm(colour, axis=-1, keepdims=True)
    return np.asarray(colour / np.maximum(length, np.finfo(float).tiny))
