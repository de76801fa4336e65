"""Intrinsics in the files of other programs.

OpenCV, ROS, Kalibr, ORB-SLAM, RealSense, Open3D, COLMAP, nerfstudio, Metashape, MATLAB, KITTI,
ScanNet, and plain numbers.  Texts become tables (text_tables.py), in which matrices and numbers are
looked for by their names.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rakelight.capture import npy
from rakelight.capture.lens_tables import (
    BY_NAME,
    COLOR,
    COUNTS,
    DEPTH,
    KANNALA_BRANDT,
    SIDES,
    coefficients_of,
    in_order,
    is_lens,
    lens_part,
    model_named,
    not_understood,
    says_coefficients,
    sure_names,
    surely_lens,
    with_lens,
)
from rakelight.capture.text_tables import (
    NUMBER,
    Table,
    contents,
    number_of,
    numbers_alone,
    numbers_of,
    plain_table,
    text_of,
)
from rakelight.errors import CaptureError, parsing, stated_in
from rakelight.files import read_bytes
from rakelight.model import Camera, Distortion, Floats, LensModel

MAX_BYTES = 5_000_000
"""Of a file with intrinsics: they take some thousand, the poses beside them megabytes."""

SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt", ".csv")

_MATRIX_KEYS = (
    "cameramatrix", "intrinsicmatrix", "intrinsics", "k", "camk", "mtx", "cameramatrix1",
)  # fmt: skip
_WIDTH_KEYS, _HEIGHT_KEYS = ("imagewidth", "width", "w"), ("imageheight", "height", "h")
_SIZE_KEYS = ("resolution", "imagesize", "size")
# Pixels, and coefficients of a lens, by which one camera differs in two files.
_ROUNDING = np.array([0.005] * 4 + [1e-5] * 8)
_MOST_COEFFICIENTS = 32  # of a lens in a file of its own; more numbers are a map
# p1 and p2 that no lens reaches: 0.1 moves corners 30 degrees off by a tenth of the focal length.
# Where the name does not say for sure that it is a lens's, and where it does (another model's).
_TANGENTIAL, _TANGENTIAL_SURE = 0.1, 1.0
_NESTED = 3  # tables within tables that are looked into

# Of COLMAP's models: how many focal lengths, and the names of what follows the principal point.
_COLMAP = {
    "SIMPLE_PINHOLE": (1, ""),
    "PINHOLE": (2, ""),
    "SIMPLE_RADIAL": (1, "k1"),
    "RADIAL": (1, "k1 k2"),
    "OPENCV": (2, "k1 k2 p1 p2"),
    "FULL_OPENCV": (2, "k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": (2, "k1 k2 k3 k4"),
    "SIMPLE_RADIAL_FISHEYE": (1, "k1"),
    "RADIAL_FISHEYE": (1, "k1 k2"),
}

Size = tuple[int, int]

_POSE = re.compile(r"(?:to|2)(?:depth|infra|colou?r|rgb)")  # in names of what is no camera


def named_intrinsics(stem: str) -> bool:
    """Whether a file's name, without ending, says that it holds intrinsics.

    Where a camera stood is no intrinsics of it.

    >>> [named_intrinsics(stem) for stem in ("K", "color_intrinsics", "calib-2", "camera_poses")]
    [True, True, True, False]
    """
    name = stem.lower()
    if name == "k" or "intrinsic" in name:
        return True
    return re.search("calib|camera", name) is not None and not re.search("pose|trajector", name)


def names_depth(stem: str) -> bool:
    """Whether a file's name, without ending, says that it is of the depth camera alone.

    >>> [names_depth(stem) for stem in ("depth_intrinsics", "calib_ir", "color_and_depth", "pair")]
    [True, True, False, False]
    """
    name = stem.lower()
    of_depth = re.search(f"{DEPTH}|(?<![a-z])ir(?![a-z])", name)
    return of_depth is not None and not re.search(COLOR, name.replace("rgbd", ""))


def may_state(path: Path) -> bool:
    """Whether a camera is looked for in a file of this name: a text, or an array of that name.

    >>> [may_state(Path(name)) for name in ("poses.txt", "K.npy", "depth.npy")]
    [True, True, False]
    """
    suffix = path.suffix.lower()
    named = named_intrinsics(path.stem) or surely_lens(path.stem)
    return suffix in SUFFIXES or (suffix == ".npy" and named)


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
    if len(data) > MAX_BYTES:
        return None
    if data.startswith(npy.MAGIC):
        K = npy.decode_npy(data, source) if named else npy.decode_few(data, 9, source)
        return _made(K, (0, 0), (), source) if K is not None and K.shape == (3, 3) else None
    text = text_of(data)
    if text is None:
        return None
    found = None
    if text.lstrip()[:1] not in ("{", "<"):
        found = _colmap(text, source) or _plain(text, source, named)
    return found or _of_contents(text, source, _tables, size)


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
    text = text_of(data) if len(data) <= MAX_BYTES else None
    found = None if text is None else _of_contents(text, source, _depth_tables, size, COLOR)
    if found is not None or not whole:
        return found
    return parse_intrinsics(data, source, named, size)


def parse_lens(data: bytes, source: str = "", sure: bool = True) -> Distortion | None:
    """The lens, which may have coefficients of 0, in a file without its camera; None without one.

    sure : whether it holds a lens or is a mistake, see `surely_lens`: else another count of numbers
        is something else, and so are tangential coefficients like no lens's
    Raises CaptureError where it states one that is not understood.

    >>> parse_lens(b"0.1 -0.2 0 0 0").coefficients
    (0.1, -0.2, 0.0, 0.0, 0.0)
    >>> parse_lens(b'{"distortion": {"k1": 0.1, "model": "fisheye"}}').model
    'kannala-brandt'
    >>> parse_lens(b"0.65"), parse_lens(b"500 500 320 240 0.1 0 0 0")
    (None, None)
    """
    text = text_of(data) if len(data) <= MAX_BYTES else None
    if data.startswith(npy.MAGIC):
        few = npy.decode_few(data, max(COUNTS), source)
        numbers = [] if few is None else few.ravel().tolist()
    else:
        numbers = [float(word) for word in numbers_alone(text or "")]
    if numbers:
        return _of_numbers(numbers, source, sure)
    if text is None:
        return None
    with parsing(source, "no distortion of a lens", CaptureError):
        for content in contents(text, source):
            if table := next(_lens_tables(content), None):
                coefficients, model = coefficients_of(table, source)
                return _lens(coefficients, source, model)
    if sure and says_coefficients(text):
        raise not_understood("text", " ".join(text.split()), source)
    return None


def _of_numbers(numbers: list[float], source: str, sure: bool) -> Distortion | None:
    """The lens of a file of numbers alone; None where they are something else, as intrinsics."""
    tangential = max(map(abs, numbers[2:4]), default=0.0)
    if not sure:
        is_one = len(numbers) in COUNTS and tangential < _TANGENTIAL
        return _lens(numbers, source) if is_one else None
    of_camera = len(numbers) in (4, 8, 9) and min(numbers[:4]) > 1  # fx fy cx cy [...]
    if of_camera or not 1 < len(numbers) <= _MOST_COEFFICIENTS:
        return None
    if tangential >= _TANGENTIAL_SURE:
        raise not_understood("numbers", numbers, source)
    return _lens(numbers, source)


def _lens(coefficients: list[float], source: str, model: LensModel = "brown-conrady") -> Distortion:
    """The lens of coefficients in the model's order, checked."""
    lens = _made(np.eye(3), (0, 0), coefficients, source, model).distortion
    return lens or Distortion("brown-conrady", (0.0,) * 4)


