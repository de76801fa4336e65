"""The table of what `check` says: a row for each finding, in the order in which they are said.

To add one, write its check in a file of its own, and its row here.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal

from rakelight.check.camera_motion import camera_motion
from rakelight.check.depth_edges import depth_edges
from rakelight.check.depth_match import depth_unrelated
from rakelight.check.depth_orientation import depth_orientation
from rakelight.check.depth_quality import depth_findings, one_value
from rakelight.check.depth_shift import depth_shift
from rakelight.check.exposure import exposure_findings
from rakelight.check.inside_out import inside_out
from rakelight.check.inverted_mask import mask_inverted
from rakelight.check.measured import Measured
from rakelight.check.sharpness import sharpness_findings
from rakelight.model import Finding

Check = Callable[[Measured], tuple[Finding, ...]]
Stage = Literal["prepare", "method"]


@dataclass(frozen=True, slots=True)
class Row:
    """Findings of one rank: of these, what was found first is said first.

    check : what finds them, or raises CaptureError where the capture is wrong beyond doubt; None
        where the reader, the preparation or a method says them
    in_refine : the stage of `refine` beside which it runs the check, too: the preparation where the
        check may refuse the capture, which comes before the method then
    nothing_gained : whether the result is then the depth as it was, or little else
    instead_of : codes of findings that say less of the same
    """

    codes: tuple[str, ...]
    check: Check | None = None
    in_refine: Stage | None = None
    nothing_gained: bool = False
    instead_of: tuple[str, ...] = ()


# First what makes the others meaningless; then the cause before its effects: a photograph that
# moved does not fit the others either.  Warnings are said before all notes.
FINDINGS = (
    Row(("mask-inverted",), mask_inverted, in_refine="prepare", instead_of=("depth-unrelated",)),
    Row(("depth-turned",), depth_orientation, in_refine="prepare"),
    Row(("depth-inside-out",), inside_out, in_refine="prepare"),
    Row(("depth-shifted",), depth_shift, in_refine="prepare", instead_of=("depth-unrelated",)),
    Row(("registration-doubtful", "not-registered", "registered")),
    Row(("no-depth",), depth_findings),
    Row(
        ("depth-one-value",), one_value, in_refine="prepare",
        instead_of=(
            "depth-unrelated", "one-lamp-position", "lights-in-one-plane", "lights-on-one-side",
        ),
    ),
    Row(("depth-unrelated",), depth_unrelated, in_refine="prepare"),
    Row(("too-few-photographs", "no-surface")),
    Row(("few-lights", "one-lamp-position")),
    Row(("given-lights-wrong",)),
    Row(
        ("camera-moved",), camera_motion, in_refine="method", instead_of=("depth-unrelated",)
    ),
    Row(("overexposed", "underexposed"), exposure_findings, instead_of=("saturated", "black")),
    Row(("blurred", "out-of-focus"), sharpness_findings),
    Row(("photographs-say-nothing",), nothing_gained=True),
    Row(("odd-photographs",)),
    Row(("single-photograph",)),
    Row(("depth-unit",), depth_findings),
    Row(("off-centre",)),
    Row(("lens-missing",)),
    Row(
        ("depth-blurred", "depth-mixed-with-holes"), depth_edges, in_refine="prepare",
        instead_of=("depth-holes",),
    ),
    Row(("depth-holes",), depth_findings, instead_of=("depth-missing", "holes-carried")),
    Row(("depth-missing",)),
    Row(("holes-left-out",), depth_findings),
    Row(("lights-in-one-plane",)),
    Row(("lights-on-one-side",)),
    Row(("lights-low",)),
    Row(("dark-photographs",)),
    Row(("few-photographs",)),
    # What the reader assumed, changed or left out.
    Row((
        "encoding-contradicted", "exposure-changed",
        "encoding-assumed", "linear-8-bit", "narrow-range", "range-stretched",
        "intrinsics-from-exif", "default-intrinsics", "depth-unit-assumed", "depth-pose-assumed",
        "lights-by-order", "same-view", "depth-camera", "lens-from-file",
        "confidence-applied",
        "ignored-files", "unread-images", "misnamed",
        "jpeg", "compressed", "raw", "grey", "alpha-dropped", "display-p3", "exif-orientation",
        "ambient-subtracted", "flat-divided", "light-scaled", "undistorted",
        "mask-everything", "mask-soft", "no-mask", "median-depth", "phone-moved",
        "frames-taken", "frames-over-exposed", "frames-too-dark", "frames-camera-or-object-moved",
        "frames-something-before-the-object", "frames-blurred", "lamp-hardly-moved",
        "auto-exposure",
    )),
    Row(("holes-carried",), depth_findings),
    Row(("saturated", "black")),
    Row(("too-thin", "channel-dark", "leds-close", "white-balance", "highlights")),
    Row(("next-light",)),
)  # fmt: skip


def checks(in_refine: Stage | None = None) -> dict[Check, str]:
    """The checks, each once, in the order of the table, and the code for what each refuses.

    in_refine : those alone that `refine` runs beside that stage
    """
    found: dict[Check, str] = {}
    for row in FINDINGS:
        if row.check is not None and in_refine in (None, row.in_refine):
            found.setdefault(row.check, row.codes[0])
    return found


def ordered(findings: Collection[Finding]) -> tuple[Finding, ...]:
    """Warnings before notes, each in the order of the table; of one code the first alone.

    Codes that are not in the table, of a reader or method from elsewhere, come last.

    >>> note, warning = Finding("note", "blurred", ""), Finding("warning", "depth-unit", "")
    >>> [finding.code for finding in ordered([note, warning, note])]
    ['depth-unit', 'blurred']
    """
    rank = {code: i for i, row in enumerate(FINDINGS) for code in row.codes}
    once: dict[str, Finding] = {}
    for finding in sorted(
        findings, key=lambda f: (f.severity != "warning", rank.get(f.code, len(rank)))
    ):
        once.setdefault(finding.code, finding)
    for row in FINDINGS:
        if not once.keys().isdisjoint(row.codes):
            for code in row.instead_of:
                once.pop(code, None)
    return tuple(once.values())


def gains_nothing(finding: Finding) -> bool:
    """Whether the result is then the depth as it was, or little else."""
    return any(row.nothing_gained and finding.code in row.codes for row in FINDINGS)
