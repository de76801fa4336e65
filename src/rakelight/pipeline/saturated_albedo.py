"""The albedo where a channel has no value that counts: saturated, or in the dark of a shadow."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.methods.base import Estimate
from rakelight.model import SATURATED, Finding, Floats
from rakelight.pipeline.prediction import shadings
from rakelight.prepare import Prepared
from rakelight.prepare.linear import linear_table, usable

# Lamps that leave a saturated pixel this much darker than the brightest does are wrong there.
DARK = 0.2


def bounded_albedo(
    prepared: Prepared, depth_m: Floats, normals: Floats, estimate: Estimate
) -> tuple[Floats, tuple[Finding, ...]]:
    """The estimate's albedo (h, w, 3), a lower bound where no value told it.

    depth_m, normals : (h, w), (h, w, 3) the refined surface in the prepared window

    Without a value that counts a channel's albedo rho is left open, and 0.  But a saturated value
    says that rho a_i is at least the brightest usable one, a_i the shading of equation (3), and a
    value I_i in a cast shadow that rho a_i is at least I_i:

        rho >= limit / min_i a_i                    over the photographs i that are saturated there
        rho >= sum_i a_i I_i / sum_i a_i^2          over those that are usable

    Also a note that says how much of the object this is about.
    """
    albedo, lights = estimate.albedo, estimate.lights
    if len(lights) != len(prepared):
        return albedo, ()
    unknown = (albedo <= 0) & prepared.mask[..., None]
    rows, columns = np.nonzero(unknown.any(axis=-1))
    unknown = unknown[rows, columns]
    values = prepared.photographs[:, rows, columns]
    limit = int(np.ceil(SATURATED * np.iinfo(values.dtype).max))
    saturated, seen = values >= limit, usable(values)
    light = linear_table(values.dtype, prepared.encoding)
    points = back_project(depth_m, prepared.camera)
    shading = shadings(normals[rows, columns], points[rows, columns], lights)
    told = saturated & (shading > DARK * shading.max(axis=0))
    bright = light[limit] / np.where(told, shading, np.inf).min(axis=0)
    squares = np.sum(seen * shading**2, axis=0)
    dark = np.divide(
        np.sum(seen * shading * light[values], axis=0), squares,
        out=np.zeros_like(squares), where=squares > 0,
    )  # fmt: skip
    least = np.where(unknown, np.maximum(bright, dark), 0.0)
    if not least.any():
        return albedo, ()
    filled = albedo.copy()
    filled[rows, columns] += least
    share = np.count_nonzero(least.any(axis=-1)) / np.count_nonzero(prepared.mask)
    message = (
        f"{share:.1%} of the object has a channel that is saturated or in shadow in all "
        "photographs: its albedo is a lower bound"
    )
    return filled, (Finding("note", "albedo-bound", message, "expose one shorter"),)
