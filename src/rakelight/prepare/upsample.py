"""A depth map brought to a finer grid that covers the same field of view."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.fill import nearest_fill
from rakelight.geometry.grid import Links, mean_gradient, neighbours
from rakelight.geometry.masks import dilate
from rakelight.model import Array, Floats

# Distance from a jump, pixels, beyond which a spline's ringing is negligible: it falls to a quarter
# with every pixel.
RINGING_PX = 4


def upsample(
    depth_m: Floats,
    shape: tuple[int, int],
    links: Links,
    window: tuple[slice, slice] = np.s_[:, :],
) -> Floats:
    """Depth (h, w) in metres on a grid of `shape` with the same view; NaN outside the object.

    links : which pixels of the object are on one surface
    window : the rows and columns of the new grid that are wanted

    Log depth is interpolated by cubic splines between pixel centres, which keep slopes and bends
    (OpenCV's bicubic kernel does not on a slope); the object is first continued outwards, so that
    its border is not mixed with what lies behind.  The values outside are that continuation.
    Splines ring at jumps, too: near those, each pixel continues the surface that its sensor
    pixel is on.

    >>> depth = np.exp(np.arange(24.0))[None, :].repeat(4, axis=0)
    >>> whole = Links.of(np.ones((4, 24), bool))
    >>> np.log(upsample(depth, (8, 48), whole))[4, 22:26].round(3).tolist()
    [10.75, 11.25, 11.75, 12.25]
    """
    from scipy.ndimage import map_coordinates

    log_depth = np.log(nearest_fill(depth_m, np.isfinite(depth_m)))
    if shape == depth_m.shape:
        return np.exp(log_depth[window])
    # Of each new pixel, the sensor's row and column, in its pixels.
    places = [
        (np.arange(side)[part] + 0.5) / (side / small) - 0.5
        for side, small, part in zip(shape, depth_m.shape, window, strict=True)
    ]
    mesh = np.meshgrid(*places, indexing="ij")
    smooth = np.asarray(map_coordinates(log_depth, mesh, order=3, mode="nearest"))
    if links.cut:
        near_jump = dilate(_at_a_jump(links), RINGING_PX) & links.mask
        sensor_pixel = [
            np.clip(np.round(p).astype(int), 0, n - 1)
            for p, n in zip(places, depth_m.shape, strict=True)
        ]
        at = np.nonzero(near_jump[np.ix_(*sensor_pixel)])
        here = [place[index] for place, index in zip(places, at, strict=True)]
        own = [place[index] for place, index in zip(sensor_pixel, at, strict=True)]
        smooth[at] = _continued(log_depth, links, here, own)
    return np.asarray(np.exp(smooth))


def _at_a_jump(links: Links) -> Array:
    """(h, w) pixels of the object with a neighbour on another surface."""
    whole = Links.of(links.mask)
    both = ((neighbours(whole, axis), neighbours(links, axis)) for axis in (0, 1))
    return np.asarray(np.any([np.not_equal(*each).any(axis=0) for each in both], axis=0))


def _continued(log_depth: Floats, links: Links, here: list[Floats], own: list[Array]) -> Floats:
    """(n,) log depth at the places `here` (row, column), on the surface of the pixels `own`.

    The bilinear mean of the tangent planes at the (up to) four pixels around a place that are
    linked with its own.
    """
    slopes = mean_gradient(log_depth, links)[::-1]
    height, width = log_depth.shape
    step = [np.where(h >= o, 1, -1) for h, o in zip(here, own, strict=True)]
    share = [np.abs(h - o) for h, o in zip(here, own, strict=True)]
    row, column = own
    next_row = np.clip(row + step[0], 0, height - 1)
    next_column = np.clip(column + step[1], 0, width - 1)
    down = links.down[np.minimum(row, next_row), column] & (row != next_row)
    right = links.right[row, np.minimum(column, next_column)] & (column != next_column)
    corner = right & links.down[np.minimum(row, next_row), next_column]
    corner |= down & links.right[next_row, np.minimum(column, next_column)]
    corner &= (row != next_row) & (column != next_column)
    total, weights = np.zeros(len(row)), np.zeros(len(row))
    for y, x, linked, weight in (
        (row, column, True, (1 - share[0]) * (1 - share[1])),
        (next_row, column, down, share[0] * (1 - share[1])),
        (row, next_column, right, (1 - share[0]) * share[1]),
        (next_row, next_column, corner, share[0] * share[1]),
    ):
        plane = log_depth[y, x] + slopes[0][y, x] * (here[0] - y) + slopes[1][y, x] * (here[1] - x)
        weight = np.where(linked, weight, 0.0)
        total += weight * plane
        weights += weight
    return np.asarray(total / weights)
