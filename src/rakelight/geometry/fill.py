"""Values for pixels that have none."""

from __future__ import annotations

import numpy as np

from rakelight.model import Floats, Mask


def nearest_fill(values: Floats, measured: Mask) -> Floats:
    """`values` (h, w[, C]) with every other pixel given that of the nearest measured one."""
    from scipy.ndimage import distance_transform_edt

    if measured.all():
        return np.array(values, dtype=np.float64)
    index = distance_transform_edt(~measured, return_distances=False, return_indices=True)
    return np.asarray(values[tuple(index)], dtype=np.float64)
