"""What small files beside the frames of a recording state."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rakelight.capture.intrinsics import MAX_BYTES
from rakelight.capture.intrinsics.names import TEXT_SUFFIXES
from rakelight.capture.listing import inside
from rakelight.capture.loose_depth import SCALE, depth_scale, stated_scale
from rakelight.capture.readers.image_files import depth_values, read_within
from rakelight.files import clear_errors
from rakelight.model import Finding


def texts_beside(root: Path) -> dict[Path, bytes]:
    """The texts in a folder that are no larger than files with intrinsics are."""
    with clear_errors(str(root), "cannot be read"):
        files = sorted(path for path in root.iterdir() if path.suffix.lower() in TEXT_SUFFIXES)
        small = [path for path in files if path.is_file() and path.stat().st_size <= MAX_BYTES]
    return {path: read_within(root, path.name) for path in small}


def values_per_metre(
    root: Path, name: str, usual: float, whose: str
) -> tuple[float, tuple[Finding, ...]]:
    """Depth values per metre, as depth_scale.txt or another file says; else `usual`, with a note.

    name : of a depth map; whose : who writes the usual ones, for the note
    """
    if (root / SCALE).is_file():
        return depth_scale(inside(root, SCALE)), ()
    values = depth_values(root, name)
    if values.dtype == np.uint16:  # else it is no depth map, which is said where it is read
        stated = stated_scale(texts_beside(root).values(), values, f"{root}/{name}")
        if stated is not None:
            return stated, ()
    message = f"{usual:.0f} depth values per metre assumed, which are {whose}"
    remedy = f"where they are others, as the median depth shows, write the number into {SCALE}"
    return usual, (Finding("note", "depth-unit-assumed", message, remedy),)
