"""The verdict on a capture, from its findings."""

from __future__ import annotations

from rakelight.check.findings import gains_nothing
from rakelight.checkup.report import Verdict
from rakelight.errors import InputError
from rakelight.model import Finding


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
        if gains_nothing(finding):
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
