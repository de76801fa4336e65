"""A folder of the DiLiGenT benchmark: photographs and calibrated lights, with depth put beside.

001.png ... 096.png (16 bit, linear), filenames.txt, light_directions.txt (x right, y up, z to the
viewer), light_intensities.txt (red green blue), mask.png.  It has no depth and no intrinsics: both
have to lie beside the photographs, as in any folder of photographs.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from rakelight.capture.lights import (
    INTENSITIES_FILE,
    MAX_LIGHTS_BYTES,
    MOST_LIGHTS,
    in_frame,
    parse_table,
    require_inside,
    text_lines,
    unit,
)
from rakelight.capture.loose_files import list_loose_files
from rakelight.capture.readers import photographs
from rakelight.capture.readers.base import Reader, Reading, Wanted
from rakelight.errors import CaptureError
from rakelight.files import read_bytes
from rakelight.model import Encoding, Floats, GivenLights

DIRECTIONS, NAMES = "light_directions.txt", "filenames.txt"
LISTS = (DIRECTIONS, NAMES, INTENSITIES_FILE)  # none of which states intrinsics


def sniff(path: Path) -> bool:
    """Whether the folder holds directions, or both of the benchmark's other lists."""
    there = [name for name in LISTS if os.path.lexists(path / name)]
    return DIRECTIONS in there or len(there) == 2


def read(path: Path, wanted: Wanted) -> Reading:
    """The capture of the folder; its lights are fixed.

    Without a list of names the photographs are those in the folder, in the order of their numbers,
    and their format and bits say whether they are linear: others write such a list of lights, too.
    """
    listed = os.path.lexists(path / NAMES)
    files = list_loose_files(path, _names(path) if listed else ())
    count = len(files.photographs)
    directions, intensities = _rows(path, DIRECTIONS, count), None
    if directions.ndim != 2:
        raise CaptureError(
            "not directions",
            source=f"{path}/{DIRECTIONS}",
            needed="x y z",
            remedy="copy the dataset's lists again",
        )
    if os.path.lexists(path / INTENSITIES_FILE):
        intensities = _rows(path, INTENSITIES_FILE, count)
    directions = unit(in_frame(directions, "opengl"), f"{path}/{DIRECTIONS}")
    lights = GivenLights(directions, None, intensities, fixed=True)
    texts = tuple(text for text in files.texts if text.name not in LISTS)
    encoding: Encoding | None = "linear" if listed else None
    return photographs.reading_of(path, replace(files, texts=texts), wanted, lights, encoding)


def _names(path: Path) -> list[str]:
    """The photographs that the folder lists, relative to it."""
    source = f"{path}/{NAMES}"
    data = read_bytes(path / NAMES, source=source, max_bytes=MAX_LIGHTS_BYTES)
    lines = (line.strip() for line in text_lines(data))
    names = [line.replace("\\", "/").removeprefix("./") for line in lines]
    if not names or len(names) > MOST_LIGHTS:
        raise CaptureError(
            "no list of photographs", source=source, seen=f"{len(names)} names",
            needed="one name in each line", remedy="copy the dataset's lists again"
        )  # fmt: skip
    for name in names:
        for part in name.split("/"):
            require_inside(part, source, "a photograph")
    return names


def _rows(path: Path, name: str, count: int) -> Floats:
    """The numbers of a table with one row per photograph."""
    source = f"{path}/{name}"
    rows = parse_table(read_bytes(path / name, source=source, max_bytes=MAX_LIGHTS_BYTES), source)
    if len(rows) != count:
        raise CaptureError(
            "as many lights as photographs are needed", source=source, seen=f"{len(rows)} lines",
            needed=f"{count}, one for each photograph",
            remedy=f"copy the dataset's lists again, or take lines out of this one and of {NAMES}",
        )  # fmt: skip
    return rows


READER = Reader("diligent", "a DiLiGenT folder, with depth and intrinsics beside", sniff, read)