def lens_named(data: bytes, source: str = "") -> str | None:
    """The model of distortion that a file names beside its camera, without coefficients.

    "" where it states these, or that there is none; None where it says nothing of distortion.

    >>> lens_named(b"fx=500\\ncx=319\\ncy=239\\nDistortion=Brown Conrady")
    'Brown Conrady'
    """
    text = text_of(data) if len(data) <= MAX_BYTES else None
    if text is None or not re.search("dist|coef", text, re.IGNORECASE):
        return None
    with parsing(source, "no camera matrix", CaptureError):
        for content in contents(text, source):
            named = [model_named(table) for table in _tables(content) if _has_matrix(table)]
            if stated := [each for each in named if each is not None]:
                return "" if "" in stated else stated[0]
    return None


def _made(
    K: Any,
    sizes: tuple[float, float],
    distortion: Any,
    source: str,
    model: LensModel = "brown-conrady",
) -> Camera:
    """The camera of a matrix (3, 3) and coefficients in the model's order, checked."""
    width, height = (int(side) if 0 < side < 1e6 else 0 for side in sizes)
    lens: Any = tuple(float(value) for value in np.ravel(distortion))
    with stated_in(source):
        if not any(lens):
            lens = None
        elif model != "brown-conrady":
            lens = Distortion(model, lens)
        camera = Camera.from_matrix(np.asarray(K, np.float64), (height or 1, width or 1), lens)
    return replace(camera, width=width, height=height)


