"""Missing depth filled from its neighbours (the paper's 3.1, figure 4)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rakelight.geometry.fill import nearest_fill
from rakelight.geometry.masks import dilate
from rakelight.model import Floats, Mask
from rakelight.solve import assemble, solve


def inpaint(depth_m: Floats, mask: Mask) -> Floats:
    """Depth (h, w) in metres with every hole inside `mask` (h, w) filled; NaN outside.

    A hole is filled by the membrane that its rim carries: the log depth whose gradient has the
    least energy, measured pixels staying exactly as they are.  A part of the mask without any
    measurement takes the depth of the measured pixel nearest to it.

    Raises InputError where the solver does not find the membrane.

    >>> depth = np.full((5, 5), 2.0); depth[2, 2] = np.nan
    >>> round(float(inpaint(depth, np.ones((5, 5), bool))[2, 2]), 6)
    2.0
    """
    measured = mask & np.isfinite(depth_m)
    holes = mask & ~measured
    if not holes.any():
        return np.where(mask, depth_m, np.nan)
    log_depth = np.log(nearest_fill(depth_m, measured))
    # Only the holes and their rims move: the rim (two pixels) is held by a heavy weight.
    window = dilate(holes, 2) & mask
    tensor = np.zeros((*mask.shape, 3))
    tensor[..., [0, 2]] = 1.0
    system = assemble(
        window,
        tensor=tensor,
        vector=np.zeros((*mask.shape, 2)),
        data_weight=np.where(holes, 0.0, 1e6),
        data_target=log_depth,
    )
    # Solved for the change against the nearest fill: beside the rim's heavy right side the
    # holes' own residual would not count.
    change = replace(system, rhs=system.rhs - system.apply(log_depth), target=0 * log_depth)
    filled = np.exp(log_depth + solve(change).required("the holes of the depth"))
    return np.where(holes, filled, np.where(mask, depth_m, np.nan))
