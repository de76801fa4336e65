# mypy: disable-error-code="no-untyped-def"
"""The loop over pixels behind undistort.py, compiled on first use."""

from __future__ import annotations

from math import ceil, floor, sqrt

from rakelight.jit import helper, kernel


@helper
def steps_along(length):
    """How many points an output pixel's side of `length` input pixels takes, and their distance.

    The distance is in output pixels.  The points' variance and an input pixel's add up to that of
    an output pixel, so that it is the mean of what it covers: (n^2 - 1) step^2 = length^2 - 1.
    """
    count = min(max(ceil(length - 1e-9), 1), 16)
    if count == 1:
        return 1, 0.0
    return count, sqrt((length * length - 1.0) / (count * count - 1.0)) / length


@helper
def accumulate(values, u, v, saturated, weights, total):
    """Add to total (C,) the values (H, W, C) at (u, v); 1e30 where they would mix saturated ones.

    By the weights (n + 1, 6) of fractions of a pixel; linear where some of the outer pixels are
    saturated or beyond the image.
    """
    height, width, channels = values.shape
    u, v = min(max(u, 0.0), width - 1.0), min(max(v, 0.0), height - 1.0)
    left, top = floor(u), floor(v)
    right, bottom = min(left + 1, width - 1), min(top + 1, height - 1)
    a, b = u - left, v - top
    along_u = weights[int(a * (len(weights) - 1) + 0.5)]
    along_v = weights[int(b * (len(weights) - 1) + 0.5)]
    within = left >= 2 and top >= 2 and left <= width - 4 and top <= height - 4
    for channel in range(channels):
        corner, beside = values[top, left, channel], values[top, right, channel]
        below, opposite = values[bottom, left, channel], values[bottom, right, channel]
        if (
            (corner >= saturated and (1.0 - a) * (1.0 - b) > 1e-6)
            or (beside >= saturated and a * (1.0 - b) > 1e-6)
            or (below >= saturated and (1.0 - a) * b > 1e-6)
            or (opposite >= saturated and a * b > 1e-6)
        ):
            total[channel] += 1e30
            continue
        smooth, found = within, 0.0
        if within:
            for i in range(6):
                row = 0.0
                for j in range(6):
                    value = values[top + i - 2, left + j - 2, channel]
                    smooth = smooth and value < saturated
                    row += along_u[j] * value
                found += along_v[i] * row
        if not smooth:
            found = (1.0 - b) * ((1.0 - a) * corner + a * beside)
            found += b * ((1.0 - a) * below + a * opposite)
        total[channel] += found


@kernel
def resample(first_row, last_row, values, place, jacobian, saturated, black, weights, total, out):
    """Fill out (h, w, C) with an image (H, W, C) seen through a map: 0 where it shows nothing.

    place : (h, w, 2) u and v in the image, NaN = nowhere
    jacobian : (h, w, 2, 2) derivatives of u, v (last axis) with the output's column and row
    saturated, black : from and up to which values count as such.  What mixes saturated ones is 1;
        what is nearest to a black one is that
    weights : (n + 1, 6) of the pixels around a fraction 0, 1/n, ... 1 of a pixel
    total : (C,) to work on
    """
    height, width, channels = values.shape
    for row in range(first_row, last_row):
        for column in range(place.shape[1]):
            u, v = place[row, column, 0], place[row, column, 1]
            # NaN is not inside, either.
            if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
                for channel in range(channels):
                    out[row, column, channel] = 0.0
                continue
            across, down = jacobian[row, column, 0], jacobian[row, column, 1]
            count_u, step_u = steps_along(sqrt(across[0] ** 2 + across[1] ** 2))
            count_v, step_v = steps_along(sqrt(down[0] ** 2 + down[1] ** 2))
            for channel in range(channels):
                total[channel] = 0.0
            for i in range(count_v):
                b = (i - 0.5 * (count_v - 1)) * step_v
                for j in range(count_u):
                    a = (j - 0.5 * (count_u - 1)) * step_u
                    at_u, at_v = u + a * across[0] + b * down[0], v + a * across[1] + b * down[1]
                    accumulate(values, at_u, at_v, saturated, weights, total)
            near_row = min(max(floor(v + 0.5), 0), height - 1)
            near_column = min(max(floor(u + 0.5), 0), width - 1)
            for channel in range(channels):
                nearest = values[near_row, near_column, channel]
                mean = min(max(total[channel] / (count_u * count_v), 0.0), 1.0)
                out[row, column, channel] = nearest if nearest <= black else mean
