"""The folder that 3D Scanner App exports as all data: frame_00000.jpg, depth_00000.png, JSON.

Facts: github.com/laanlabs/3dScannerApp_samples, chair_scan.  Depth is in millimetres, 256x192, and
of every frame; photographs, 1920x1440, are of some of them.  conf_00000.png is 0 to 2.  The JSON of
a frame has its time, the intrinsics of the photograph and cameraPoseARFrame, rows first.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rakelight.capture.readers.base import Reader
from rakelight.capture.readers.depth_place import recording_of_one_view
from rakelight.capture.readers.image_files import color_stream, depth_stream
from rakelight.capture.readers.numbers import number_in
from rakelight.capture.readers.tracked_frames import (
    facts_of,
    middle_camera,
    numbers_in,
    poses_of,
    rising_times,
)
from rakelight.capture.readers.tracking import Poses, reading_by
from rakelight.capture.recording import Recording
from rakelight.errors import CaptureError
from rakelight.files import clear_errors
from rakelight.model import Floats

_PER_METRE, _FPS = 1000.0, 60.0
_NAMES = re.compile(r"(frame|depth|conf)_([0-9]{1,9})\.(jpe?g|png|json)", re.IGNORECASE)
_POSE = b'"cameraPoseARFrame"'
_Files = dict[str, dict[int, str]]


def sniff(path: Path) -> bool:
    """Whether it holds depth and a frame whose JSON has the app's pose."""
    if not path.is_dir():
        return False
    files = _files(path)
    if not (files["depth"] and files["photograph"] and files["json"]):
        return False
    with (path / next(iter(files["json"].values()))).open("rb") as file:
        return _POSE in file.read(10_000)


def _files(path: Path) -> _Files:
    """Names of the photographs, depth and confidence maps and JSON files, by their numbers."""
    found: _Files = {"photograph": {}, "depth": {}, "conf": {}, "json": {}}
    for name in sorted(each.name for each in path.iterdir()):
        match = _NAMES.fullmatch(name)
        # An export that was broken off ends with files that nothing was written into.
        if match is None or not (path / name).is_file() or not (path / name).stat().st_size:
            continue
        kind, number, suffix = match[1].lower(), int(match[2]), match[3].lower()
        if kind == "frame":
            kind = {"json": "json", "png": "other"}.get(suffix, "photograph")
        elif suffix != "png":
            kind = "other"
        found.setdefault(kind, {})[number] = name
    return {kind: dict(sorted(names.items())) for kind, names in found.items()}


def recording(path: Path) -> tuple[Recording, Poses | None]:
    """The recording in a folder."""
    with clear_errors(str(path), "cannot be read"):
        files = _files(path)
    facts = facts_of(path, files["json"])
    shown = [number for number in files["photograph"] if number in facts]
    measured = [number for number in files["depth"] if number in facts]
    if not shown or not measured:
        raise CaptureError(
            "no photograph, or no depth, whose frame has its JSON",
            source=str(path),
            seen=f"{len(files['photograph'])} photographs, {len(files['depth'])} depth maps, "
            f"{len(facts)} JSON files",
            needed="frame_00000.jpg, depth_00000.png and frame_00000.json of one number",
            remedy="export the scan again, with all its data",
        )
    names = [files["photograph"][number] for number in shown]
    color, color_findings = color_stream(path, names, _times(facts, shown))
    confidence = {i: files["conf"][n] for i, n in enumerate(measured) if n in files["conf"]}
    maps = [files["depth"][number] for number in measured]
    depth = depth_stream(path, maps, _times(facts, measured), _PER_METRE, confidence)
    matrices = (numbers_in(facts[number].get("intrinsics"), 9) for number in shown)
    lengths = ([matrix[at] for at in (0, 4, 2, 5)] for matrix in matrices)
    camera = middle_camera(lengths, color.shape, str(path))
    made = recording_of_one_view(
        path,
        camera,
        color,
        depth,
        depth_source=f"{path}/{maps[0]}",
        names=names,
        findings=color_findings,
        beside=tuple(files["conf"].values()),
    )
    return made, poses_of(numbers_in(facts[n].get("cameraPoseARFrame"), 12) for n in shown)


def _times(facts: Mapping[int, Mapping[str, Any]], numbers: list[int]) -> Floats:
    """Seconds of some frames."""
    stated = [number_in(facts[number].get("time"), -1e12, 1e12) for number in numbers]
    return rising_times(stated, numbers, _FPS)


READER = Reader(
    "3d-scanner-app",
    "3D Scanner App's folder of all data: frame_00000.jpg, depth_00000.png, JSON",
    sniff,
    reading_by(recording),
)
