"""The albedo where all values of a channel are saturated or in shadow: a lower bound."""

from __future__ import annotations

import numpy as np

from rakelight.geometry.camera import back_project
from rakelight.methods.base import Estimate
from rakelight.model import SATURATED, Finding, Floats, Mask
from rakelight.photometry.forward import shadings
from rakelight.prepare import Prepared
from rakelight.prepare.linear import linear_table, usable

# Least shading, over the largest at the pixel, of a saturated value that is used: where the model
# predicts less it is wrong.
DARK = 0.2


def bounded_albedo(
    prepared: Prepared, depth_m: Floats, normals: Floats, estimate: Estimate
) -> tuple[Floats, tuple[Finding, ...]]:
    """The estimate's albedo (h, w, 3), a lower bound where no value determines it.

    depth_m, normals : (h, w), (h, w, 3) the refined surface in the prepared window

    Without a usable value a channel's albedo rho is undetermined, and 0.  But a saturated value
    implies that rho a_i is at least the brightest usable one, a_i the shading of equation (3), a
    value I_i in a cast shadow that rho a_i is at least I_i:

        rho >= limit / min_i a_i                    over the photographs i that are saturated there
        rho >= sum_i a_i I_i / sum_i a_i^2          over those that are usable

    Also a note with the share of the object where it is one.
    """
    albedo, bounded = with_lower_bounds(prepared, depth_m, normals, estimate)
    return albedo, bound_findings(np.count_nonzero(bounded) / np.count_nonzero(prepared.mask))


def bound_findings(share: float) -> tuple[Finding, ...]:
    """The note about the share of the object whose albedo is a lower bound.

    None for a share that would be told as 0.0 %.
    """
    if share < 5e-4:
        return ()
    message = (
        f"{share:.1%} of the object has a channel that is saturated or in shadow in all "
        "photographs: its albedo is a lower bound"
    )
    return (Finding("note", "albedo-bound", message, "expose one shorter"),)


def with_lower_bounds(
    prepared: Prepared, depth_m: Floats, normals: Floats, estimate: Estimate
) -> tuple[Floats, Mask]:
    """What `bounded_albedo` says, and the pixels (h, w) where the albedo is a lower bound."""
    albedo, lights = estimate.albedo, estimate.lights
    nowhere = np.zeros(prepared.mask.shape, dtype=bool)
    if len(lights) != len(prepared):
        return albedo, nowhere
    undetermined = (albedo <= 0) & prepared.mask[..., None]
    rows, columns = np.nonzero(undetermined.any(axis=-1))
    undetermined = undetermined[rows, columns]
    values = prepared.photographs[:, rows, columns]
    limit = int(np.ceil(SATURATED * np.iinfo(values.dtype).max))
    saturated, seen = values >= limit, usable(values)
    light = linear_table(values.dtype, prepared.encoding)
    points = back_project(depth_m, prepared.camera)
    shading = shadings(normals[rows, columns], points[rows, columns], lights)
    bounding = saturated & (shading > DARK * shading.max(axis=0))
    bright = light[limit] / np.where(bounding, shading, np.inf).min(axis=0)
    squares = np.sum(seen * shading**2, axis=0)
    dark = np.divide(
        np.sum(seen * shading * light[values], axis=0), squares,
        out=np.zeros_like(squares), where=squares > 0,
    )  # fmt: skip
    least = np.where(undetermined, np.maximum(bright, dark), 0.0)
    if not least.any():
        return albedo, nowhere
    filled = albedo.copy()
    filled[rows, columns] = np.maximum(filled[rows, columns], least)
    bounded = nowhere
    bounded[rows, columns] = least.any(axis=-1)
    return filled, bounded
