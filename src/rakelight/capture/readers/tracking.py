"""Whether a phone stood still while it recorded, by its own tracking."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rakelight.capture.readers.base import Reading, Wanted
from rakelight.capture.recording import Recording, capture_of
from rakelight.model import Camera, Capture, Finding, Floats

# Shift of the picture, over its longer side, from which the phone moved: 10 pixels of 1920.  Less
# is the tracking's own: 1 mm and 0.05 degrees are 4 pixels at half a metre.
MOVED = 0.005


@dataclass(frozen=True)
class Poses:
    """Where a phone was at each frame, by whatever axes.

    positions_m : (N, 3) metres
    quaternions : (N, 4) x, y, z, w; rows that are no unit quaternions are of no known pose
    """

    positions_m: Floats
    quaternions: Floats


def reading_by(
    recording_in: Callable[[Path], tuple[Recording, Poses | None]],
) -> Callable[[Path, Wanted], Reading]:
    """A reader's `read`, of what makes a recording of a path, and a pose of each colour frame."""

    def read(path: Path, wanted: Wanted) -> Reading:
        recording, poses = recording_in(path)
        reading = capture_of(recording, wanted)
        numbers = {name: number for number, name in enumerate(recording.names)}
        moved = None if poses is None else moved_finding(poses, reading.capture, numbers)
        if moved is None:
            return reading
        findings = (*reading.capture.findings, moved)
        return replace(reading, capture=replace(reading.capture, findings=findings))

    return read


def moved_finding(poses: Poses, capture: Capture, numbers: Mapping[str, int]) -> Finding | None:
    """The warning that the phone moved between the photographs, None where it stood still.

    numbers : of the frames by their names, of which the capture has some
    """
    chosen = [numbers[name] for name in capture.names]
    distance_m = float(np.nanmedian(capture.depth_m))
    way_m, angle = _farthest(poses, chosen, capture.camera, distance_m)
    shift_px = _shift_px(way_m, angle, capture.camera, distance_m)
    if not shift_px > MOVED * max(capture.camera.shape):
        return None
    return Finding(
        "warning",
        "phone-moved",
        f"by its own tracking the phone moved by {1000 * way_m:.0f} mm and "
        f"{np.degrees(angle):.1f} degrees, which shifts the picture by up to {shift_px:.0f} pixels",
        "put it on a tripod, or lean it on something; only the lamp may move",
    )


def _farthest(
    poses: Poses, chosen: list[int], camera: Camera, distance_m: float
) -> tuple[float, float]:
    """Metres and radians between the frame that most are near to and the farthest; 0 if unknown."""
    q, place = poses.quaternions[chosen], poses.positions_m[chosen]
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(q, axis=1)
        sound = (np.abs(length - 1) < 0.01) & np.isfinite(place).all(axis=1)
    q, place = q[sound] / length[sound, None], place[sound]
    if len(q) < 2:
        return 0.0, 0.0
    with np.errstate(over="ignore"):
        way_m = np.linalg.norm(place[:, None] - place, axis=-1)
    angle = 2 * np.arccos(np.clip(np.abs(q @ q.T), 0, 1))
    shift = _shift_px(way_m, angle, camera, distance_m)
    middle = int(np.median(shift, axis=1).argmin())
    farthest = int(shift[middle].argmax())
    return float(way_m[middle, farthest]), float(angle[middle, farthest])


def _shift_px(way_m: Floats | float, angle: Floats | float, camera: Camera, distance_m: float):  # type: ignore[no-untyped-def]
    """Pixels that an object at a distance is shifted by, at the most."""
    return max(camera.fx, camera.fy) * (np.asarray(angle) + np.asarray(way_m) / distance_m)
