"""A method with two safeguards: odd photographs are left out; no information does no harm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from rakelight.check.odd_photograph import odd_finding, odd_photographs
from rakelight.geometry.normals import surface_normals
from rakelight.methods.estimate import Estimate
from rakelight.methods.held_back import LEAST_GAIN, kept, predict
from rakelight.model import Floats, ProgressCallback
from rakelight.prepare import Prepared

Options = TypeVar("Options")
Run = Callable[[Prepared, Options, ProgressCallback], Estimate]

# One odd photograph can hide another; those that a third look would find are not worth refining
# all again.
LOOKS = 2


def guarded(
    run: Run[Options], prepared: Prepared, options: Options, progress: ProgressCallback
) -> tuple[Prepared, Estimate]:
    """The method's estimate, and the prepared capture with the photographs that it was made from.

    Photographs that the others do not predict are left out and the rest refined anew.  Where the
    refined surface predicts photographs that are held back no better than the prepared depth does,
    the estimate is the prepared depth.
    """
    findings = []
    for look in range(LOOKS + 1):
        estimate = run(prepared, options, progress)
        prediction = predict(prepared, *surface(prepared, estimate), estimate.lights)
        if prediction is None:
            break
        odd = odd_photographs(prediction.refined, prediction.brightness, prediction.variation)
        if look == LOOKS or not odd.any():
            break
        findings.append(odd_finding(prepared.names, odd))
        prepared = prepared.select(np.flatnonzero(~odd))
    if prediction is not None and prediction.gain > LEAST_GAIN and estimate.iterations:
        findings += [each for each in estimate.findings if each.severity == "warning"]
        estimate = kept(prepared, prediction.prepared_lights)
    return prepared, replace(estimate, findings=(*findings, *estimate.findings))


def surface(prepared: Prepared, estimate: Estimate) -> tuple[Floats, Floats]:
    """Depth (h, w), metres, and normals (h, w, 3) of an estimate, finer ones where it has any."""
    depth_m = np.exp(estimate.log_depth)
    normals = surface_normals(depth_m, prepared.mask, prepared.camera)
    if (fine := estimate.normals) is not None:
        normals = np.where(np.isfinite(fine), fine, normals)
    return depth_m, normals
