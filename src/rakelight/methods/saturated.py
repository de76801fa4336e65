"""The albedo where a channel is saturated in every photograph that shows it."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.methods.estimate import Estimate
from rakelight.methods.prediction import shadings
from rakelight.model import Finding, Floats
from rakelight.prepare import Prepared
from rakelight.prepare.linear import SATURATED, linear_table, usable

# Lamps that leave a saturated pixel this much darker than the brightest does are wrong there.
DARK = 0.2


def bounded_albedo(
    prepared: Prepared, depth_m: Floats, normals: Floats, estimate: Estimate
) -> tuple[Floats, tuple[Finding, ...]]:
    """The estimate's albedo (h, w, 3), a lower bound where saturated values are all there is.

    depth_m, normals : (h, w), (h, w, 3) the refined surface in the prepared window

    Without a usable value a channel's albedo rho is left open, and 0.  But a saturated value says
    that rho a_i is at least the brightest usable one, a_i the shading of equation (3), and so

        rho >= limit / min_i a_i        over the photographs i that are saturated there

    Also a note that says how much of the object this is about.
    """
    albedo, lights = estimate.albedo, estimate.lights
    if len(lights) != len(prepared):
        return albedo, ()
    unknown = (albedo <= 0) & prepared.mask[..., None]
    rows, columns = np.nonzero(unknown.any(axis=-1))
    values = prepared.photographs[:, rows, columns]
    limit = int(np.ceil(SATURATED * np.iinfo(values.dtype).max))
    saturated = values >= limit
    points = back_project(depth_m, prepared.camera)
    middle = points[prepared.mask].mean(axis=0)
    shading = shadings(normals[rows, columns], points[rows, columns], middle, lights)
    told = saturated & (shading > DARK * shading.max(axis=0))
    bounded = unknown[rows, columns] & told.any(axis=0) & ~usable(values).any(axis=0)
    if not bounded.any():
        return albedo, ()
    darkest = np.where(told, shading, np.inf).min(axis=0)
    least = linear_table(values.dtype, prepared.encoding)[limit] / darkest
    filled = albedo.copy()
    filled[rows, columns] = np.where(bounded, least, albedo[rows, columns])
    share = np.count_nonzero(bounded.any(axis=-1)) / np.count_nonzero(prepared.mask)
    message = f"{share:.1%} of the object has a channel saturated in all photographs: its albedo "
    note = Finding("note", "albedo-bound", message + "is a lower bound", "expose one shorter")
    return filled, (note,)
