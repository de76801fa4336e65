"""A folder of reflectance transformation imaging: photographs and one .lp file of their lights.

The list lies beside the photographs or one folder below (assembly-files/, as RTIBuilder has it).
Depth and intrinsics lie beside them, as in any folder of photographs.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from rakelight.capture.config import CONFIG
from rakelight.capture.lights import (
    MAX_LIGHTS_BYTES,
    in_frame,
    matched,
    order_findings,
    parse_lp,
    unit,
)
from rakelight.capture.listing import inside
from rakelight.capture.loose_files import list_loose_files
from rakelight.capture.readers import photographs
from rakelight.capture.readers.base import Reader, Reading, Wanted
from rakelight.errors import CaptureError, printable
from rakelight.files import clear_errors, read_bytes
from rakelight.model import GivenLights


def sniff(path: Path) -> bool:
    """Whether the folder holds a .lp file."""
    return os.path.isdir(path) and bool(_lists(path))  # noqa: PTH112 - False for impossible paths


def read(path: Path, wanted: Wanted) -> Reading:
    """The capture of the folder; its lights are a start, since domes are measured to degrees."""
    with clear_errors(str(path), "cannot be read"):
        lists = _lists(path)
    if len(lists) != 1:
        raise CaptureError(
            "not one list of lights",
            source=str(path),
            seen=", ".join(map(printable, lists)),
            needed="the photographs and one .lp file",
            remedy="move the others away",
        )
    source = f"{path}/{printable(lists[0])}"
    inside(path, lists[0])
    listed, vectors = parse_lp(
        read_bytes(path / lists[0], source=source, max_bytes=MAX_LIGHTS_BYTES), source
    )
    files = list_loose_files(path)
    names = [Path(file.name).name for file in files.photographs]
    directions = unit(in_frame(vectors[matched(listed, names, source)], "opengl"), source)
    reading = photographs.reading_of(path, files, wanted, GivenLights(directions, fixed=False))
    ordered = order_findings(listed, names, printable(lists[0]))
    findings = (*ordered, *reading.capture.findings)
    return replace(reading, capture=replace(reading.capture, findings=findings))


def _lists(path: Path) -> list[str]:
    """The lists in the folder itself; where there are none, those in its folders.

    Those of captures in it are theirs.
    """
    found = [each for each in path.iterdir() if each.suffix.lower() == ".lp"]
    below = (
        each
        for each in path.glob("*/*")
        if each.suffix.lower() == ".lp" and not (each.parent / CONFIG).exists()
    )
    return sorted(each.relative_to(path).as_posix() for each in found or below)


READER = Reader(
    "rti",
    "an RTI folder: photographs and a .lp file, with depth and intrinsics beside",
    sniff,
    read,
)