def _pinhole(fx: float, fy: float, cx: float, cy: float) -> Floats:
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _plain(text: str, source: str, named: bool) -> Camera | None:
    """A matrix, 3 x 3 or 4 x 4, and nothing else; fx fy cx cy [...] where `named`."""
    words = numbers_alone(text)
    if len(words) not in (4, 8, 9, 16):
        return None
    numbers = np.array(words, np.float64)
    if len(numbers) in (9, 16):
        K = _square(numbers)
        if len(numbers) == 16 and np.allclose(K @ K.T, np.eye(3), atol=1e-3):
            return None  # the pose of a camera
        if K[1, 0] == 0 and K[2].tolist() == [0, 0, 1]:
            return _made(K, (0, 0), (), source)
    if not named or len(numbers) == 16:
        return None
    return _made(_pinhole(*numbers[:4]), (0, 0), numbers[4:], source)


def _square(numbers: Floats) -> Floats:
    """(3, 3) of nine numbers or of sixteen, by rows or by columns: the zeros tell which."""
    side = round(numbers.size**0.5)
    K = numbers.reshape(side, side)[:3, :3]
    return K.T if K[0, 2] == 0 and K[1, 2] == 0 else K


def _colmap(text: str, source: str) -> Camera | None:
    """COLMAP's cameras.txt, which puts the centre of the first pixel at (0.5, 0.5)."""
    lines = [line.split() for line in text.splitlines() if line.strip() and line[0] != "#"]
    if not lines or not all(
        len(words) > 4 and words[0].isdigit() and re.fullmatch("[A-Z][A-Z_0-9]+", words[1])
        for words in lines
    ):
        return None
    if len({tuple(words[1:]) for words in lines}) > 1:
        raise CaptureError(
            "several cameras",
            source=source,
            seen=f"{len(lines)} of them",
            needed="one, as no camera moves here",
            remedy="keep the line of the camera that took the photographs",
        )
    _, model, *numbers = lines[0]
    lengths, names = _COLMAP.get(model, (0, ""))
    given = names.split()
    if not lengths or len(numbers) != 2 + lengths + 2 + len(given):
        raise CaptureError(
            "this camera model is not read",
            source=source,
            seen=f"{model} with {len(numbers)} numbers",
            needed=", ".join(_COLMAP),
            remedy="let COLMAP estimate one of these",
        )
    if not all(re.fullmatch(NUMBER, number) for number in numbers):
        raise CaptureError(
            "not numbers",
            source=source,
            seen=" ".join(numbers),
            remedy="copy or export the file again",
        )
    width, height, *values = map(float, numbers)
    fx, fy = values[0], values[lengths - 1]
    cx, cy = (value - 0.5 for value in values[lengths : lengths + 2])
    of_lens: LensModel = "kannala-brandt" if "FISHEYE" in model else "brown-conrady"
    stated = dict(zip(given, values[lengths + 2 :], strict=True))
    distortion = in_order(stated, of_lens)
    return _made(_pinhole(fx, fy, cx, cy), (width, height), distortion, source, of_lens)


# ---- tables


def _named(content: Any) -> Table:
    """The table with names of small letters and digits alone."""
    return plain_table(_as_matlab(content))


def _as_matlab(content: Table) -> Table:
    """What the structures of MATLAB's calibrator say, in the words of OpenCV; others as they are.

    MATLAB's first pixel is at (1, 1), its size is rows first, its older matrix is transposed.
    """
    lengths, centre = (
        numbers_of(content.get("FocalLength")),
        numbers_of(content.get("PrincipalPoint")),
    )
    if lengths is None or centre is None:
        K = numbers_of(content.get("IntrinsicMatrix"))
        if K is None or K.shape != (3, 3):
            return content
        K = _square(K)
    elif lengths.size == centre.size == 2:
        K = _pinhole(*lengths, *centre)
        K[0, 1] = number_of(content.get("Skew")) or 0.0
    else:
        return content
    K[:2, 2] -= 1.0
    table: Table = {"K": K.tolist()}
    rows_columns = numbers_of(content.get("ImageSize"))
    if rows_columns is not None and rows_columns.size == 2:
        table |= {"height": float(rows_columns[0]), "width": float(rows_columns[1])}
    for key, names in (("RadialDistortion", "k1 k2 k3"), ("TangentialDistortion", "p1 p2")):
        values = numbers_of(content.get(key))
        if values is not None and values.any():
            table |= dict(zip(names.split(), values.tolist(), strict=False))
    return table


