"""Polycam's raw data: keyframes/images, keyframes/depth, keyframes/cameras, keyframes/confidence.

Facts: github.com/PolyCam/polyform, polyform/core/capture_folder.py.  Files are named by
microseconds.  Depth is in millimetres, 256x192; confidence is 0, then 54 or 127, and 255.  The JSON
of a frame has fx, fy, cx, cy for its width and height, and t_00 to t_23, the rows of the camera's
place.  Images and poses that Polycam corrected are left alone: they are of a phone that went round.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rakelight.capture.readers.base import Reader
from rakelight.capture.readers.depth_place import recording_of_one_view
from rakelight.capture.readers.image_files import (
    color_stream,
    depth_stream,
    numbered_files,
)
from rakelight.capture.readers.numbers import number_in
from rakelight.capture.readers.tracked_frames import (
    facts_of,
    middle_camera,
    poses_of,
)
from rakelight.capture.readers.tracking import Poses, reading_by
from rakelight.capture.recording import Recording
from rakelight.errors import CaptureError

_PER_METRE, _PER_SECOND = 1000.0, 1e6
_FOLDERS = ("images", "depth", "cameras")
_PLACE = [f"t_{row}{column}" for row in range(3) for column in range(4)]


def sniff(path: Path) -> bool:
    """Whether it holds the folders, and a frame whose JSON has Polycam's pose."""
    root = _root(path)
    if not all((root / name).is_dir() for name in _FOLDERS):
        return False
    first = next(iter(sorted((root / "cameras").glob("*.json"))), None)
    if first is None:
        return False
    with first.open("rb") as file:
        return b'"t_00"' in file.read(10_000)


def _root(path: Path) -> Path:
    """The folder keyframes: in the one that is named, or itself."""
    return path / "keyframes" if (path / "keyframes").is_dir() else path


def recording(path: Path) -> tuple[Recording, Poses | None]:
    """The recording in a folder."""
    root = _root(path)
    images, maps = (numbered_files(root, name, alone=True) for name in ("images", "depth"))
    facts = facts_of(root, numbered_files(root, "cameras", (".json",), alone=True))
    beside = (root / "confidence").is_dir()
    sure = numbered_files(root, "confidence", alone=True) if beside else {}
    shown = [number for number in images if number in facts]
    if not shown:
        raise CaptureError(
            "no image has a camera of its number", source=f"{root}/cameras",
            seen=f"{len(facts)} cameras, {len(images)} images",
            remedy="export the raw data again, whole",
        )  # fmt: skip
    names = [images[number] for number in shown]
    color, color_findings = color_stream(root, names, np.array(shown) / _PER_SECOND)
    confidence = {i: sure[number] for i, number in enumerate(maps) if number in sure}
    moments = np.array(list(maps)) / _PER_SECOND
    depth = depth_stream(root, list(maps.values()), moments, _PER_METRE, confidence)
    lengths = (_lengths(facts[number], color.shape) for number in shown)
    camera = middle_camera(lengths, color.shape, f"{root}/cameras")
    made = recording_of_one_view(
        path,
        camera,
        color,
        depth,
        depth_source=f"{root}/depth",
        names=names,
        findings=color_findings,
        beside=("confidence",),
    )
    return made, poses_of([_number(facts[n].get(key)) for key in _PLACE] for n in shown)


def _lengths(facts: Mapping[str, Any], shape: tuple[int, int]) -> list[float | None]:
    """fx, fy, cx, cy of a frame for images (height, width) = `shape`; None for what is not said."""
    found = [_number(facts.get(key)) for key in ("fx", "fy", "cx", "cy")]
    height, width = (_number(facts.get(key)) for key in ("height", "width"))
    if None in found or not height or not width:
        return found
    down, across = shape[0] / height, shape[1] / width
    fx, fy, cx, cy = (each or 0.0 for each in found)
    return [fx * across, fy * down, (cx + 0.5) * across - 0.5, (cy + 0.5) * down - 0.5]


def _number(value: object) -> float | None:
    return number_in(value, -1e9, 1e9)


READER = Reader(
    "polycam",
    "Polycam's raw data: keyframes/images, keyframes/depth, keyframes/cameras",
    sniff,
    reading_by(recording),
)
