"""Is this capture any good, before anybody waits: every check of it, and a quick refinement.

The checks of `rakelight.check` run on the capture as it is; the method runs at low resolution,
which tells the lights, the photographs that do not fit, and what accuracy to expect.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from time import perf_counter

import numpy as np

from rakelight.capture.arrays import checked_capture
from rakelight.check.camera_motion import stood_still
from rakelight.check.depth_quality import depth_quality
from rakelight.check.exposure import exposure
from rakelight.check.findings import checks, ordered
from rakelight.check.measured import Measured
from rakelight.check.sharpness import added_blur, edge_widths
from rakelight.checkup.quick import Quick, any_lights, quick_options, quickly_refined
from rakelight.checkup.report import CheckReport, PhotographCheck
from rakelight.checkup.verdict import judged, refused_finding
from rakelight.errors import CaptureError, InputError
from rakelight.jit import one_blas_thread
from rakelight.methods import choose_method, load_method
from rakelight.model import Capture, Finding, photograph_names
from rakelight.pipeline import pose_corrected
from rakelight.pipeline.inside_out import refuse_inverted
from rakelight.prepare.undistort import undistorted

# Findings beside which no accuracy is foretold: the method's expected errors know nothing of them.
UNFORETOLD = {
    "depth-turned", "depth-inside-out", "depth-shifted", "depth-one-value", "depth-unrelated",
    "out-of-focus",
}  # fmt: skip


def check_capture(capture: Capture) -> CheckReport:
    """Whether a capture is any good, where its lights are, and what to do better.

    It takes a fraction of `refine`'s time.  A capture that `refine` would refuse, or whose
    photographs would change nothing, has the verdict "not usable".

    Raises CaptureError when an array is of another type, shape or range than `Capture` says.

    >>> from rakelight.synthetic import SceneOptions, make_albedo, make_shape, render_scene
    >>> vase = make_shape("vase")
    >>> options = SceneOptions(camera=vase.camera.scaled(0.2), photographs=8)
    >>> report = check_capture(render_scene(vase, make_albedo("pattern"), options)[0])
    >>> report.verdict, len(report.photographs), len(report.next_lights)
    ('good', 8, 3)
    """
    began = perf_counter()
    capture = undistorted(checked_capture(capture))
    with one_blas_thread():
        capture = _posed(replace(capture, names=_names(capture)))
        measured = Measured(capture)
        # Most of the checks runs on one core.
        with ThreadPoolExecutor(1) as beside:
            checked = beside.submit(_checked, measured)
            quick = quickly_refined(capture)
            found, refusal = checked.result()
        if refusal is None:
            found, refusal = _refused_inverted(measured, found)
    if refusal is None:
        refusal, found = quick.refusal, (*found, *quick.findings)
    findings = ordered((*capture.findings, *found))
    verdict, headline, why = judged(findings, refusal)
    foretold = refusal is None and not any(each.code in UNFORETOLD for each in findings)
    return CheckReport(
        verdict=verdict,
        headline=headline,
        findings=findings,
        photographs=_photographs(measured, quick),
        method=choose_method(capture),
        depth=measured(depth_quality)[0],
        accuracy=quick.accuracy if foretold else None,
        next_lights=quick.next_lights if refusal is None else any_lights(),
        refusal=why,
        source=capture.source,
        timings_s={"check": perf_counter() - began},
    )


def _posed(capture: Capture) -> Capture:
    """The capture with its depth camera's pose corrected, where `refine` does that first."""
    method = load_method(choose_method(capture))
    try:
        return pose_corrected(capture, method, quick_options(method))
    except InputError:  # the checks say why it cannot be refined
        return capture


def _checked(measured: Measured) -> tuple[tuple[Finding, ...], InputError | None]:
    """What the checks say of a capture, and why it cannot be refined, if they say so."""
    findings: list[Finding] = []
    refusal = None
    for check, code in checks().items():
        try:
            findings += check(measured)
        except CaptureError as error:
            findings.append(refused_finding(code, error))
            refusal = refusal or error
    return tuple(findings), refusal


def _refused_inverted(
    measured: Measured, findings: tuple[Finding, ...]
) -> tuple[tuple[Finding, ...], InputError | None]:
    """As of `_checked`, after the photographs were asked about depth inside out."""
    try:
        refuse_inverted(measured, findings)
        return findings, None
    except CaptureError as error:
        others = (each for each in findings if each.code != "depth-inside-out")
        return (refused_finding("depth-inside-out", error), *others), error


def _names(capture: Capture) -> tuple[str, ...]:
    """A name of its own for every photograph."""
    if len(set(capture.names)) == len(capture.photographs):
        return capture.names
    return photograph_names((), len(capture.photographs))


def _photographs(measured: Measured, quick: Quick) -> tuple[PhotographCheck, ...]:
    exposed, edge_px = measured(exposure), measured(edge_widths)
    shift_px, moved = measured(stood_still)
    _, blurred = measured(added_blur)
    rows = []
    for i, name in enumerate(measured.names):
        shift = shift_px[i]
        marks = []
        if moved[i]:
            marks.append(f"moved by {np.hypot(*shift):.1f} px")
        if exposed.over[i]:
            marks.append("over-exposed")
        if exposed.under[i]:
            marks.append("under-exposed")
        if blurred[i]:
            marks.append("blurred")
        if name in quick.odd:
            marks.append("does not fit the others")
        rows.append(
            PhotographCheck(
                name=name,
                saturated=float(exposed.saturated[i]),
                black=float(exposed.black[i]),
                brightness=float(exposed.brightness[i]),
                edge_px=float(edge_px[i]) if np.isfinite(edge_px[i]) else None,
                shift_px=(float(shift[0]), float(shift[1])) if np.isfinite(shift).all() else None,
                light=quick.lights.get(name),
                marks=tuple(marks),
            )
        )
    return tuple(rows)


__all__ = ["CheckReport", "PhotographCheck", "check_capture"]
