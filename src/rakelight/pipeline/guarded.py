"""A method with two safeguards: odd photographs are left out; no information does no harm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from rakelight.check.odd_photograph import odd_finding, odd_photographs
from rakelight.errors import MethodError
from rakelight.geometry.normals import surface_normals
from rakelight.methods.base import ONE_LAMP_POSITION, Estimate, Method
from rakelight.model import Finding, Floats, ProgressCallback, silent
from rakelight.pipeline.degenerate import without_normals
from rakelight.pipeline.given_lights import angles_deg, wrong_lights
from rakelight.pipeline.held_back import (
    NO_BETTER,
    NO_BETTER_SO_LIT,
    ONE_PLACE,
    Prediction,
    kept,
    predict,
)
from rakelight.prepare import Prepared
from rakelight.solve.robust import NOTABLE

Options = TypeVar("Options")
Run = Callable[[Prepared, Options, ProgressCallback], Estimate]


def estimated(
    chosen: Method, prepared: Prepared, options: Any, progress: ProgressCallback = silent
) -> tuple[Prepared, Estimate]:
    """The method's estimate with its safeguards, and the photographs that it was made from.

    Raises MethodError where a method gives back what is no estimate.
    """
    degenerate = without_normals(prepared)
    if degenerate is not None:
        return prepared, degenerate
    if chosen.starts_from_depth:
        wrong = wrong_lights(prepared) if chosen.given_lights == "use" else ()
        return guarded(chosen.estimate, prepared, options, progress, wrong)
    return prepared, chosen.estimate(prepared, options, progress)


def guarded(
    run: Run[Options],
    prepared: Prepared,
    options: Options,
    progress: ProgressCallback,
    wrong: tuple[Finding, ...] = (),
) -> tuple[Prepared, Estimate]:
    """The method's estimate, and the prepared capture with the photographs that it was made from.

    Photographs that the others predict badly are left out and the rest refined anew, where that
    makes the others' predictions better: a photograph under a lamp far from the others is predicted
    badly too, and needed.  Photographs of something else are left out in any case.  As one can hide
    another, it looks until nothing more is left out, and refines again each time.  Where the
    refined surface predicts photographs that are held back no better than the prepared depth does,
    or the lights are found in nearly one place and no smaller errors of the normals are expected,
    the estimate is the prepared depth.

    wrong : what is said of given lights that are wrong; no photograph is blamed for them
    """
    estimate, prediction = _predicted(run, prepared, options, progress)
    findings = [*wrong]
    while prediction is not None and not wrong:
        oddity = odd_photographs(prediction.refined, prediction.brightness, prediction.variation)
        if not oddity.either.any():
            break
        fit = np.flatnonzero(~oddity.either)
        rest = prepared.select(fit)
        try:
            without, then = _predicted(run, rest, options, progress)
        except MethodError:  # the method does not take so few
            findings.append(odd_finding(prepared.names, oddity.either, kept=True))
            break
        if then is None:
            break
        helped = float(np.exp(np.nanmean(np.log(then.refined / prediction.refined[fit]))))
        if not (oddity.foreign.any() or helped < oddity.least_help):
            break
        findings.append(odd_finding(prepared.names, oddity.either))
        prepared, estimate, prediction = rest, without, then
    if reason := reason_to_keep(prepared, estimate, prediction):
        reason = NO_BETTER_SO_LIT if wrong and reason is NO_BETTER else reason
        findings += [each for each in estimate.findings if each.severity == "warning"]
        estimate = kept(prepared, reason)
    return prepared, replace(estimate, findings=(*findings, *estimate.findings))


def reason_to_keep(
    prepared: Prepared, estimate: Estimate, prediction: Prediction | None
) -> Finding | None:
    """Why the prepared depth is the better answer, if it is.

    prediction : None where there are too few photographs to hold one back
    """
    if not estimate.iterations:
        return None  # it is the answer already
    # Without information the two are alike to 1 %, else the ratio is a half or less.
    if prediction is not None and prediction.gain > 1 - NOTABLE:
        return NO_BETTER
    given = prepared.lights is not None and prepared.lights.fixed
    one_place = any(each.code == ONE_LAMP_POSITION for each in estimate.findings)
    if one_place and not given and not expects_better_normals(prepared, estimate):
        return ONE_PLACE
    return None


def expects_better_normals(prepared: Prepared, estimate: Estimate) -> bool:
    """Whether the method expects smaller errors of its normals than of the prepared depth's.

    The two differ by both errors together: less than half of that difference's mean square is then
    the method's.  False where it expects none.
    """
    if estimate.normal_sigma is None:
        return False
    _, after = surface(prepared, estimate)
    before = surface_normals(prepared.depth_m, prepared.mask, prepared.camera)
    change_deg = angles_deg(before, after)
    both = prepared.mask & np.isfinite(change_deg) & np.isfinite(estimate.normal_sigma)
    squares = [np.square(each[both]).sum() for each in (estimate.normal_sigma, change_deg)]
    return bool(2 * squares[0] < squares[1])


def _predicted(
    run: Run[Options], prepared: Prepared, options: Options, progress: ProgressCallback
) -> tuple[Estimate, Prediction | None]:
    """The method's estimate, and how well its surface predicts photographs that are held back."""
    estimate = run(prepared, options, progress)
    return estimate, predict(prepared, *surface(prepared, estimate), estimate.lights)


def surface(prepared: Prepared, estimate: Estimate) -> tuple[Floats, Floats]:
    """Depth (h, w), metres, and normals (h, w, 3) of an estimate, finer ones where it has any."""
    depth_m = np.exp(estimate.log_depth)
    normals = surface_normals(depth_m, prepared.mask, prepared.camera)
    if (fine := estimate.normals) is not None:
        normals = np.where(np.isfinite(fine), fine, normals)
    return depth_m, normals
