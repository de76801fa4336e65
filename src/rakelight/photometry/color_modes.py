"""The few albedos that most objects have: modes of their distribution."""

from __future__ import annotations

import numpy as np

from rakelight.model import Array, Floats

# Distance of log albedos, root sum of squares over the channels, of one colour.
SAME_COLOR = 0.25


def nearest_colors(albedo: Floats) -> tuple[Floats, Floats]:
    """The commonest colour (P, 3) around each log albedo (P, 3), and how alike they are, 0..1.

    The colours are the modes of the albedo's distribution (mean shift from a few hundred pixels,
    on a few thousand).

    >>> colors, alike = nearest_colors(np.repeat([[0.0] * 3, [-1.0] * 3, [-0.5] * 3], [9, 9, 1], 0))
    >>> colors[[0, 9], 0].round(2).tolist(), bool(alike[0] > 0.9)
    ([0.0, -1.0], True)
    """
    table, label = commonest_colors(albedo)
    apart = ((albedo - table[label]) ** 2).sum(axis=1)
    return table[label], np.asarray(1 / (1 + apart / SAME_COLOR**2) ** 2)


def commonest_colors(albedo: Floats) -> tuple[Floats, Array]:
    """The commonest colours (K, 3) of colours (P, 3), the first the commonest, and which is each's.

    >>> colors, label = commonest_colors(np.repeat([[0.0] * 3, [-1.0] * 3], [9, 4], 0))
    >>> colors[:, 0].round(2).tolist(), label[[0, 12]].tolist()
    ([0.0, -1.0], [0, 1])
    """
    some = albedo[:: max(1, len(albedo) // 1500)].astype(np.float32)
    modes = some[:: max(1, len(some) // 200)]

    def near(colors: Floats) -> Floats:
        squares = (colors**2).sum(axis=1)[:, None] + (some**2).sum(axis=1) - 2 * colors @ some.T
        return np.asarray(np.exp(-np.maximum(squares, 0) / (2 * SAME_COLOR**2)))

    for _ in range(15):
        share = near(modes)
        modes = share @ some / share.sum(axis=1)[:, None]
    density = near(modes).sum(axis=1)
    colors: list[Floats] = []
    for mode in modes[np.argsort(-density, kind="stable")]:
        if all(((mode - other) ** 2).sum() > SAME_COLOR**2 / 4 for other in colors):
            colors.append(mode)
    table = np.array(colors, dtype=np.float64)
    label = ((table**2).sum(axis=1) / 2 - albedo @ table.T).argmin(axis=1)
    for k in range(len(table)):
        if (label == k).any():
            table[k] = np.median(albedo[label == k], axis=0)
    return table, label
