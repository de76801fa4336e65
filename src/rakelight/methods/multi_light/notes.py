"""What a user is told beside the result: the depth's weight, the sensor's blur, lamps and paint."""

from __future__ import annotations

import numpy as np

from rakelight.methods.levels import Level
from rakelight.model import Finding, Floats
from rakelight.photometry.images import LightParameters


def notes_of(
    level: Level, lights: LightParameters, gain: float, weight: float, blur_px: float
) -> list[Finding]:
    """The notes on a fit.

    lights : of the fit, whose albedo is `gain` times as large as it should be
    weight : the depth weight; blur_px : of the sensor, its pixels, 0 for none
    """
    notes = [Finding("note", "depth-weight", f"depth weight {weight:.3g} times white noise's")]
    accounted = "that is taken into account"
    if blur_px:
        over = f"the depth is smoothed, as by a Gaussian of {blur_px:.1f} of its pixels"
        notes.append(Finding("note", "depth-smoothed", f"{over}; {accounted}"))
    if lights.gloss.any():
        height = f"{lights.gloss.sum() / gain:.2f} of white paint's brightness"
        notes.append(Finding("note", "highlights", f"highlights up to {height}"))
    if lights.beam is not None:
        across = 2 * level.radius_m * np.linalg.norm(lights.beam[..., :2], axis=-1)
        loss = 100 * (1 - np.exp(-np.median(across)))
        falls = f"the lamp's light falls off sideways, by {loss:.0f} % across the object (median)"
        notes.append(Finding("note", "narrow-beam", f"{falls}; {accounted}"))
    if lights.ambient_direction.any():
        side = " and ".join(sides_of(lights.ambient_direction))
        room = f"the room's light is {100 * lights.ambient_share:.0f} % of the lamp's"
        notes.append(Finding("note", "room-light", f"{room}, most from {side}; {accounted}"))
    return notes


def sides_of(direction: Floats) -> list[str]:
    """The sides that light comes from, in words, the one it comes from most first.

    direction : (3,) towards the light, camera frame; components below half the largest are left out

    >>> sides_of(np.array([-0.8, 0.1, -0.5]))
    ['the left', 'the camera']
    """
    words = (("the right", "the left"), ("below", "above"), ("behind the object", "the camera"))
    far = np.abs(direction) >= np.abs(direction).max() / 2
    return [words[k][int(direction[k] < 0)] for k in np.argsort(-np.abs(direction)) if far[k]]
