"""Light from all sides on a relief: the visible sky, integrated."""

import numpy as np
from scipy.ndimage import map_coordinates

AZIMUTHS, ELEVATIONS = 12, 24


def gradient(height):
    return [(np.roll(height, -1, axis) - np.roll(height, 1, axis)) / 2 for axis in (0, 1)]


def sky(height, reach):
    """Light (h, w) from an even sky of radiance 1 / pi over a height, what stands before it out.

    height : (h, w) periodic, pixels; reach : how far, in pixels, the horizon is looked for
    """
    down, right = gradient(height)
    length = np.sqrt(1 + down**2 + right**2)
    light = np.zeros(height.shape)
    row, column = np.indices(height.shape)
    elevations = (np.arange(ELEVATIONS) + 0.5) * np.pi / 2 / ELEVATIONS
    for azimuth in np.arange(AZIMUTHS) * 2 * np.pi / AZIMUTHS:
        horizon = np.zeros(height.shape)
        for far in np.arange(1, reach):
            place = [row + far * np.sin(azimuth), column + far * np.cos(azimuth)]
            there = map_coordinates(height, place, order=1, mode="grid-wrap")
            horizon = np.maximum(horizon, np.arctan((there - height) / far))
        for elevation in elevations:
            across = -(right * np.cos(azimuth) + down * np.sin(azimuth)) * np.cos(elevation)
            cosine = np.maximum(across + np.sin(elevation), 0) / length
            light += np.where(elevation > horizon, cosine * np.cos(elevation), 0.0)
    return light * 2 / AZIMUTHS * np.pi / 2 / ELEVATIONS
