"""A recording of a fixed camera: streams of colour and depth, and the capture made of them.

A reader says how its file is walked through; which frames become photographs is decided here, the
same for every kind of recording.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rakelight.capture.listing import Root, inside, meant_otherwise, read_mask
from rakelight.capture.readers.base import Reading, Wanted
from rakelight.errors import CaptureError
from rakelight.model import (
    Array,
    Camera,
    Encoding,
    Finding,
    Floats,
    Mask,
    RigidTransform,
    SensorNoise,
)

# Photographs that are made of a recording: within the 10 to 20 that the README asks people to take;
# other numbers were not measured.
PHOTOGRAPHS = 16
_MASK_ALONE = "beside the frames of a recording mask.png alone is read; move the others away"
_MASK_IN_CAPTURE = (
    "`rakelight import` it, and save the object, white on black, as mask.png in the capture folder"
)


@dataclass(frozen=True)
class Stream:
    """The frames of one camera, which are decoded only when they are walked through.

    times_s : (N,) seconds from any start, rising
    shape : (height, width) of every frame
    walk : of numbers of frames from 0, rising: each frame with its number, one at a time.  Colour
        is (H, W, 3) uint8 or uint16 RGB as stored, depth (h, w) float32 metres with NaN = no
        measurement.  What cannot be decoded raises CaptureError.
    encoding : of colour
    timed : whether the times are stated; else they say only in which order the frames follow
    """

    times_s: Floats
    shape: tuple[int, int]
    walk: Callable[[Sequence[int]], Iterator[tuple[int, Array]]]
    encoding: Encoding = "srgb"
    timed: bool = True

    def __len__(self) -> int:
        return len(self.times_s)


@dataclass(frozen=True)
class Recording:
    """Colour and depth of one camera over time, and how they were taken.

    source : for messages
    camera : of the colour frames
    color, depth : their streams; the times of both are on one clock
    depth_camera, depth_to_color : None where depth covers the field of view of the colour frames
    names : of the colour frames, for messages; "frame 12" where empty
    beside : names of what is read in the recording's folder beside frames and mask.png
    """

    source: str
    camera: Camera
    color: Stream
    depth: Stream
    depth_camera: Camera | None = None
    depth_to_color: RigidTransform | None = None
    depth_noise: SensorNoise | None = None
    names: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    beside: tuple[str, ...] = ()


def capture_of(recording: Recording, wanted: Wanted) -> Reading:
    """The capture made of a recording: photographs chosen from its frames, its depth averaged.

    Raises CaptureError where the recording is empty or no capture can be made of it.
    """
    from rakelight.capture.from_arrays import capture_from_arrays
    from rakelight.capture.video import take

    for stream, what in ((recording.color, "colour"), (recording.depth, "depth")):
        if not len(stream):
            raise CaptureError(
                f"no {what} frames in it",
                source=recording.source,
                remedy="record colour and depth together",
            )
    mask, mask_findings = _mask(recording)
    taken = take(recording, wanted.photographs, wanted.progress)
    capture = capture_from_arrays(
        taken.photographs,
        taken.depth_m,
        recording.camera,
        mask=mask,
        encoding="linear",
        lighting="moving-lamp",
        names=taken.names,
        depth_camera=recording.depth_camera,
        depth_to_color=recording.depth_to_color,
        depth_noise=recording.depth_noise,
    )
    findings = (*recording.findings, *taken.findings, *mask_findings, *capture.findings)
    folder = Path(recording.source)
    if folder.is_dir():
        findings += meant_otherwise(Root(folder), ("mask.png", *recording.beside), _MASK_ALONE)
    else:
        findings = tuple(
            replace(f, remedy=_MASK_IN_CAPTURE) if f.code == "no-mask" else f for f in findings
        )
    return Reading(
        replace(capture, findings=findings, source=recording.source), taken.contact_sheet
    )


def _mask(recording: Recording) -> tuple[Mask | None, tuple[Finding, ...]]:
    """mask.png (H, W) of the folder that the recording is, and what is to say of it; else None."""
    folder = Path(recording.source)
    path = folder / "mask.png"
    if not recording.source or not os.path.lexists(path):
        return None, ()
    return read_mask(inside(folder, path.name), str(path), recording.color.shape, ("PNG",))


def nearest(times_s: Floats, moments_s: Floats) -> Array:
    """(M,) which of the rising times (N,) is nearest to each moment (M,), the earlier of two.

    >>> nearest(np.array([0.0, 1.0, 2.0]), np.array([-1.0, 0.5, 1.6])).tolist()
    [0, 0, 2]
    """
    if len(times_s) == 1:
        return np.zeros(len(moments_s), int)
    right = np.clip(np.searchsorted(times_s, moments_s), 1, len(times_s) - 1)
    left = right - 1
    closer = moments_s - times_s[left] <= times_s[right] - moments_s
    return np.asarray(np.where(closer, left, right))


def evenly(count: int, wanted: int) -> list[int]:
    """At most `wanted` of `count` frames, spread evenly from the first to the last.

    >>> evenly(7, 3), evenly(2, 3)
    ([0, 3, 6], [0, 1])
    """
    return sorted(set(np.linspace(0, count - 1, min(count, wanted)).round().astype(int).tolist()))
