"""The folder of Open3D's recorders: color/, depth/ and camera_intrinsic.json.

Facts: Open3D, examples/python/reconstruction_system/sensors, realsense_recorder.py (numbers of six
digits, depth aligned to colour) and azure_kinect_mkv_reader.py (five digits, intrinsic.json); and
cpp/open3d/t/io/sensor/RGBDVideoMetadata.cpp, which adds depth_scale (values per metre) and fps.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rakelight.capture.loose_depth import SCALE
from rakelight.capture.readers.base import Reader
from rakelight.capture.readers.beside import texts_beside, values_per_metre
from rakelight.capture.readers.depth_place import recording_of_one_view
from rakelight.capture.readers.image_files import (
    color_stream,
    depth_stream,
    numbered_files,
    read_within,
)
from rakelight.capture.readers.numbers import camera_of, json_table, number_in
from rakelight.capture.readers.tracking import Poses, reading_by
from rakelight.capture.recording import Recording
from rakelight.errors import CaptureError
from rakelight.files import MAX_TEXT_BYTES
from rakelight.model import Camera

INTRINSICS = ("camera_intrinsic.json", "intrinsic.json")
# Depth values per metre, and frames per second, where the file does not say: the recorders' own.
_PER_METRE, _FPS = 1000.0, 30.0


def sniff(path: Path) -> bool:
    """Whether the folder holds color/, depth/ and the intrinsics."""
    folders = (path / "color").is_dir() and (path / "depth").is_dir()
    return folders and any((path / name).is_file() for name in INTRINSICS)


def recording(path: Path) -> tuple[Recording, Poses | None]:
    """The recording in a folder."""
    color_names, depth_names = numbered_files(path, "color"), numbered_files(path, "depth")
    names = list(color_names.values())
    name = next(name for name in INTRINSICS if (path / name).is_file())
    facts = json_table(read_within(path, name, MAX_TEXT_BYTES), f"{path}/{name}")
    stated_fps = number_in(facts.get("fps"), 1, 1000)
    fps = stated_fps or _FPS
    first_depth = next(iter(depth_names.values()))
    per_metre, assumed = values_per_metre(path, first_depth, _PER_METRE, "the recorders'")
    if assumed and facts.get("depth_scale") is not None:
        raise CaptureError(
            "depth_scale is not understood",
            source=f"{path}/{name}",
            seen=str(facts["depth_scale"])[:40],
            needed="depth values per metre, or metres per value",
            remedy=f"correct it, or write the depth values per metre into {SCALE}",
        )
    color, color_findings = color_stream(path, names, np.array(list(color_names)) / fps)
    times_s = np.array(list(depth_names)) / fps
    depth = depth_stream(path, list(depth_names.values()), times_s, per_metre)
    camera = open3d_camera(facts, color.shape, f"{path}/{name}")
    made = recording_of_one_view(
        path,
        camera,
        replace(color, timed=stated_fps is not None),
        depth,
        depth_source=f"{path}/depth",
        names=names,
        findings=(*assumed, *color_findings),
        texts=tuple(texts_beside(path)),
    )
    return made, None


def open3d_camera(facts: dict[str, Any], shape: tuple[int, int], source: str) -> Camera:
    """The camera of what a JSON file of Open3D's says, for images (height, width) = `shape`."""
    stated = tuple(number_in(facts.get(key), 1, 1e5) for key in ("height", "width"))
    if stated != shape:
        seen = "x".join("?" if side is None else f"{side:g}" for side in stated[::-1])
        raise CaptureError(
            "width and height are those of another image",
            source=source,
            seen=seen,
            needed=f"{shape[1]}x{shape[0]}",
            remedy="take the file of this recording, or scale all its numbers",
        )
    return camera_of(facts.get("intrinsic_matrix"), shape, source, "intrinsic_matrix")


READER = Reader(
    "open3d", "the folder of Open3D's recorders: color/, depth/", sniff, reading_by(recording)
)
