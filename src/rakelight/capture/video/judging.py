"""Which frames are dropped, and why."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rakelight.capture.video.frames import Frames
from rakelight.capture.video.light import NEAR_FRAMES, Explained, similar
from rakelight.capture.video.positions import STILL_PX
from rakelight.model import Floats, Mask

# Largest fraction of the object's pixels with a saturated channel; least brightness, linear light,
# and over the median of the frames.
OVER, DARK, RELATIVELY_DARK = 0.25, 0.01, 0.05
# Sharpness over that of frames under a similar light, and of the frames near in time, below which a
# frame is blurred; how many the first are.
BLURRED, ALIKE = 0.9, 15
# The same where there are too few frames for any to be under a similar light, and how far frames
# may then seem to be from where most are, pixels of the detail pictures.
FEW, BLURRED_OF_FEW, STILL_OF_FEW_PX = 20, 0.6, 1.0
# What does not fit any light, over the pixel's brightness, where something stands before it; the
# least fraction of the object's pixels before which it does.  Chosen on 50 synthetic clips (seeds
# 100 to 149); of 50 others (300 to 349) 97 % of the frames with an arm were dropped, and of those
# without a fault 1.4 % as covered.
UNEXPLAINED, COVERED = 0.1, 0.015
# Largest fraction of frames whose place is not known: of more, nothing is said about motion.
UNKNOWN = 0.5

Reasons = Mapping[str, Mask]
"""Why frames are dropped, (N,) each; in the order in which they are said, each frame once."""


def reasons_to_drop(frames: Frames, light: Explained, at_px: Floats) -> Reasons:
    """Which of N frames are dropped, each for one reason.

    at_px : (N, 2) where the picture stands, from `positions`
    """
    found = {
        "over-exposed": frames.saturated > OVER,
        "too dark": frames.brightness
        < max(DARK, RELATIVELY_DARK * float(np.median(frames.brightness))),
        "camera or object moved": _moved(at_px),
        "something before the object": covered(light) > COVERED,
        "blurred": _blurred(frames, light),
    }
    taken = np.zeros(len(frames), bool)
    for name, these in found.items():
        found[name] = these & ~taken
        taken |= these
    return found


def covered(light: Explained) -> Floats:
    """(N,) the fraction of the object before which something stands."""
    return np.asarray((light.unexplained[:, light.mask] > UNEXPLAINED).mean(axis=1))


def _moved(at_px: Floats) -> Mask:
    away = np.linalg.norm(at_px, axis=1)
    farthest_px = STILL_PX if len(away) >= FEW else STILL_OF_FEW_PX
    if np.isnan(away).mean() > UNKNOWN:
        return np.zeros(len(away), bool)
    # Of few frames, what cannot be compared to the others is lit differently, not moved.
    unknown = np.isnan(away) if len(away) >= FEW else ~np.isfinite(away)
    return np.asarray(~unknown & (away > farthest_px))


def _blurred(frames: Frames, light: Explained) -> Mask:
    """(N,) less sharp than frames under a similar light and than those near in time.

    Sharpness depends on the light, which changes slowly and may be like no other frames'.
    """
    count, sharpness = len(frames), frames.sharpness
    if count < 2:
        return np.zeros(count, bool)
    numbers = np.arange(count)
    usual = [
        min(
            np.median(sharpness[similar(light.coefficients, i, 0, ALIKE, 1)]),
            np.median(sharpness[(numbers != i) & (np.abs(numbers - i) <= NEAR_FRAMES)]),
        )
        for i in range(count)
    ]
    least = BLURRED if count >= FEW else BLURRED_OF_FEW
    return np.asarray(sharpness < least * np.array(usual))
