"""The paints of one photograph: where they are, and how bright each pixel of them is.

Shading multiplies all channels of a paint alike: the colour of a pixel is S u, u being the
direction of its paint's colour.  Channels have about the same noise in linear light, so that by
least squares

    S = sum u_c I_c / sum u_c^2        over the usable channels c

A channel that the paint hardly reflects, or that is clipped, then does not blur what another shows:
on red yarn whose green and blue are black, S is the red channel.  u is the mean colour around the
pixel, clipped values as they are, which they are nearly.
"""

from __future__ import annotations

import numpy as np

from rakelight.geometry.blur import blurred
from rakelight.methods.single_image.texture import DARKEST
from rakelight.model import Floats, Mask
from rakelight.photometry.color_modes import commonest_colors

# The paint around a pixel has the mean colour of so many pixels, and is so much of the object.
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
    told = found[mask & usable.any(axis=-1)]
    return np.asarray(found / max(float(np.median(told)), tiny) if told.size else found)


def paints(colour: Floats, mask: Mask) -> list[Mask]:
    """Where each paint of an object (h, w) is, told by the direction of its colours (h, w, 3).

    A pixel belongs to a paint if it has that colour itself and the pixels around it have, too: not
    at a border, nor where a lining shows through.

    >>> colour = np.tile([0.5, 0.0, 0.0], (1, 40, 1))
    >>> colour[0, 20:] = 0.5
    >>> colour[0, 5] = [0.5, 0.4, 0.4]
    >>> areas = paints(colour, np.ones((1, 40), bool))
    >>> [bool(area[0, [2, 35]].tolist() in ([True, False], [False, True])) for area in areas]
    [True, True]
    >>> any(area[0, 5] for area in areas)
    False
    """
    if not mask.any():
        return []
    around = blurred(colour, PAINT_PX, mask)
    colors, label = commonest_colors(direction(around)[mask])
    # The dark has no colour.
    dark = colour.sum(axis=-1) < DARKEST * np.median(colour.sum(axis=-1)[mask])
    alone = direction(np.where(dark[..., None], around, colour))[mask]
    own = ((colors**2).sum(axis=1) / 2 - alone @ colors.T).argmin(axis=1)
    areas = []
    for k in range(len(colors)):
        area = np.zeros(mask.shape, dtype=bool)
        area[mask] = (label == k) & (own == k)
        if np.count_nonzero(area) > LEAST_AREA * np.count_nonzero(mask):
            areas.append(area)
    return areas


def direction(colour: Floats) -> Floats:
    """Colours (..., 3) of length 1."""
    length = np.linalg.norm(colour, axis=-1, keepdims=True)
    return np.asarray(colour / np.maximum(length, np.finfo(float).tiny))
