# mypy: disable-error-code="no-untyped-def"
"""The loops over pixels behind derivatives.py, compiled on first use."""

from __future__ import annotations

from rakelight.jit import kernel


@kernel
def gradient_image(first_row, last_row, values, right, down, out):
    """Fill out (H, W, 2) with the mean of the one-sided differences along u and along v."""
    width = values.shape[1]
    for row in range(first_row, last_row):
        for column in range(width):
            here, along_u, along_v, on_u, on_v = values[row, column], 0.0, 0.0, 0.0, 0.0
            if right[row, column]:
                along_u, on_u = along_u + (values[row, column + 1] - here), on_u + 1.0
            if column > 0 and right[row, column - 1]:
                along_u, on_u = along_u + (here - values[row, column - 1]), on_u + 1.0
            if down[row, column]:
                along_v, on_v = along_v + (values[row + 1, column] - here), on_v + 1.0
            if row > 0 and down[row - 1, column]:
                along_v, on_v = along_v + (here - values[row - 1, column]), on_v + 1.0
            out[row, column, 0] = along_u / max(on_u, 1.0)
            out[row, column, 1] = along_v / max(on_v, 1.0)


@kernel
def fourth_differences(first_row, last_row, values, along_u, along_v, out):
    """Fill out (2, H, W) with the fourth differences along u and v, 0 where there are none."""
    width = values.shape[1]
    for row in range(first_row, last_row):
        for column in range(width):
            u, v, six = 0.0, 0.0, 6.0 * values[row, column]
            if along_u[row, column]:
                near = values[row, column - 1] + values[row, column + 1]
                u = six - 4.0 * near + values[row, column - 2] + values[row, column + 2]
            if along_v[row, column]:
                near = values[row - 1, column] + values[row + 1, column]
                v = six - 4.0 * near + values[row - 2, column] + values[row + 2, column]
            out[0, row, column], out[1, row, column] = u, v
