"""What is said first: the order of findings, and the verdict."""

from __future__ import annotations

from collections.abc import Iterable

from rakelight.checkup.report import Verdict
from rakelight.errors import InputError
from rakelight.model import Finding

# The order in which findings are said.  First what makes the others meaningless; then the cause
# before its effects: a photograph that moved does not fit the others either.
ORDER = (
    "depth-turned",
    "depth-inside-out",
    "depth-shifted",
    "too-few-photographs",
    "no-surface",
    "few-lights",
    "one-lamp-position",
    "camera-moved",
    "overexposed",
    "underexposed",
    "blurred",
    "photographs-say-nothing",
    "odd-photographs",
    "single-photograph",
    "depth-unit",
    "depth-holes",
    "holes-left-out",
    "lights-in-one-plane",
    "lights-on-one-side",
    "dark-photographs",
    "few-photographs",
)
# With these the result is the depth as it was, or little else.
NOTHING_GAINED = ("few-lights", "one-lamp-position", "photographs-say-nothing")


def ordered(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Warnings before notes, each in the order of `ORDER`; of one code the first alone.

    >>> note, warning = Finding("note", "blurred", ""), Finding("warning", "depth-unit", "")
    >>> [finding.code for finding in ordered([note, warning, note])]
    ['depth-unit', 'blurred']
    """
    rank = {code: i for i, code in enumerate(ORDER)}
    once: dict[str, Finding] = {}
    for finding in sorted(
        findings, key=lambda f: (f.severity != "warning", rank.get(f.code, len(rank)))
    ):
        once.setdefault(finding.code, finding)
    return tuple(once.values())


def judged(
    findings: tuple[Finding, ...], refusal: InputError | None
) -> tuple[Verdict, str, InputError | None]:
    """The verdict, its line, and why the capture cannot be refined, if so.

    findings : ordered

    >>> judged((), None)[:2]
    ('good', 'good')
    >>> judged((Finding("warning", "blurred", "blurred: 3.png"),), None)[1]
    'usable, with 1 warning; blurred: 3.png'
    """
    if refusal is not None:
        return "not usable", f"not usable because {refusal.what}", refusal
    for finding in findings:
        if finding.code in NOTHING_GAINED:
            why = InputError(finding.message, remedy=finding.remedy)
            return "not usable", f"not usable because {finding.message}", why
    warnings = [finding for finding in findings if finding.severity == "warning"]
    if not warnings:
        return "good", "good", None
    count = f"{len(warnings)} warning{'s' if len(warnings) > 1 else ''}"
    return "usable", f"usable, with {count}; {warnings[0].message}", None


def refused_finding(code: str, error: InputError) -> Finding:
    """What made the capture unusable, as a finding."""
    message = error.what + (f" (seen {error.seen})" if error.seen else "")
    return Finding("warning", code, message, error.remedy)
