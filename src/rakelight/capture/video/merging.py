"""Frames of one lamp position into one photograph: what noise and compression did is averaged."""

from __future__ import annotations

import numpy as np

from rakelight.capture.listing import allocate
from rakelight.capture.recording import Recording, nearest
from rakelight.capture.video.frames import Frames
from rakelight.capture.video.light import Explained
from rakelight.errors import CaptureError
from rakelight.model import SATURATED, Array, Floats, Progress, ProgressCallback
from rakelight.prepare.linear import linear_table

WHITE = 65535
# Frames that are averaged at most: with 16 a quarter of the noise is left.
MOST_AVERAGED = 16
# Largest difference of their light, rms over the brightness.  Under the light of 1 degree further a
# surface at 45 degrees changes by 1.7 %; the mean of two lights is a light again, but for shadows.
SAME_LIGHT = 0.02


def same_light(light: Explained, usable: Array, chosen: list[int]) -> list[list[int]]:
    """For each chosen frame, itself and the usable ones that show the same light, nearest first.

    usable : numbers among the frames; none belongs to two of the chosen
    """
    lights = light.coefficients
    away = np.linalg.norm(lights[usable][:, None] - lights[chosen], axis=-1)
    owner = away.argmin(axis=1)
    groups = []
    for k, own in enumerate(chosen):
        mine = np.flatnonzero((owner == k) & (away[:, k] < SAME_LIGHT))
        order = mine[np.argsort(away[mine, k], kind="stable")]
        others = [int(usable[i]) for i in order if usable[i] != own]
        groups.append([own, *others[: MOST_AVERAGED - 1]])
    return groups


def merged(
    recording: Recording,
    frames: Frames,
    light: Explained,
    groups: list[list[int]],
    progress: ProgressCallback,
) -> Array:
    """(N, H, W, 3) uint16 linear light: the mean of each group, as bright as its first frame.

    Saturated where any of its frames is.
    """
    owner = {int(frames.numbers[i]): k for k, group in enumerate(groups) for i in group}
    scale = {
        int(frames.numbers[i]): float(light.brightness[group[0]] / light.brightness[i])
        for group in groups
        for i in group
    }
    left = [len(group) for group in groups]
    sums: dict[int, Floats] = {}
    photographs = allocate((len(groups), *recording.color.shape, 3), "uint16", recording.source)
    for done, (number, image) in enumerate(recording.color.walk(sorted(owner))):
        k = owner[number]
        added = linear_table(image.dtype, recording.color.encoding).take(image)
        saturated = image >= SATURATED * np.iinfo(image.dtype).max
        added *= scale[number] / len(groups[k])
        added[saturated] = np.inf
        sums[k] = sums[k] + added if k in sums else added
        left[k] -= 1
        if left[k] == 0:
            photographs[k] = np.rint(WHITE * np.minimum(sums.pop(k), 1))
        progress(Progress("average", done + 1, len(owner)))
    if any(left):
        raise CaptureError(
            "frames are missing",
            source=recording.source,
            seen=f"{sum(left)} of {len(owner)} when it was read again",
            needed="a file that does not change while it is read",
            remedy="copy it to this machine first",
        )
    return photographs


def still_depth(
    recording: Recording, frames: Frames, unusable: Array, values: float, most: int
) -> list[int]:
    """Numbers of depth frames, evenly among those taken beside usable colour frames.

    unusable : (N,) bool colour frames with a moved camera, or something before the object
    values : depth values at most in all; most : maps
    """
    times_s = recording.depth.times_s - recording.color.times_s[0]
    beside = nearest(frames.times_s, times_s)
    good = np.flatnonzero(~unusable[beside])
    if not good.size:
        good = np.arange(len(times_s))
    fitting = max(int(values / np.prod(recording.depth.shape)), 1)
    some = np.linspace(0, len(good) - 1, min(len(good), fitting, most)).round().astype(int)
    return [int(i) for i in good[np.unique(some)]]
