"""The folder of the TUM RGB-D benchmark, and all in its format: rgb.txt, depth.txt.

ICL-NUIM, and folders made for ORB-SLAM, have one list of pairs in their place: time and file of
depth, time and file of colour, in either order.

Facts: cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats and /intrinsic_calibration.  Depth is
registered to colour, 5000 values per metre.  Recordings of others in this format often have another
scale, which ORB-SLAM's settings beside them state as DepthMapFactor.
"""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from rakelight.capture import validate
from rakelight.capture.intrinsics.names import named_intrinsics, names_depth, names_lens
from rakelight.capture.readers.base import Reader
from rakelight.capture.readers.beside import texts_beside, values_per_metre
from rakelight.capture.readers.depth_place import recording_of_one_view
from rakelight.capture.readers.image_files import (
    color_stream,
    depth_stream,
    read_within,
)
from rakelight.capture.readers.stated_camera import stated_camera
from rakelight.capture.readers.tracking import Poses, reading_by
from rakelight.capture.recording import Recording
from rakelight.errors import CaptureError, listed
from rakelight.files import MAX_TEXT_BYTES
from rakelight.model import Camera, Finding, Floats

COLOR, DEPTH = "rgb.txt", "depth.txt"
_AND_DEPTH = ", and the same of depth"
PAIRS = ("associations.txt", "associated.txt", "association.txt", "associate.txt")
_PER_METRE = 5000.0
# From the last time of one list to the first of the other, seconds: a lamp is moved in minutes.
_FARTHEST_S = 600.0
# The benchmark's recommended intrinsics, of 640x480: fx, fy, cx, cy.
_DEFAULT, _DEFAULT_SHAPE = (525.0, 525.0, 319.5, 239.5), (480, 640)


def sniff(path: Path) -> bool:
    """Whether the folder holds both lists, or one of pairs."""
    return bool(_lists(path))


def recording(path: Path) -> tuple[Recording, Poses | None]:
    """The recording in a folder."""
    of_color, of_depth = _lists(path)
    color_times, names = _listed(path, of_color, depth=False)
    depth_times, depth_names = _listed(path, of_depth, depth=True)
    color, color_findings = color_stream(path, names, color_times)
    per_metre, assumed = values_per_metre(path, depth_names[0], _PER_METRE, "the benchmark's")
    depth = depth_stream(path, depth_names, depth_times, per_metre)
    _check_clock(path, color_times, depth_times)
    camera, findings = _camera(path, color.shape)
    made = recording_of_one_view(
        path,
        camera,
        color,
        depth,
        depth_source=f"{path}/{of_depth}",
        names=names,
        findings=(*findings, *assumed, *color_findings),
        texts=[file for file in texts_beside(path) if file.name not in (of_color, of_depth)],
    )
    return made, None


def _lists(path: Path) -> tuple[str, ...]:
    """The lists of colour and of depth, which may be one; none where the folder has none."""
    if (path / COLOR).is_file() and (path / DEPTH).is_file():
        return COLOR, DEPTH
    return next(((name, name) for name in PAIRS if (path / name).is_file()), ())


def _listed(path: Path, name: str, depth: bool) -> tuple[Floats, list[str]]:
    """(N,) seconds, rising, and the files of a list; those that are not there any more left out.

    depth : whether those of depth are meant, of a list of pairs
    """
    source, found, paired = f"{path}/{name}", dict[float, str](), name in PAIRS
    text = read_within(path, name, MAX_TEXT_BYTES).decode("utf-8-sig", "replace")
    text = text.replace("\\", "/")  # as programs on Windows write paths
    for number, line in enumerate(text.splitlines(), 1):
        fields = re.split(r"[\s,]+", line.split("#")[0].strip(), maxsplit=3 if paired else 1)
        if fields == [""]:
            continue
        if paired:
            pairs = (fields[:2], fields[2:]) if len(fields) == 4 else ()
            fields = next((pair for pair in pairs if ("depth" in pair[1].lower()) == depth), [""])
        try:
            time_s = float(fields[0])
        except ValueError:
            time_s = np.nan
        if len(fields) != 2 or not abs(time_s) < 1e12:
            raise CaptureError(
                f"line {number} is no time and file", source=source, seen=line[:80],
                needed="1305031102.175 rgb/1305031102.175.png" + (_AND_DEPTH if paired else ""),
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
            "none of the files in it is there", source=source, seen=next(iter(found.values()), ""),
            remedy="copy the folder again, whole",
        )  # fmt: skip
    return np.array(list(kept)), list(kept.values())


def _check_clock(path: Path, color_s: Floats, depth_s: Floats) -> None:
    """Colour and depth were recorded together: their times (N,), rising, are of one clock."""
    apart_s = max(color_s[0] - depth_s[-1], depth_s[0] - color_s[-1])
    if apart_s > _FARTHEST_S:
        raise CaptureError(
            f"the times of {COLOR} and {DEPTH} lie far apart",
            source=str(path),
            seen=f"{apart_s:,.0f} s between them",
            needed=f"one clock, at most {_FARTHEST_S:g} s between them",
            remedy="take both lists from one recording, and write the times of one clock",
        )


def _is_there(path: Path) -> bool:
    return os.path.isfile(path)  # noqa: PTH113 - False for impossible names, where Path raises


def _camera(path: Path, shape: tuple[int, int]) -> tuple[Camera, tuple[Finding, ...]]:
    """From a file beside the lists, else the benchmark's recommended one, with a warning."""
    texts = {
        file: data
        for file, data in texts_beside(path).items()
        if (named_intrinsics(file.stem) or names_lens(file.stem)) and not names_depth(file.stem)
    }
    stated = stated_camera(path, texts, shape[::-1])
    if stated is not None:
        camera = stated.camera
        if not camera.width:
            camera = replace(camera, width=shape[1], height=shape[0])
        validate.check_camera(camera, shape, f"{path}/{stated.name}", "intrinsics")
        return camera, stated.findings
    misread = f"; none were found in {listed([file.name for file in texts])}" if texts else ""
    if shape != _DEFAULT_SHAPE:
        raise CaptureError(
            "the intrinsics of the colour camera are not known",
            source=str(path),
            seen=f"frames of {shape[1]}x{shape[0]}, no intrinsics.txt{misread}",
            needed="intrinsics.txt with fx fy cx cy",
            remedy="write one, in pixels of these frames",
        )
    finding = Finding(
        "warning",
        "default-intrinsics",
        "the folder does not say its intrinsics: fx = fy = 525, cx = 319.5, cy = 239.5 assumed"
        + misread,
        "write intrinsics.txt with fx fy cx cy",
    )
    return Camera(640, 480, *_DEFAULT), (finding,)


READER = Reader(
    "tum",
    "a folder as of the TUM RGB-D benchmark: rgb.txt, depth.txt, or associations.txt",
    sniff,
    reading_by(recording),
)
