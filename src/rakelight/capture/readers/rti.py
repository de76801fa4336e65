"""A folder of reflectance transformation imaging: photographs and one .lp file of their lights.

Depth (depth.tiff or depth.png) and intrinsics (K.txt) have to lie beside the photographs.
"""

from __future__ import annotations

import os
from pathlib import Path

from rakelight.capture.beside import capture_beside, image_names
from rakelight.capture.lights import MAX_LIGHTS_BYTES, in_frame, matched, parse_lp, unit
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
        lists, names = _lists(path), image_names(path)
    if len(lists) != 1 or not names:
        raise CaptureError(
            "no photographs in it" if not names else "not one list of lights",
            source=str(path),
            seen=", ".join(map(printable, lists)),
            needed="the photographs and one .lp file",
            remedy="move the others away" if names else "put the photographs beside the .lp file",
        )
    source = f"{path}/{printable(lists[0])}"
    data = read_bytes(path / lists[0], source=source, max_bytes=MAX_LIGHTS_BYTES)
    listed, vectors = parse_lp(data, source)
    order = matched(listed, names, source)
    directions = unit(in_frame(vectors[order], "opengl"), source)
    lights = GivenLights(directions, fixed=False)
    return Reading(capture_beside(path, names, wanted.photographs, lights, None))


def _lists(path: Path) -> list[str]:
    return sorted(each.name for each in path.iterdir() if each.suffix.lower() == ".lp")


READER = Reader(
    "rti", "an RTI folder: photographs and a .lp file, with depth and K.txt beside", sniff, read
)