def _of_contents(
    text: str,
    source: str,
    tables: Callable[[Any], Iterator[Table]],
    size: Size | None,
    others: str = DEPTH,
) -> Camera | None:
    """The camera of the first kind of content of a text that states one.

    others : words of the names of what is of other cameras
    """
    with parsing(source, "no camera matrix", CaptureError):
        for content in contents(text, source):
            camera = _of_tables(tables(content), source, size)
            if camera is not None and camera.distortion is None:
                _check_no_lens_left(content, source, others)
            if camera is not None:
                return camera
    return None


def _check_no_lens_left(content: Any, source: str, others: str) -> None:
    """Raise CaptureError where a content states a lens that is of none of its cameras."""
    name = next(_lenses_left(content, others), None)
    if name is not None:
        raise CaptureError(
            "not clear of which camera the distortion is",
            source=source,
            seen=name,
            needed="the distortion in the table of fx, fy, cx, cy or of the matrix, or beside it",
            remedy="move it there, or take it out where the lens does not distort",
        )


def _of_tables(tables: Iterable[Table], source: str, size: Size | None) -> Camera | None:
    """The one camera that some tables state; of several the one of `size`."""
    found = {camera for table in tables if (camera := _of_table(table, source))}
    if len(found) > 1:
        found = {each for each in found if (each.width, each.height) == size} or found
    if len(found) > 1:
        raise _several(len(found), source)
    return next(iter(found), None)


def _several(count: int, source: str) -> CaptureError:
    return CaptureError(
        "several camera matrices",
        source=source,
        seen=f"{count} of them",
        needed="that of the photographs' camera as camera_matrix",
        remedy="keep that one",
    )


def _tables(
    content: Any, nested: int = 0, skipped: str = DEPTH, beside: Table | None = None
) -> Iterator[Table]:
    """The tables in a table but those of the depth, and what is of the colour in each.

    beside : what is stated of their lens in the table around them
    """
    if isinstance(content, dict):
        table = with_lens(_named(content), beside or {})
        lenses, _ = _lenses_beside(table)
        yield with_lens(table, lenses[""])
        yield with_lens(_sided(table, COLOR), lenses[COLOR])
        if nested < _NESTED:
            for key, value in table.items():
                if isinstance(value, dict) and KANNALA_BRANDT.fullmatch(key):
                    value = {"model": key, **value}
                if not (skipped and re.search(skipped, key)):
                    yield from _tables(value, nested + 1, skipped, lenses[_side(key)])


def _depth_tables(content: Any, nested: int = 0, beside: Table | None = None) -> Iterator[Table]:
    """What is of the depth in a table and in those in it."""
    if isinstance(content, dict):
        table = with_lens(_named(content), beside or {})
        lenses, _ = _lenses_beside(table)
        sided = with_lens(_sided(table, DEPTH), lenses[DEPTH])
        yield sided
        for value in sided.values():
            yield from _tables(value, nested + 1, skipped="", beside=lenses[DEPTH])
        if nested < _NESTED:
            for key, value in table.items():
                if not re.search(DEPTH, key):
                    yield from _depth_tables(value, nested + 1, lenses[""])


def _lenses_beside(table: Table) -> tuple[dict[str, Table], dict[str, Table]]:
    """What a table states of the lenses of the cameras in it, and of lenses of none, by their side.

    A side is the words of the names: those of the colour, of the depth, or none.  A lens of no side
    is that of the cameras of no side, else of the only side there is; that of the colour is that
    of the cameras of no side, too.
    """
    plain = {key: value for key, value in table.items() if not SIDES.search(key)}
    parts = {"": plain, COLOR: _sided(table, COLOR), DEPTH: _sided(table, DEPTH)}
    lenses = {words: lens_part(part) for words, part in parts.items()}
    if not any(lenses.values()):
        return lenses, {}
    cameras = [words for words, part in parts.items() if _holds_camera(part)]
    if _has_matrix(plain) and lenses[""]:
        return {**lenses, "": {}}, {}  # its own
    if "" not in cameras and len(cameras) == 1 and not lenses[cameras[0]]:
        lenses[cameras[0]], lenses[""] = lenses[""], {}
    elif "" in cameras and not lenses[""]:
        lenses[""] = lenses[COLOR]
        cameras.append(COLOR)
    left = {words: lens for words, lens in lenses.items() if words not in cameras}
    return {**lenses, **dict.fromkeys(left, Table())}, left


def _lenses_left(
    content: Any, others: str, nested: int = 0, beside: Table | None = None
) -> Iterator[str]:
    """The names of what is stated of lenses, but for others', and is of no camera."""
    if isinstance(content, dict):
        table = with_lens(_named(content), beside or {})
        lenses, left = _lenses_beside(table)
        for words, lens in left.items():
            yield from sure_names(lens) if words != others else ()
        for key, value in table.items() if nested < _NESTED else ():
            if isinstance(value, dict) and not is_lens(key) and not re.search(others, key):
                inner = lenses[_side(key)] if _holds_camera(_named(value)) else None
                yield from _lenses_left(value, others, nested + 1, inner)


