"""Is this capture any good, before anybody waits: every check of it, and a quick refinement.

The checks of `rakelight.check` run on the capture as it is; the method runs at low resolution,
which tells the lights, the photographs that do not fit, and what accuracy to expect.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from rakelight.capture.arrays import checked_capture
from rakelight.check.camera_motion import motion_finding, stood_still
from rakelight.check.depth_checks import DEPTH_CHECKS
from rakelight.check.depth_quality import DepthQuality, depth_quality
from rakelight.check.exposure import Exposure, exposure, exposure_findings
from rakelight.check.next_lights import light_findings, next_lights, sphere_normals
from rakelight.check.sharpness import blurred_ones, edge_widths, sharpness_findings
from rakelight.checkup.quick import Quick, quickly_refined, some_maps
from rakelight.checkup.report import CheckReport, PhotographCheck
from rakelight.checkup.verdict import judged, ordered, refused_finding
from rakelight.errors import CaptureError, InputError
from rakelight.methods import choose_method
from rakelight.model import Array, Capture, Finding, Floats
from rakelight.prepare.undistort import undistorted

# From so many photographs on another one changes little; with fewer the check advises more.
ENOUGH = 8
# The reader's findings that are said in other words here.
REPLACED = ("saturated", "black")


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
    capture = replace(capture, names=_names(capture))
    # The checks run no kernel of ours, so they may run beside the method, which does.
    with ThreadPoolExecutor(1) as beside:
        checks = beside.submit(_checked, capture)
        quick = quickly_refined(capture)
        found = checks.result()
    findings = [each for each in capture.findings if each.code not in REPLACED]
    findings += [*found.findings, *_exposed(capture, found.exposed)]
    refusal: InputError | None = found.refusal
    coming = next_lights(np.zeros((0, 3)), sphere_normals())
    if refusal is None:
        refusal = quick.refusal
        findings += [*quick.findings, *_few(len(capture.photographs), refusal)]
        if quick.lights:
            vectors = np.array(list(quick.lights.values()))
            coming = next_lights(vectors, quick.normals)
            if len(vectors) > 2:
                findings += light_findings(_unit(vectors), coming)
    in_order = ordered(findings)
    verdict, headline, why = judged(in_order, refusal)
    return CheckReport(
        verdict=verdict,
        headline=headline,
        findings=in_order,
        photographs=_photographs(capture, found, quick),
        method=choose_method(capture),
        depth=found.depth,
        accuracy=None if refusal is not None else quick.accuracy,
        next_lights=coming,
        refusal=why,
        source=capture.source,
        timings_s={"check": perf_counter() - began},
    )


@dataclass(frozen=True)
class _Checked:
    """What the checks say of a capture, without refining it."""

    exposed: Exposure
    edge_px: Floats
    shift_px: Floats
    moved: Array
    depth: DepthQuality | None
    findings: tuple[Finding, ...]
    refusal: CaptureError | None


def _checked(capture: Capture) -> _Checked:
    exposed, edge_px = exposure(capture), edge_widths(capture)
    shift_px, moved = stood_still(capture)
    findings = [*motion_finding(capture, shift_px, moved)]
    findings += sharpness_findings(capture.names, edge_px)
    refusal, depth = None, None

    def quality(capture: Capture) -> tuple[Finding, ...]:
        nonlocal depth
        depth, said = depth_quality(some_maps(capture))
        return said

    checks: dict[str, Callable[[Capture], tuple[Finding, ...]]] = {
        **DEPTH_CHECKS, "no-depth": quality,
    }  # fmt: skip
    for code, check in checks.items():
        try:
            findings += check(capture)
        except CaptureError as error:
            findings.append(refused_finding(code, error))
            refusal = refusal or error
    return _Checked(exposed, edge_px, shift_px, moved, depth, tuple(findings), refusal)


def _names(capture: Capture) -> tuple[str, ...]:
    """A name of its own for every photograph."""
    if len(set(capture.names)) == len(capture.photographs):
        return capture.names
    return tuple(f"photograph {i}" for i in range(len(capture.photographs)))


def _exposed(capture: Capture, exposed: Exposure) -> tuple[Finding, ...]:
    """Warnings about exposure; the reader's notes about it where there is nothing to warn of."""
    found = exposure_findings(capture.names, exposed)
    return found or tuple(each for each in capture.findings if each.code in REPLACED)


def _few(count: int, refusal: InputError | None) -> tuple[Finding, ...]:
    """What to say of few photographs.

    >>> [finding.code for finding in _few(4, None) + _few(12, None)]
    ['few-photographs']
    """
    remedy = "take 12 or more, with the lamp all around the object, the camera fixed"
    if refusal is not None or count >= ENOUGH or count == 1:  # of one the method warns
        return ()
    message = f"{count} photographs: more would average out noise and shadows"
    return (Finding("note", "few-photographs", message, remedy),)


def _unit(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, np.finfo(float).tiny))


def _photographs(capture: Capture, found: _Checked, quick: Quick) -> tuple[PhotographCheck, ...]:
    exposed, blurred = found.exposed, blurred_ones(found.edge_px)
    rows = []
    for i, name in enumerate(capture.names):
        shift = found.shift_px[i]
        marks = []
        if found.moved[i]:
            marks.append(f"moved by {np.hypot(*shift):.1f} px")
        if exposed.over[i]:
            marks.append("over-exposed")
        if exposed.under[i]:
            marks.append("under-exposed")
        if blurred[i]:
            marks.append("blurred")
        if name in quick.odd:
            marks.append("does not fit the others")
        light = quick.lights.get(name)
        rows.append(
            PhotographCheck(
                name=name,
                saturated=float(exposed.saturated[i]),
                black=float(exposed.black[i]),
                brightness=float(exposed.brightness[i]),
                edge_px=float(found.edge_px[i]) if np.isfinite(found.edge_px[i]) else None,
                shift_px=(float(shift[0]), float(shift[1])) if np.isfinite(shift).all() else None,
                light=None if light is None else _unit(light),
                marks=tuple(marks),
            )
        )
    return tuple(rows)


__all__ = ["CheckReport", "PhotographCheck", "check_capture"]
