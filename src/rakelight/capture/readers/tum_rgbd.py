"""The folder of the TUM RGB-D benchmark, and all in its format: rgb.txt, depth.txt.

Facts: cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats and /intrinsic_calibration.  Depth is
registered to colour, 5000 values per metre.
"""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from rakelight.capture import validate
from rakelight.capture.readers.base import Reader
from rakelight.capture.readers.depth_place import recording_of_one_view
from rakelight.capture.readers.image_files import (
    color_stream,
    compressed_finding,
    depth_stream,
    read_within,
)
from rakelight.capture.readers.numbers import camera_of
from rakelight.capture.readers.open3d_recorder import open3d_camera
from rakelight.capture.readers.tracking import Poses, reading_by
from rakelight.capture.recording import Recording
from rakelight.errors import CaptureError
from rakelight.files import MAX_TEXT_BYTES
from rakelight.model import Camera, Distortion, Finding, Floats

COLOR, DEPTH = "rgb.txt", "depth.txt"
_PER_METRE = 5000.0
# Files beside the lists that may hold the intrinsics.
_TEXTS = ("intrinsics.txt", "intrinsic.txt", "calibration.txt", "calib.txt", "camera.txt", "K.txt")
_TABLES = ("camera_intrinsic.json", "intrinsic.json")
# The benchmark's recommended intrinsics, of 640x480: fx, fy, cx, cy.
_DEFAULT, _DEFAULT_SHAPE = (525.0, 525.0, 319.5, 239.5), (480, 640)


def sniff(path: Path) -> bool:
    """Whether the folder holds both lists."""
    return (path / COLOR).is_file() and (path / DEPTH).is_file()


def recording(path: Path) -> tuple[Recording, Poses | None]:
    """The recording in a folder."""
    color_times, names = _listed(path, COLOR)
    depth_times, depth_names = _listed(path, DEPTH)
    color = color_stream(path, names, color_times)
    depth = depth_stream(path, depth_names, depth_times, _PER_METRE)
    camera, findings = _camera(path, color.shape)
    made = recording_of_one_view(
        path,
        camera,
        color,
        depth,
        depth_source=f"{path}/{DEPTH}",
        names=names,
        findings=(*findings, *compressed_finding(names)),
    )
    return made, None


def _listed(path: Path, name: str) -> tuple[Floats, list[str]]:
    """(N,) seconds, rising, and the files of a list; those that are not there any more left out."""
    source, found = f"{path}/{name}", dict[float, str]()
    text = read_within(path, name, MAX_TEXT_BYTES).decode("utf-8", "replace")
    for number, line in enumerate(text.splitlines(), 1):
        fields = re.split(r"[\s,]+", line.split("#")[0].strip(), maxsplit=1)
        if fields == [""]:
            continue
        try:
            time_s = float(fields[0])
        except ValueError:
            time_s = np.nan
        if len(fields) != 2 or not abs(time_s) < 1e12:
            raise CaptureError(
                f"line {number} is no time and file", source=source, seen=line[:80],
                needed="1305031102.175 rgb/1305031102.175.png",
                remedy="correct the line, or take it out",
            )  # fmt: skip
        if time_s in found and found[time_s] != fields[1]:
            raise CaptureError(
                f"line {number} has the time of another",
                source=source,
                seen=line,
                remedy="take one of them out",
            )
        found[time_s] = fields[1]
    for file in found.values():
        if "\0" in file or Path(file).is_absolute() or ".." in Path(file).parts:
            raise CaptureError(
                "a file outside the folder",
                source=source,
                seen=file,
                remedy="copy the file into the folder",
            )
    kept = {time: file for time, file in sorted(found.items()) if _is_there(path / file)}
    if not kept:
        raise CaptureError(
            "none of the files in it is there", source=source, remedy="copy the folder again, whole"
        )
    return np.array(list(kept)), list(kept.values())


def _is_there(path: Path) -> bool:
    return os.path.isfile(path)  # noqa: PTH113 - False for impossible names, where Path raises


def _camera(path: Path, shape: tuple[int, int]) -> tuple[Camera, tuple[Finding, ...]]:
    """From a file beside the lists, else the benchmark's recommended one, with a warning."""
    for name in _TABLES:
        if (path / name).is_file():
            return open3d_camera(path, name, shape), ()
    for name in _TEXTS:
        if (path / name).is_file():
            return _camera_of_text(path, name, shape), ()
    if shape != _DEFAULT_SHAPE:
        raise CaptureError(
            "the intrinsics of the colour camera are not known",
            source=str(path),
            seen=f"frames of {shape[1]}x{shape[0]}, no intrinsics.txt",
            needed="intrinsics.txt with fx fy cx cy",
            remedy="write one, in pixels of these frames",
        )
    finding = Finding(
        "warning",
        "default-intrinsics",
        "the folder does not say its intrinsics: fx = fy = 525, cx = 319.5, cy = 239.5 assumed",
        "write intrinsics.txt with fx fy cx cy",
    )
    return Camera(640, 480, *_DEFAULT), (finding,)


def _camera_of_text(path: Path, name: str, shape: tuple[int, int]) -> Camera:
    """Of fx fy cx cy [k1 k2 p1 p2 [k3]], or of a 3x3 matrix."""
    source = f"{path}/{name}"
    text = read_within(path, name, MAX_TEXT_BYTES).decode("utf-8", "replace")
    fields = " ".join(line.split("#")[0] for line in text.splitlines())
    words = re.split(r"[\s,;\[\]]+", fields.strip())[:100]
    try:
        numbers = [float(word) for word in words if word]
    except ValueError:
        numbers = []
    matrix, distortion = numbers, list[float]()
    if not (len(numbers) == 9 and numbers[8] == 1 and numbers[1] == 0):
        if len(numbers) not in (4, 8, 9):
            raise CaptureError(
                "no intrinsics", source=source, seen=fields.strip()[:80] or "nothing",
                needed="fx fy cx cy, or the nine numbers of a matrix",
                remedy="write fx fy cx cy, in pixels of the frames",
            )  # fmt: skip
        fx, fy, cx, cy, *distortion = numbers
        matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    camera = camera_of(matrix, shape, source, "the matrix")
    if any(distortion):
        camera = replace(camera, distortion=Distortion("brown-conrady", tuple(distortion)))
        validate.check_distortion(camera, source, "the distortion")
    return camera


READER = Reader(
    "tum",
    "a folder as of the TUM RGB-D benchmark: rgb.txt, depth.txt",
    sniff,
    reading_by(recording),
)
