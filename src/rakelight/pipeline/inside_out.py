"""Whether depth whose outline says that it is inside out is refused: what the photographs say.

A recess with a side wall and inverted depth of a solid have the same outline.  Under a moving lamp
the photographs tell them apart, by its distance, by the perspective and by shadows: the capture is
refined quickly with its depth and with its depth inverted, and the better of the two predicts
photographs better.  Under distant lamps the two are nearly as good (the bas-relief ambiguity).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from rakelight.check.evidence import FEWEST
from rakelight.check.inside_out import outline_of
from rakelight.check.measured import Measured
from rakelight.errors import CaptureError, InputError
from rakelight.methods import load_method
from rakelight.model import Capture, Finding, Floats, silent
from rakelight.pipeline.guarded import surface
from rakelight.pipeline.prediction import prediction_errors
from rakelight.prepare import Prepared, prepare

# Least ratio of the inverted surface's errors to the other one's, typical of the photographs, for
# them to deny that depth is inside out where the outline could hardly be a recess's.  Under lamps
# at 0.3 m it is 1.5 to 9 for sound depth.
DENIED = 1.5


def refuse_inverted(measured: Measured, findings: Iterable[Finding]) -> None:
    """Raise CaptureError where the outline is sure that depth is inside out, unless denied.

    Most photographs deny it where they fit the depth as it is better than inverted; clearly, where
    what surrounds the object is nearer by more than its width.  The outline alone decides where
    they are too few.
    """
    suspicion = next((each for each in findings if each.code == "depth-inside-out"), None)
    outline = measured(outline_of)
    if suspicion is None or outline is None or not outline.falls_and_jumps:
        return
    figures = log_ratios(measured.capture)
    typical = float(np.nanmedian(figures)) if np.isfinite(figures).any() else 0.0
    least = float(np.log(DENIED)) if outline.deeper_than_wide else 0.0
    if typical > least:
        return
    seen = "depth that falls towards the outline, and what lies beyond is nearer"
    if typical < 0:
        seen += "; the photographs fit it better inverted"
    raise CaptureError(
        "the depth is inside out: disparity taken for depth?",
        source=measured.capture.source,
        seen=seen,
        remedy=suspicion.remedy,
    )


def log_ratios(capture: Capture) -> Floats:
    """Log of each photograph's error with inverted depth over that with the depth as it is.

    (N,); empty where that cannot be told: too few photographs, or no surface.
    """
    nothing = np.zeros(0)
    if len(capture.photographs) < FEWEST:
        return nothing
    from rakelight.pipeline import solving
    from rakelight.pipeline.brief import BRIEF, at_low_resolution

    try:
        small = at_low_resolution(capture)
        prepared = prepare(small)
        middle_m = float(np.median(prepared.depth_m[prepared.mask]))
        inverted = replace(small, depth_m=np.float32(middle_m**2) / small.depth_m)
        with solving(capture):
            given, other = (_errors(each, BRIEF) for each in (prepared, prepare(inverted)))
            return np.asarray(np.log(other / given))
    except InputError:  # no surface explains one of the two
        return nothing


def _errors(prepared: Prepared, options: Any) -> Floats:
    """(N,) errors of the photographs' predictions after a quick refinement."""
    estimate = load_method("multi-light").run(prepared, options, silent)
    return np.array(prediction_errors(prepared, *surface(prepared, estimate), estimate.lights))
