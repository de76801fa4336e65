"""How each photograph is exposed: what is saturated, black, or so dark that noise hides it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.capture.validate import exposure_shares
from rakelight.check.measured import Measured
from rakelight.errors import listed
from rakelight.model import Capture, Finding, Floats, Mask
from rakelight.prepare.linear import to_linear

# Pixels of the object that are looked at: shares are right to half a per cent.
SAMPLE_PIXELS = 20_000
# Share of the object with a saturated channel above which a photograph is over-exposed.  Values
# that are left out cost little as long as other photographs hold them: the mitten, with 26 % in its
# worst photograph and 15 % on average, is refined well.  With 40 % saturated over all photographs 8
# of 19 random draws have normals worse by a tenth, with 20 % 3 of 19 (ablation.md).
OVEREXPOSED = 0.4
# Linear light of the object's brighter part (its 90th percentile, brightest channel), white = 1,
# below which a photograph is under-exposed: 8-bit steps are then 4 % of what a shaded pixel has.
# Those steps alone cost nothing down to here: normals 0.99 times as far off, at 0.02 1.06 times
# (ablation.md); noise, which is larger in dark photographs, is not in that figure.
UNDEREXPOSED, BRIGHT_PART = 0.06, 0.9
# Share of the object that is black, above which a photograph shows too little of it.  With the
# darkest 40 % black in all photographs 36 of 51 random draws have normals worse by a tenth, with
# 60 % 39; as they are, no photograph of these draws has more than 17 % (ablation.md).
BLACKENED = 0.3


@dataclass(frozen=True, slots=True)
class Exposure:
    """Of every photograph: (N,) shares of the object that are saturated and black, brightness.

    brightness : linear light of the object's brighter part, white = 1
    """

    saturated: Floats
    black: Floats
    brightness: Floats

    @property
    def over(self) -> Mask:
        """(N,) over-exposed."""
        return self.saturated > OVEREXPOSED

    @property
    def under(self) -> Mask:
        """(N,) under-exposed."""
        return ~self.over & ((self.brightness < UNDEREXPOSED) | (self.black > BLACKENED))


def exposure(capture: Capture) -> Exposure:
    """How the photographs of a capture are exposed on its object."""
    inside = np.flatnonzero(capture.mask)
    chosen = inside[:: max(len(inside) // SAMPLE_PIXELS, 1)]
    values = capture.photographs.reshape(len(capture.photographs), -1, 3)[:, chosen]
    saturated, black, _ = exposure_shares(values[:, None], np.ones((1, len(chosen)), bool))
    light = to_linear(values, capture.encoding).max(axis=-1)
    return Exposure(np.array(saturated), np.array(black), np.quantile(light, BRIGHT_PART, axis=1))


def exposure_findings(measured: Measured) -> tuple[Finding, ...]:
    """Warnings about over- and under-exposed photographs."""
    found, findings = measured(exposure), []
    over, under = found.over, found.under
    if over.any():
        message = (
            f"over-exposed: {listed(measured.names, over)}, up to "
            f"{found.saturated[over].max():.0%} of the object saturated"
        )
        remedy = "expose shorter, or hold the lamp farther away, and take these again"
        findings.append(Finding("warning", "overexposed", message, remedy))
    if under.any():
        brightness, black = found.brightness[under].min(), found.black[under].max()
        how = (
            f"the object's brighter part at {brightness:.1%} of white"
            if brightness < UNDEREXPOSED
            else f"up to {black:.0%} of the object black"
        )
        remedy = "expose longer, or hold the lamp closer, and take these again"
        message = f"under-exposed: {listed(measured.names, under)}, {how}"
        findings.append(Finding("warning", "underexposed", message, remedy))
    return tuple(findings)
