"""Intrinsics in the files of other programs.

OpenCV, ROS, Kalibr, ORB-SLAM, RealSense, Open3D, COLMAP, nerfstudio, Metashape, MATLAB, KITTI,
ScanNet, and plain numbers.  A file is numbers alone (bare_numbers.py), or its text becomes tables
(text_tables.py).  Of these `walk` (table_walk.py) tells which are of which camera; what one states
of a camera and of a lens is read by its names (camera_tables.py, lens_tables.py).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable
from pathlib import Path

import numpy as np

from rakelight.capture import npy
from rakelight.capture.intrinsics import bare_numbers, lens_tables
from rakelight.capture.intrinsics.camera_tables import (
    camera_in,
    checked_lens,
    has_matrix,
    several_cameras,
    unchecked,
)
from rakelight.capture.intrinsics.table_walk import (
    FoundTable,
    is_of_depth,
    may_be_of_depth,
    may_be_of_photographs,
    walk,
)
from rakelight.capture.text_tables import contents, numbers_alone, text_of
from rakelight.errors import CaptureError, parsing
from rakelight.files import read_bytes
from rakelight.model import Camera, Distortion

MAX_BYTES = 5_000_000
"""Of a file with intrinsics: they take some thousand, the poses beside them megabytes."""

_MOST_NUMBERS = 16  # of an array with intrinsics: a matrix 4 x 4
# Pixels, and coefficients of a lens, by which one camera differs in two files.
_ROUNDING = np.array([0.005] * 4 + [1e-5] * 8)

Size = tuple[int, int]
Choice = Callable[[FoundTable], bool]


def parse_intrinsics(
    data: bytes, source: str = "", named: bool = False, size: Size | None = None
) -> Camera | None:
    """The intrinsics of the photographs that a file states; None where it is no such file.

    named : whether its name says so, see `named_intrinsics`: then four numbers are fx fy cx cy, and
        more than four end with k1 k2 p1 p2 [k3]
    size : (width, height) of the images, by which one of several cameras is chosen
    The size is 0 x 0 where the file does not state it.

    Raises CaptureError where it states some that are none: several cameras, another model, numbers
    that are not finite, a matrix with skew.

    >>> parse_intrinsics(b"500 0 319.5 0 500 239.5 0 0 1").fx
    500.0
    >>> parse_intrinsics(b"1 SIMPLE_RADIAL 640 480 500 320 240 0.01").cx
    319.5
    >>> parse_intrinsics(b"intrinsics: [500, 500, 319.5, 239.5]").cy
    239.5
    >>> parse_intrinsics(b"a shopping list") is None
    True
    """
    if data.startswith(npy.MAGIC):
        return _in_array(data, source, named)
    text = small_text(data)
    if text is None:
        return None
    if text.lstrip()[:1] not in ("{", "<"):
        found = bare_numbers.colmap(text, source) or bare_numbers.camera(text, named)
        if found is not None:
            return found.checked(source)
    return _in_tables(text, source, size, may_be_of_photographs, may_be_of_photographs)


def parse_depth_intrinsics(
    data: bytes,
    source: str = "",
    whole: bool = False,
    named: bool = False,
    size: Size | None = None,
) -> Camera | None:
    """The intrinsics of a depth camera: what a file has under names with depth in them.

    whole : whether the file is of the depth, see `names_depth`: then all that it states
    What else is given, returned and raised is that of `parse_intrinsics`.

    >>> parse_depth_intrinsics(b'{"depth": {"fx": 200, "cx": 99, "cy": 74}}').cx
    99.0
    >>> parse_depth_intrinsics(b"200 0 99 0 200 74 0 0 1") is None
    True
    """
    text = small_text(data)
    found = None if text is None else _in_tables(text, source, size, is_of_depth, may_be_of_depth)
    if found is not None or not whole:
        return found
    return parse_intrinsics(data, source, named, size)


def parse_lens(
    data: bytes, source: str = "", sure: bool = True, of_depth: bool = False
) -> Distortion | Camera | None:
    """The lens, which may have coefficients of 0, in a file of its own; None without one.

    Where the numbers fx fy cx cy come before those of the lens, the camera with its lens.

    sure : whether it holds a lens or is a mistake, see `surely_lens`: else another count of numbers
        is something else, and so are tangential coefficients like no lens's
    of_depth : whether the file is of the depth, see `names_depth`
    Raises CaptureError where it states one that is not understood.

    >>> parse_lens(b"0.1 -0.2 0 0 0").coefficients
    (0.1, -0.2, 0.0, 0.0, 0.0)
    >>> parse_lens(b'{"distortion": {"k1": 0.1, "model": "fisheye"}}').model
    'kannala-brandt'
    >>> parse_lens(b"500 500 320 240 0.1 0 0 0").fx
    500.0
    >>> parse_lens(b"0.65") is None
    True
    """
    text = small_text(data)
    if data.startswith(npy.MAGIC):
        few = npy.decode_few(data, max(lens_tables.COUNTS), source)
        numbers = [] if few is None else few.ravel().tolist()
    else:
        numbers = [float(word) for word in numbers_alone(text or "")]
    if numbers:
        return bare_numbers.lens(numbers, source, sure)
    if text is None:
        return None
    may_be_of = may_be_of_depth if of_depth else may_be_of_photographs
    with parsing(source, "no distortion of a lens", CaptureError):
        for content in contents(text, source):
            stated = [table for table in walk(content) if lens_tables.lens_part(table.facts)]
            for table in filter(may_be_of, stated):
                return checked_lens(*lens_tables.coefficients_of(table.facts, source), source)
            if stated:
                return None  # the other camera's
    if sure and bare_numbers.says_coefficients(text):
        raise lens_tables.not_understood("text", " ".join(text.split()), source)
    return None


def lens_named(data: bytes, source: str = "") -> str | None:
    """The model of distortion that a file names beside its camera, without coefficients.

    "" where it states these, or that there is none; None where it says nothing of distortion.

    >>> lens_named(b"fx=500\\ncx=319\\ncy=239\\nDistortion=Brown Conrady")
    'Brown Conrady'
    """
    text = small_text(data)
    if text is None or not re.search("dist|coef", text, re.IGNORECASE):
        return None
    with parsing(source, "no camera matrix", CaptureError):
        for content in contents(text, source):
            tables = [table.facts for table in walk(content) if may_be_of_photographs(table)]
            named = [lens_tables.model_named(table) for table in tables if has_matrix(table)]
            if said := [each for each in named if each is not None]:
                return "" if "" in said else said[0]
    return None


def alike(cameras: Collection[Camera]) -> bool:
    """Whether all are one camera but for their sizes and rounding: programs print six digits.

    >>> fx, other, wider = (Camera(4, 3, f, 5.0, 1.5, 1.0) for f in (5.0, 5.000001, 5.1))
    >>> alike([fx, other]), alike([fx, wider])
    (True, False)
    """
    numbers = np.array([
        (c.fx, c.fy, c.cx, c.cy, *np.resize((*c.distortion.coefficients, *(0.0,) * 8), 8))
        if c.distortion else (c.fx, c.fy, c.cx, c.cy, *(0.0,) * 8)
        for c in cameras
    ])  # fmt: skip
    models = {camera.distortion.model for camera in cameras if camera.distortion}
    return len(models) < 2 and bool(np.all(np.ptp(numbers, axis=0) <= _ROUNDING))


def small_texts(paths: Iterable[Path]) -> dict[Path, bytes]:
    """The content of those files that are no larger than files with intrinsics are."""
    small = (path for path in paths if path.is_file() and path.stat().st_size <= MAX_BYTES)
    return {path: read_bytes(path, source=str(path)) for path in small}


def small_text(data: bytes) -> str | None:
    """The text of a file; None where it is none, or larger than files with intrinsics are."""
    return text_of(data) if len(data) <= MAX_BYTES else None


def _in_array(data: bytes, source: str, named: bool) -> Camera | None:
    """The camera of a .npy: a matrix; where its name says so what `bare_numbers.camera` reads."""
    few = npy.decode_few(data, _MOST_NUMBERS, source)
    if few is not None and few.shape == (3, 3):
        return unchecked(few).checked(source)
    if few is None or not named or not (1 in few.shape or few.shape == (4, 4)):
        return None
    found = bare_numbers.camera(" ".join(map(str, few.ravel().tolist())), named)
    return None if found is None else found.checked(source)


def _in_tables(
    text: str, source: str, size: Size | None, is_of: Choice, may_be_of: Choice
) -> Camera | None:
    """The camera of the first kind of content of a text that states one.

    is_of, may_be_of : whether a table is to be read for the camera, and for a lens left over
    """
    with parsing(source, "no camera matrix", CaptureError):
        for content in contents(text, source):
            tables = list(walk(content))
            camera = _only_camera(filter(is_of, tables), source, size)
            if camera is not None and camera.distortion is None:
                _check_no_lens_left(filter(may_be_of, tables), source)
            if camera is not None:
                return camera
    return None


def _only_camera(tables: Iterable[FoundTable], source: str, size: Size | None) -> Camera | None:
    """The one camera that tables state; of several the one of `size`."""
    read = (camera_in(table.facts, source) for table in tables)
    found = {camera for camera in read if camera is not None}
    if len(found) > 1:
        found = {camera for camera in found if camera.size == size} or found
    if len(found) > 1:
        raise several_cameras(len(found), source)
    return found.pop().checked(source) if found else None


def _check_no_lens_left(tables: Iterable[FoundTable], source: str) -> None:
    """Raise CaptureError where tables state a lens that distorts, and is of none of the cameras."""
    names = [name for table in tables for name in lens_tables.sure_names(table.lens_of_none)]
    if names:
        raise CaptureError(
            "not clear of which camera the distortion is",
            source=source,
            seen=names[0],
            needed="the distortion in the table of fx, fy, cx, cy or of the matrix, or beside it",
            remedy="move it there, or take it out where the lens does not distort",
        )
