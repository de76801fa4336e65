"""Findings about a photograph under three coloured lights."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from rakelight.model import SATURATED, Finding, Floats
from rakelight.prepare import Prepared

# Limits of the findings: angle between two lights; median of a channel over the brightest's; range
# of the channels' means over their mean; fraction of saturated values.
CLOSEST_DEG, DARK, EQUAL_MEANS, MANY_SATURATED = 30.0, 0.05, 0.02, 0.01


def dark_channels(image: Floats) -> list[int]:
    """Which channels of the picture (P, 3) are dark on the object."""
    level = np.median(image, axis=0)
    return [c for c in range(3) if level[c] < DARK * level.max()]


def rgb_findings(prepared: Prepared, image: Floats, light: Floats) -> tuple[Finding, ...]:
    """Findings about the picture (P, 3) and its lights (3, 4)."""
    findings = []
    names, level = ("red", "green", "blue"), np.median(image, axis=0)
    dark = dark_channels(image)
    for c in dark:
        message = f"the {names[c]} channel is dark ({level[c]:.3f} of white): the depth is kept"
        remedy = f"switch the {names[c]} lamp on, or move it nearer; coloured paint needs more"
        findings.append(Finding("warning", "channel-dark", message, remedy))
    toward = light[:, :3] / np.maximum(np.linalg.norm(light[:, :3], axis=1), 1e-12)[:, None]
    for c, d in combinations(range(3), 2):
        apart = float(np.degrees(np.arccos(np.clip(toward[c] @ toward[d], -1, 1))))
        if apart < CLOSEST_DEG and not {c, d} & set(dark):
            message = f"the {names[c]} and the {names[d]} lamp are {apart:.0f} degrees apart"
            remedy = (
                "set the lights around the camera, 120 degrees from each other, 40 off its axis"
            )
            findings.append(Finding("warning", "leds-close", message, remedy))
    mean = image.mean(axis=0)
    if np.ptp(mean) < EQUAL_MEANS * mean.mean():
        message = "the three channels are equally bright, as automatic white balance makes them"
        remedy = "fix the camera's white balance: its gains change with what is in view"
        findings.append(Finding("warning", "white-balance", message, remedy))
    values = prepared.photographs[0][prepared.mask]
    saturated = float((values >= SATURATED * np.iinfo(values.dtype).max).mean())
    if saturated > MANY_SATURATED:
        message = f"{100 * saturated:.1f} % of the object's values are saturated"
        remedy = "lower the exposure; against highlights, set polarisers before lights and camera"
        findings.append(Finding("warning", "highlights", message, remedy))
    return tuple(findings)
