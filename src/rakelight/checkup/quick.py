"""The method at low resolution: lights, photographs that do not fit, the accuracy to expect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rakelight.check.next_lights import (
    NextLight,
    low_light_findings,
    next_light_findings,
    next_lights,
    sphere_normals,
)
from rakelight.checkup.report import Accuracy
from rakelight.checkup.verdict import refused_finding
from rakelight.errors import InputError, MethodError
from rakelight.methods import Method, choose_method, load_method
from rakelight.methods.base import UNDETERMINED_RAD, Estimate
from rakelight.methods.multi_light import MultiLight
from rakelight.model import Capture, Finding, Floats
from rakelight.pipeline import solving
from rakelight.pipeline.brief import BRIEF, at_low_resolution
from rakelight.pipeline.guarded import estimated, surface
from rakelight.prepare import Prepared, prepare

# The error that two thirds of the pixels are within, over the median expected one at low
# resolution: its 10th and 90th percentile on random captures 720 to 789.  Of 790 to 839, which
# were not looked at before, 36 of 45 errors of depth lie within, and 35 of normals
# (benchmarks/check_accuracy.py --seeds 790:840).
DEPTH_RANGE, NORMALS_RANGE = (0.3, 2.2), (0.2, 2.8)
# From so many photographs on another one changes little; with fewer the check advises more.
ENOUGH = 8


def any_lights() -> tuple[NextLight, ...]:
    """The best directions for photographs of a surface that is not known."""
    return next_lights(np.zeros((0, 3)), sphere_normals())


@dataclass(frozen=True)
class Quick:
    """What a quick refinement tells.

    lights : photograph's name -> (3,) unit vector towards its lamp, camera frame
    odd : names of the photographs that were left out, as the others do not explain them
    next_lights : the best directions for further photographs
    refusal : why the method does not take the capture
    """

    findings: tuple[Finding, ...] = ()
    lights: Mapping[str, Floats] = field(default_factory=dict)
    odd: tuple[str, ...] = ()
    next_lights: tuple[NextLight, ...] = field(default_factory=any_lights)
    accuracy: Accuracy | None = None
    refusal: InputError | None = None


def quick_options(method: Method) -> Any:
    """The options to refine with quickly."""
    return BRIEF if method.options is MultiLight else method.options()


def quickly_refined(capture: Capture) -> Quick:
    """Refine a capture, whose photographs have names of their own, at low resolution."""
    method = load_method(choose_method(capture))
    options = quick_options(method)
    try:
        prepared = prepare(at_low_resolution(capture))
        with solving(capture):
            used, estimate = estimated(method, prepared, options)
    except InputError as error:
        code = "too-few-photographs" if isinstance(error, MethodError) else "no-surface"
        return Quick((refused_finding(code, error),), refusal=error)
    _, normals = surface(used, estimate)
    seen = used.mask & np.isfinite(normals).all(axis=-1)
    lights = {
        name: vector
        for name, vector in zip(used.names, estimate.lights.vector.mean(axis=1), strict=False)
        if np.isfinite(vector).all() and np.linalg.norm(vector) > 0
    }
    vectors = np.array(list(lights.values())).reshape(-1, 3)
    directions = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    coming = next_lights(vectors, normals[seen]) if lights else any_lights()
    # The method's notes tell how it refined, quickly, which is of no use before refining.
    findings = [each for each in estimate.findings if each.severity == "warning"]
    findings += few_photographs(len(capture.photographs))
    if len(directions) > 2:
        findings += low_light_findings(directions, normals[seen])
        findings += next_light_findings(directions, coming)
    return Quick(
        findings=tuple(findings),
        lights=dict(zip(lights, directions, strict=True)),
        odd=tuple(name for name in prepared.names if name not in used.names),
        next_lights=coming,
        accuracy=_accuracy(used, estimate),
    )


def few_photographs(count: int) -> tuple[Finding, ...]:
    """What to say of few photographs that can be refined.

    >>> [finding.code for finding in few_photographs(4) + few_photographs(12)]
    ['few-photographs']
    """
    remedy = "take 12 or more, with the lamp all around the object, the camera fixed"
    if count >= ENOUGH or count == 1:  # of one the method warns
        return ()
    message = f"{count} photographs: more would average out noise and shadows"
    return (Finding("note", "few-photographs", message, remedy),)


def _accuracy(prepared: Prepared, estimate: Estimate) -> Accuracy | None:
    """Ranges from the medians of the expected errors; None where the method gives none."""
    depth_m, normals_deg = estimate.depth_sigma, estimate.normal_sigma
    if depth_m is None or normals_deg is None:
        return None
    depth_mm = 1000 * float(np.median(depth_m[prepared.mask]))
    angle = min(float(np.median(normals_deg[prepared.mask])), float(np.degrees(UNDETERMINED_RAD)))
    return Accuracy(
        (DEPTH_RANGE[0] * depth_mm, DEPTH_RANGE[1] * depth_mm),
        (NORMALS_RANGE[0] * angle, NORMALS_RANGE[1] * angle),
    )
