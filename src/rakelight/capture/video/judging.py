"""Which frames are dropped, and why."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rakelight.capture.video.frames import Frames
from rakelight.capture.video.light import ALIKE, NEAR_FRAMES, Explained, similar, unlike
from rakelight.capture.video.positions import STILL_PX
from rakelight.model import Floats, Mask

# Largest fraction of the object's pixels with a saturated channel; least brightness, linear light,
# and over the median of the frames.
OVER, DARK, RELATIVELY_DARK = 0.25, 0.01, 0.05
# Sharpness over that of frames under a similar light, and of the frames near in time, below which a
# frame is blurred.
BLURRED = 0.9
# Difference of the light (`unlike`), over it, up to which frames are under a similar light.  As
# others are farther, a frame must differ more from them to be dropped.  Of 0.1 to 0.4, chosen on
# 160 synthetic sets of 20 to 120 frames, three quarters of them single shots, and 120 of 8 to 16
# (seeds 500 to 539): 0.1 keeps 1 % more of the good frames and 10 % more of the blurred ones.
NEAR_LIGHT = 0.15
# The same over its median of all frames, more of which does not count: what blurs a frame or stands
# before the object changes what its light seems to be.  Without it 3 % more of the frames with an
# arm are kept in videos of these; with 1, 1 % more of the good frames are dropped.
MOST_UNLIKE = 2.0
# What does not fit any light, over the pixel's brightness, where something stands before it; the
# least fraction of the object's pixels before which it does.  Chosen on 50 synthetic clips (seeds
# 100 to 149); of 50 others (300 to 349) 97 % of the frames with an arm were dropped, and of those
# without a fault 1.4 % as covered, with the same fraction for all frames.
UNEXPLAINED, COVERED = 0.1, 0.015
# Largest fraction of frames whose place is not known: of more, nothing is said about motion.
UNKNOWN = 0.5

Reasons = Mapping[str, Mask]
"""Why frames are dropped, (N,) each; in the order in which they are said, each frame once."""


def reasons_to_drop(frames: Frames, light: Explained, at_px: Floats) -> Reasons:
    """Which of N frames are dropped, each for one reason.

    at_px : (N, 2) where the picture stands, from `positions`
    """
    far = farness(light)
    found = {
        "over-exposed": frames.saturated > OVER,
        "too dark": frames.brightness
        < max(DARK, RELATIVELY_DARK * float(np.median(frames.brightness))),
        "camera or object moved": _moved(at_px, far),
        "something before the object": covered(light) > COVERED * np.sqrt(far),
        "blurred": _blurred(frames, light, far),
    }
    taken = np.zeros(len(frames), bool)
    for name, these in found.items():
        found[name] = these & ~taken
        taken |= these
    return found


def covered(light: Explained) -> Floats:
    """(N,) the fraction of the object before which something stands."""
    return np.asarray((light.unexplained[:, light.mask] > UNEXPLAINED).mean(axis=1))


def farness(light: Explained) -> Floats:
    """(N,) how far in light others are from each frame, over `NEAR_LIGHT`; at least 1."""
    away = unlike(light.coefficients)
    return np.asarray(np.maximum(np.minimum(away, MOST_UNLIKE * np.median(away)) / NEAR_LIGHT, 1))


def _moved(at_px: Floats, far: Floats) -> Mask:
    """(N,) somewhere else than most frames.

    far : (N,) from `farness`
    """
    away = np.linalg.norm(at_px, axis=1)
    if np.isnan(away).mean() > UNKNOWN:
        return np.zeros(len(away), bool)
    # What cannot be compared to other frames is moved, or lit as no other is.
    unknown = np.isnan(away) | (np.isinf(away) & (far > 1))
    return np.asarray(~unknown & (away > STILL_PX))


def _blurred(frames: Frames, light: Explained, far: Floats) -> Mask:
    """(N,) less sharp than frames under a similar light and than those near in time.

    far : (N,) from `farness`.  Sharpness depends on the light, which may change slowly, or be like
    no other frame's.
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
    return np.asarray(sharpness < BLURRED**far * np.array(usual))