def _side(key: str) -> str:
    """The words of the camera that a name is of, see `_lenses_beside`."""
    return next((words for words in (COLOR, DEPTH) if _sided({key: None}, words)), "")


def _lens_tables(content: Any, nested: int = 0) -> Iterator[Table]:
    """The tables in a table that state a lens, the outer ones alone."""
    if isinstance(content, dict):
        table = _named(content)
        if lens_part(table):
            yield table
        elif nested < _NESTED:
            for value in table.values():
                yield from _lens_tables(value, nested + 1)


def _holds_camera(table: Table, nested: int = 0) -> bool:
    """Whether a table has a camera matrix, or one in it."""
    if _has_matrix(table):
        return True
    inner = (_named(each) for each in table.values() if isinstance(each, dict))
    return nested < _NESTED and any(_holds_camera(each, nested + 1) for each in inner)


def _has_matrix(table: Table) -> bool:
    """Whether a table states the matrix of a camera, or several: what is refused elsewhere."""
    try:
        return _matrix(table, "") is not None
    except CaptureError:
        return True


def _sided(table: Table, words: str) -> Table:
    """What the names say that is of one camera, without these words: fx_color, depth_width.

    A pose, color2depth, is of no camera; k2_color is a coefficient of its lens.
    """
    ends = re.compile(f"^(?:{words})|(?:{words})$")
    sided = [(ends.sub("", key), key) for key in table if ends.search(key)]
    return {
        name: table[key] for name, key in sided if BY_NAME.fullmatch(name) or not _POSE.search(key)
    }


def _of_table(table: Table, source: str) -> Camera | None:
    with parsing(source, "no camera matrix", CaptureError):
        K = _matrix(table, source)
        if K is None:
            return None
        prefix = "camera1?" if "camerafx" in table or "camera1fx" in table else ""
        scalars = {
            re.sub(f"^{prefix}", "", key): value
            for key, value in table.items()
            if number_of(value) is not None
        }
        sizes = tuple(
            next((number_of(scalars[key]) or 0.0 for key in keys if key in scalars), 0.0)
            for keys in (_WIDTH_KEYS, _HEIGHT_KEYS)
        )
        pairs = (numbers_of(table.get(key)) for key in _SIZE_KEYS)
        both = next((each for each in pairs if each is not None and each.size == 2), None)
        if not all(sizes) and both is not None:
            sizes = float(both[0]), float(both[1])
        coefficients, model = coefficients_of(table, source)
    return _made(K, (sizes[0], sizes[1]), coefficients, source, model)


def _matrix(table: Table, source: str) -> Floats | None:
    """(3, 3) by its name, or of focal lengths and centre; else the only one that looks like one."""
    for key in _MATRIX_KEYS:
        numbers = numbers_of(table.get(key), source, key)
        if numbers is None:
            continue
        if numbers.size in (9, 16):
            return _square(numbers)
        if numbers.size == 4 and key != "k":  # Kalibr's
            return _pinhole(*numbers.ravel())
    for key in ("p2", "prect02"):  # KITTI's camera in colour, on the left
        numbers = numbers_of(table.get(key))
        if numbers is not None and numbers.size == 12:
            return numbers.reshape(3, 4)[:, :3]
    for fx, fy, cx, cy, first_pixel in (
        ("fx", "fy", "cx", "cy", 0.0),
        ("fx", "fy", "ppx", "ppy", 0.0),
        ("camerafx", "camerafy", "cameracx", "cameracy", 0.0),
        ("camera1fx", "camera1fy", "camera1cx", "camera1cy", 0.0),
        ("flx", "fly", "cx", "cy", 0.5),  # nerfstudio's, which are COLMAP's
        ("fx", "fy", "mx", "my", 0.0),  # ScanNet's
    ):
        stated = [number_of(table.get(key)) for key in (fx, cx, cy)]
        if None not in stated:
            f, x, y = (float(each) for each in stated if each is not None)
            return _pinhole(f, number_of(table.get(fy)) or f, x - first_pixel, y - first_pixel)
    matrices = (numbers_of(v, source, k) for k, v in table.items() if isinstance(v, dict))
    square = [m for m in matrices if m is not None and m.shape == (3, 3) and m[2, 2] == 1]
    if len(square) > 1:
        raise _several(len(square), source)
    return square[0] if square else None
