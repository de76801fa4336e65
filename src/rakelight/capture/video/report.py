"""What a person should know about the frames of a recording: taken, dropped, and what to do."""

from __future__ import annotations

import numpy as np

from rakelight.capture.video.frames import Frames
from rakelight.capture.video.judging import Reasons
from rakelight.capture.video.light import Explained
from rakelight.errors import CaptureError
from rakelight.model import Finding, Floats, Mask

# What helps against each reason.
REMEDIES = {
    "over-exposed": "expose shorter, with a fixed exposure, or move the lamp away",
    "too dark": "expose longer, or move the lamp closer",
    "camera or object moved": "fix the camera, and touch neither it nor the object or the table",
    "something before the object": "hold the lamp from the side or from behind the camera",
    "blurred": "fix focus and exposure, and do not touch the camera",
}
# Photographs at the least.
FEWEST = 3
# Root mean square of the light's changes over its mean, below which no lamp was moved, and below
# which it hardly was.  Of 6 synthetic videos: a lamp that stands still 0.002 to 0.003, and up to
# 0.023 as JPEG of quality 75; one that is moved round 0.13 to 0.88.
UNCHANGED, HARDLY = 0.03, 0.08
# Least change of the brightness, from frame to frame of the same light, that is auto exposure's; of
# 6 videos without it at most 0.023, of 6 that changed slowly by 10 % more than 0.03 in three.
FLICKER = 0.03
# Largest change of the light's direction, over its length, that is the same light.
ALL_ALIKE = 0.02


def require_enough(source: str, frames: Frames, reasons: Reasons, needed: int = FEWEST) -> None:
    """Raise CaptureError where fewer than `needed` frames are left, with why the others are not."""
    counts = {name: int(these.sum()) for name, these in reasons.items() if these.any()}
    left = len(frames) - sum(counts.values())
    if left >= needed:
        return
    why = ", ".join(f"{name} {count}" for name, count in counts.items())
    worst = max(counts, key=lambda name: counts[name]) if counts else ""
    raise CaptureError(
        "too few frames of it can be used",
        source=source,
        seen=f"{left} of {len(frames)}" + (f" ({why})" if why else ""),
        needed=f"{needed}, each under another light",
        remedy=REMEDIES.get(worst, "record 10 to 30 seconds while the lamp is moved round"),
    )


def require_changing_light(source: str, frames: Frames, variation: float) -> None:
    """Raise CaptureError where all frames show one light.

    variation : from `light_variation`
    """
    during = f"{frames.times_s[-1]:.1f} s" if frames.timed else f"{len(frames)} frames"
    if variation < UNCHANGED:
        raise CaptureError(
            "the light never changes",
            source=source,
            seen=f"changes of {variation:.1%} in {during}",
            needed="a lamp that is moved round the object",
            remedy="record while the lamp is moved, the other lights off",
        )


def light_variation(light: Explained, kept: Mask) -> float:
    """Root mean square of the changes of the kept frames' light, over the mean light."""
    lights = light.coefficients[kept]
    middle = lights.mean(axis=0)
    off = np.sqrt(np.mean(np.sum((lights - middle) ** 2, axis=1)))
    return float(off / max(float(np.linalg.norm(middle)), 1e-9))


def findings_of(
    frames: Frames, light: Explained, reasons: Reasons, groups: list[list[int]], names: list[str]
) -> tuple[Finding, ...]:
    """How many frames were read, taken and dropped; each reason with those it dropped."""
    averaged = sum(map(len, groups))
    message = f"{len(groups)} photographs of {len(frames)} frames"
    if averaged > len(groups):
        message += f", averaged from {averaged}"
    found = [Finding("note", "frames-taken", message, "contact-sheet.png shows them")]
    for name, these in reasons.items():
        if these.any():
            when = _when(these, _shown(frames, names))
            text = f"{name}: {int(these.sum())} of {len(frames)} frames were dropped ({when})"
            many = these.mean() > 0.25
            code = "frames-" + name.replace(" ", "-")
            found.append(Finding("warning" if many else "note", code, text, REMEDIES[name]))
    kept = ~np.any(list(reasons.values()), axis=0)
    variation = light_variation(light, kept)
    if variation < HARDLY:
        text = f"the lamp hardly moved: its light changes by {variation:.1%}"
        remedy = "move the lamp round the object, on all sides of it"
        found.append(Finding("warning", "lamp-hardly-moved", text, remedy))
    flicker = exposure_changes(light.brightness, light.coefficients, kept)
    if flicker > FLICKER:
        text = (
            f"the exposure changed by up to {flicker:.0%} from frame to frame, and was evened out"
        )
        found.append(Finding("note", "auto-exposure", text, "fix the exposure before recording"))
    return tuple(found)


def exposure_changes(brightness: Floats, lights: Floats, kept: Mask) -> float:
    """Largest usual change (90th percentile) of the brightness where the light stayed the same."""
    both = kept[1:] & kept[:-1]
    direction = lights / np.maximum(np.linalg.norm(lights, axis=1, keepdims=True), 1e-9)
    same = both & (np.linalg.norm(np.diff(direction, axis=0), axis=1) < ALL_ALIKE)
    if not same.any():
        return 0.0
    change = np.abs(np.diff(np.log(np.maximum(brightness, 1e-6))))[same]
    return float(np.expm1(np.quantile(change, 0.9)))


def _shown(frames: Frames, names: list[str]) -> list[str]:
    """What the frames are called in spans: their times, or their names where none are stated."""
    return [f"{t:.1f} s" for t in frames.times_s] if frames.timed else names


def _when(these: Mask, shown: list[str]) -> str:
    """Which frames, as spans of what is shown of each.  The first few of many.

    >>> _when(np.array([0, 1, 1, 0, 0, 1], bool), ["0.0 s", "0.1 s", "0.2 s", *"def"])
    '0.1 to 0.2 s, f'
    >>> _when(np.array([1, 1, 0, 0, 1], bool), ["a.png", "b.png", "c.png", "d.png", "e.png"])
    'a.png to b.png, e.png'
    """
    numbers = np.flatnonzero(these)
    spans = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    ends = [(shown[span[0]], shown[span[-1]]) for span in spans]
    words = [a if a == b else f"{a.removesuffix(' s')} to {b}" for a, b in ends]
    return ", ".join(words[:4]) + (f" and {len(words) - 4} more" if len(words) > 4 else "")
