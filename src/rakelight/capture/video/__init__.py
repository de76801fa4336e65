"""A video of a fixed camera and a lamp that is moved round by hand: its frames to photographs.

The colour stream is walked twice: once for small pictures, from which the frames are chosen, and
once for those that are taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rakelight.capture.listing import check_numbers
from rakelight.capture.recording import PHOTOGRAPHS, Recording
from rakelight.capture.video.choice import most_different
from rakelight.capture.video.contact_sheet import contact_sheet
from rakelight.capture.video.frames import look_through
from rakelight.capture.video.judging import reasons_to_drop
from rakelight.capture.video.light import explained
from rakelight.capture.video.merging import merged, same_light, still_depth
from rakelight.capture.video.positions import positions
from rakelight.capture.video.report import (
    findings_of,
    light_variation,
    require_changing_light,
    require_enough,
)
from rakelight.model import Array, Finding, Floats, ProgressCallback

# Depth maps at most, and depth values in all of them, whose average is made in doubles, sorted
# (estimated 40 bytes for each).
DEPTH_MAPS, DEPTH_VALUES = 48, 10e6


@dataclass(frozen=True)
class Taken:
    """What becomes of a recording.

    photographs : (N, H, W, 3) uint16 linear light; names : (N,) of the frames
    depth_m : (K, h, w) float32 of frames in which all stood still
    """

    photographs: Array
    names: tuple[str, ...]
    depth_m: Floats
    contact_sheet: Array
    findings: tuple[Finding, ...]


def take(recording: Recording, wanted: tuple[int, ...] | None, progress: ProgressCallback) -> Taken:
    """Photographs, depth and contact sheet of a recording.

    wanted : numbers among the photographs, all when None

    Raises CaptureError where too few frames can be used, or the light never changes.
    """
    # 1. small pictures and figures of every frame
    frames = look_through(recording, progress)
    names = [recording.names[i] if recording.names else f"frame {i}" for i in frames.numbers]
    # 2. which frames one light each explains, and where the picture stands in them
    light = explained(frames)
    at_px = positions(frames, light.coefficients, progress)
    # 3. what is wrong with them
    reasons = reasons_to_drop(frames, light, at_px)
    require_enough(recording.source, frames, reasons)
    bad = np.any(list(reasons.values()), axis=0)
    require_changing_light(recording.source, frames, light_variation(light, ~bad))
    # 4. those whose light differs most, with the others of the same light
    usable = np.flatnonzero(~bad)
    chosen = usable[most_different(light.coefficients[usable], PHOTOGRAPHS)].tolist()
    groups = same_light(light, usable, chosen)
    findings = findings_of(frames, light, reasons, groups, names)
    sheet = contact_sheet(frames, groups, reasons, names)
    still = reasons["camera or object moved"] | reasons["something before the object"]
    maps = still_depth(recording, frames, still, DEPTH_VALUES, DEPTH_MAPS)
    if wanted is not None:
        check_numbers(wanted, len(groups))
        groups = [groups[number] for number in wanted]
    # 5. the photographs and the depth themselves
    return Taken(
        photographs=merged(recording, frames, light, groups, progress),
        names=tuple(names[group[0]] for group in groups),
        depth_m=np.stack([depth for _, depth in recording.depth.walk(maps)]),
        contact_sheet=sheet,
        findings=findings,
    )
