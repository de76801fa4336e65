"""The tables of a calibration file: which camera each is of, and which lens is that camera's.

A file holds tables in tables, cameras by their names, and a lens in its camera's table or beside
it.  `walk` finds each table once, with what is known of it; who reads a file chooses among them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from rakelight.capture.intrinsics.camera_tables import has_matrix, named
from rakelight.capture.intrinsics.lens_tables import (
    BY_NAME,
    KANNALA_BRANDT,
    is_lens,
    lens_part,
    with_lens,
)
from rakelight.capture.intrinsics.names import COLOR, DEPTH
from rakelight.capture.text_tables import Table

OTHER = "other"
"""Beside COLOR and DEPTH: a name with depth in it that is of no camera, as a pose's."""

_NESTED = 4  # tables within tables that are looked into
_POSE = re.compile(r"(?:to|2)(?:depth|infra|colou?r|rgb)")  # in names of what is no camera
_WORDS = re.compile(f"{DEPTH}|{COLOR}")
_AT_AN_END = {camera: re.compile(f"^(?:{camera})|(?:{camera})$") for camera in (DEPTH, COLOR)}


class FoundTable(NamedTuple):
    """What a table of a calibration file states of one camera.

    cameras : that the names around it and in it say, the outermost first: COLOR, DEPTH, OTHER, ""
    facts : by plain names, without the words for the camera; with the lens that is stated beside
    lens_of_none : what it states of a lens, where no camera is there for that
    """

    cameras: tuple[str, ...]
    facts: Table
    lens_of_none: Table


def may_be_of_photographs(table: FoundTable) -> bool:
    """Whether no name says that it is of the depth."""
    return DEPTH not in table.cameras and OTHER not in table.cameras


def may_be_of_depth(table: FoundTable) -> bool:
    """Whether no name says that it is of the colour."""
    return COLOR not in table.cameras and OTHER not in table.cameras


def is_of_depth(table: FoundTable) -> bool:
    """Whether a name says that it is of the depth camera; names in that may say what they will."""
    return next((camera for camera in table.cameras if camera not in ("", COLOR)), "") == DEPTH


def walk(
    content: Any, cameras: tuple[str, ...] = (), beside: Table | None = None, nested: int = 0
) -> Iterator[FoundTable]:
    """What every table in a content states of each camera, outer tables before those in them.

    cameras, beside : what names say of the table around, and what that states of this one's lens
    """
    if not isinstance(content, dict):
        return
    table = named(content)
    if beside and _holds_camera(table):
        table = with_lens(table, beside)
    parts = _by_camera(table, cameras)
    lenses, of_none = _shared_out(parts)
    for camera, part in parts.items():
        facts = with_lens(part, lenses[camera])
        yield FoundTable((*cameras, camera), facts, of_none.get(camera, {}))
    for key, value in table.items() if nested < _NESTED else ():
        if isinstance(value, dict) and (not is_lens(key) or _holds_camera(value)):
            camera, _ = _camera_named(key, cameras)
            inner = {"model": key, **value} if KANNALA_BRANDT.fullmatch(key) else value
            yield from walk(inner, (*cameras, camera), lenses[camera], nested + 1)


def _by_camera(table: Table, cameras: tuple[str, ...]) -> dict[str, Table]:
    """A table by the cameras that its names say, the names without the words for these.

    >>> parts = _by_camera({"fxcolor": 500, "depth": {}, "width": 640, "color2depth": []}, ())
    >>> parts[""], parts[COLOR], parts[DEPTH], parts[OTHER]
    ({'width': 640}, {'fx': 500}, {'depth': {}}, {'color2depth': []})
    """
    parts: dict[str, Table] = {"": {}}
    for key, value in table.items():
        camera, name = _camera_named(key, cameras)
        part = parts.setdefault(camera, {})
        part[key if name in part else name] = value
    return parts


def _camera_named(key: str, cameras: tuple[str, ...]) -> tuple[str, str]:
    """The camera that a name says, and the name without the words for it: fx_color, depthWidth.

    cameras : of the table that it stands in: in one of the depth, depth says no more
    A pose, color2depth, is of no camera; k2_color is a coefficient of its lens.
    """
    if not _WORDS.search(key):
        return "", key
    for camera, at_an_end in _AT_AN_END.items():
        name = at_an_end.sub("", key)
        if name != key and (BY_NAME.fullmatch(name) or not _POSE.search(key)):
            return "" if camera == DEPTH and DEPTH in cameras else camera, name or key
    return OTHER if re.search(DEPTH, key) else "", key


def _shared_out(parts: dict[str, Table]) -> tuple[dict[str, Table], dict[str, Table]]:
    """What a table states of the lens of each camera in it, and of lenses that no camera has.

    A lens of which no name says a camera is that of the cameras of which none does, else of the
    only camera there is; the colour's is that of the cameras of which no name says one, too.
    """
    lenses = {camera: lens_part(part) for camera, part in parts.items()}
    if not any(lenses.values()):
        return lenses, {}
    if lenses[""] and has_matrix(parts[""]):  # its own, and of no camera in it
        return lenses | {"": {}}, {}
    cameras = [camera for camera, part in parts.items() if camera != OTHER and _holds_camera(part)]
    if "" not in cameras and len(cameras) == 1 and not lenses[cameras[0]]:
        lenses[cameras[0]], lenses[""] = lenses[""], {}
    elif "" in cameras and not lenses[""]:
        lenses[""] = lenses.get(COLOR, {})
        cameras.append(COLOR)
    of_none = {camera: lens for camera, lens in lenses.items() if camera not in cameras}
    return lenses | {camera: {} for camera in of_none}, of_none


def _holds_camera(content: Any, nested: int = 0) -> bool:
    """Whether a table has the matrix of a camera, or one in it has."""
    if not isinstance(content, dict):
        return False
    table = named(content)
    inner = table.values() if nested < _NESTED else ()
    return has_matrix(table) or any(_holds_camera(each, nested + 1) for each in inner)
