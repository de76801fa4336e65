"""Intrinsics in the files of other programs.

OpenCV, ROS, Kalibr, ORB-SLAM, RealSense, Open3D, COLMAP, nerfstudio, Metashape, MATLAB, KITTI,
ScanNet, and plain numbers.  Texts become tables (text_tables.py), in which matrices and numbers are
looked for by their names.
"""

from __future__ import annotations

import re
from collections import ChainMap
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rakelight.capture import npy
from rakelight.capture.text_tables import NUMBER, Table, contents, text_of
from rakelight.errors import CaptureError, parsing, stated_in
from rakelight.files import read_bytes
from rakelight.model import Camera, Distortion, Floats, LensModel

MAX_BYTES = 5_000_000
"""Of a file with intrinsics: they take some thousand, the poses beside them megabytes."""

SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt", ".csv")

_MATRIX_KEYS = (
    "cameramatrix", "intrinsicmatrix", "intrinsics", "k", "camk", "mtx", "cameramatrix1",
)  # fmt: skip
_DISTORTION_KEYS = re.compile(r"dist(ortion)?(coef\w*|param\w*)?|d|coeffs")
_OTHERS_TOO = ("d", "dist", "coeffs")  # of these: one number alone under them is something else
_NOT_ZERO = re.compile(r"[1-9]|\b(?:nan|inf)\b", re.IGNORECASE)
_MODEL_KEYS = ("distortionmodel", "distmodel", "cameramodel", "cameratype", "model")
# Whether the model is the fisheye's: OpenCV's calibration sample, instant-ngp.
_FISHEYE_KEYS = ("fisheyemodel", "isfisheye", "usefisheye", "fisheye")
_WIDTH_KEYS, _HEIGHT_KEYS = ("imagewidth", "width", "w"), ("imageheight", "height", "h")
_SIZE_KEYS = ("resolution", "imagesize", "size")
# Pixels, and coefficients of a lens, by which one camera differs in two files.
_ROUNDING = np.array([0.005] * 4 + [1e-5] * 8)
_NESTED = 3  # tables within tables that are looked into

# Models of distortion by the words of their names, OpenCV's coefficients in OpenCV's order.
_BROWN_CONRADY = re.compile("|".join((
    "", "plumbbob", "radtan", "radialtangential", "rationalpolynomial", "(simple)?pinhole",
    "perspective",
    "(simple)?radial", "(full)?opencv", "(distortion)?(none|brownconrady)",
)))  # fmt: skip
_INVERSE = re.compile("(distortion)?inversebrownconrady")
_KANNALA_BRANDT = re.compile("equidistant|(opencv)?fisheye|(distortion)?kannalabrandt[0-9]?")

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
_ORDERS: dict[LensModel, tuple[str, ...]] = {
    "brown-conrady": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "inverse-brown-conrady": ("k1", "k2", "p1", "p2", "k3"),
    "kannala-brandt": ("k1", "k2", "k3", "k4"),
}

Size = tuple[int, int]

_DEPTH = "depth|infra(?:red)?1?"
_COLOR = "colou?r|rgb"
# In names of what is no camera, color2depth; k2_color is a coefficient of its lens.
_POSE = re.compile(r"(?:to|(?<!^[kp])2)(?:depth|infra|colou?r|rgb)")


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
    of_depth = re.search(f"{_DEPTH}|(?<![a-z])ir(?![a-z])", name)
    return of_depth is not None and not re.search(_COLOR, name.replace("rgbd", ""))


def may_state(path: Path) -> bool:
    """Whether intrinsics are looked for in a file of this name: a text, or an array of that name.

    >>> [may_state(Path(name)) for name in ("poses.txt", "K.npy", "depth.npy")]
    [True, True, False]
    """
    suffix = path.suffix.lower()
    return suffix in SUFFIXES or (suffix == ".npy" and named_intrinsics(path.stem))


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
        K = npy.decode_npy(data, source)
        return _made(K, (0, 0), (), source) if K.shape == (3, 3) else None
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
    found = None if text is None else _of_contents(text, source, _depth_tables, size)
    if found is not None or not whole:
        return found
    return parse_intrinsics(data, source, named, size)


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
    lines = (line.split("#")[0] for line in text.splitlines())
    words = re.sub(r"[\s,;\[\]]+", " ", " ".join(lines)).split()
    if len(words) not in (4, 8, 9, 16) or not all(re.fullmatch(NUMBER, word) for word in words):
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
    distortion = _in_order(stated, of_lens)
    return _made(_pinhole(fx, fy, cx, cy), (width, height), distortion, source, of_lens)


def _in_order(stated: Mapping[str, float], model: LensModel) -> list[float]:
    """Coefficients by their names in the model's order; none where none is stated."""
    order = _ORDERS[model]
    given = any(name in stated for name in order)
    return [float(stated.get(name, 0.0)) for name in order] if given else []


# ---- tables


def plain_key(key: object) -> str:
    """A name by its small letters and digits alone."""
    return re.sub("[^a-z0-9]", "", str(key).lower())


def _named(content: Any) -> Table:
    """The table with names of small letters and digits alone."""
    return {plain_key(key): value for key, value in _as_matlab(content).items()}


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
        K[0, 1] = _number(content.get("Skew")) or 0.0
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
    text: str, source: str, tables: Callable[[Any], Iterator[Table]], size: Size | None
) -> Camera | None:
    """The camera of the first kind of content of a text that states one."""
    found = (_of_tables(tables(each), source, size) for each in contents(text, source))
    with parsing(source, "no camera matrix", CaptureError):
        return next(filter(None, found), None)


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


def _tables(content: Any, nested: int = 0, skipped: str = _DEPTH) -> Iterator[Table]:
    """The tables in a table but those of the depth, and what is of the colour in each."""
    if isinstance(content, dict):
        table = _named(content)
        yield table
        yield _sided(table, _COLOR)
        if nested < _NESTED:
            for key, value in table.items():
                if isinstance(value, dict) and _KANNALA_BRANDT.fullmatch(key):
                    value = {"model": key, **value}
                if not (skipped and re.search(skipped, key)):
                    yield from _tables(value, nested + 1, skipped)


def _depth_tables(content: Any, nested: int = 0) -> Iterator[Table]:
    """What is of the depth in a table and in those in it."""
    if isinstance(content, dict):
        table = _named(content)
        sided = _sided(table, _DEPTH)
        yield sided
        for value in sided.values():
            yield from _tables(value, nested + 1, skipped="")
        if nested < _NESTED:
            for key, value in table.items():
                if not re.search(_DEPTH, key):
                    yield from _depth_tables(value, nested + 1)


def _sided(table: Table, words: str) -> Table:
    """What the names say that is of one camera, without these words: fx_color, depth_width."""
    ends = re.compile(f"^(?:{words})|(?:{words})$")
    return {
        ends.sub("", key): value
        for key, value in table.items()
        if ends.search(key) and not _POSE.search(key)
    }


def _of_table(table: Table, source: str) -> Camera | None:
    with parsing(source, "no camera matrix", CaptureError):
        K = _matrix(table, source)
        if K is None:
            return None
        prefix = "camera1?" if "camerafx" in table or "camera1fx" in table else ""
        coefficients = {k: v for k, v in table.items() if _DISTORTION_KEYS.fullmatch(k)}
        tables = (_named(each) for each in coefficients.values() if isinstance(each, dict))
        whole = ChainMap(table, *tables)
        scalars = {
            re.sub(f"^{prefix}", "", key): value
            for key, value in whole.items()
            if _number(value) is not None
        }
        sizes = tuple(
            next((_number(scalars[key]) or 0.0 for key in keys if key in scalars), 0.0)
            for keys in (_WIDTH_KEYS, _HEIGHT_KEYS)
        )
        pairs = (numbers_of(table.get(key)) for key in _SIZE_KEYS)
        both = next((each for each in pairs if each is not None and each.size == 2), None)
        if not all(sizes) and both is not None:
            sizes = float(both[0]), float(both[1])
        name = _model(whole)
        model = _model_called(name)
        lists = (_coefficients(key, value, source) for key, value in coefficients.items())
        distortion: Any = next((each for each in lists if each is not None), None)
        if distortion is None:
            distortion = _in_order(scalars, model or "brown-conrady")
    if np.any(distortion) and model is None:
        raise CaptureError(
            "this model of distortion is not read",
            source=source,
            seen=name[:60],
            needed="OpenCV's, its fisheye model, librealsense's inverse Brown-Conrady, or none",
            remedy="calibrate with one of these",
        )
    return _made(K, (sizes[0], sizes[1]), distortion, source, model or "brown-conrady")


def _model_called(name: str) -> LensModel | None:
    """The model that another program calls so; None where it is none that is read."""
    if _KANNALA_BRANDT.fullmatch(plain_key(name)):
        return "kannala-brandt"
    if _INVERSE.fullmatch(plain_key(name)):
        return "inverse-brown-conrady"
    return "brown-conrady" if _BROWN_CONRADY.fullmatch(plain_key(name)) else None


def _model(table: Mapping[str, Any]) -> str:
    """The name of the model of distortion that a table states, or says to be the fisheye's."""
    model = next((table[key] for key in _MODEL_KEYS if isinstance(table.get(key), str)), "")
    word = table.get("distortion")
    if not model and isinstance(word, str) and not _words(word):
        model = word
    flags = (str(table.get(key, "")).strip().lower() for key in _FISHEYE_KEYS)
    if not any(flag == "true" or _number(flag) for flag in flags):
        return model
    if plain_key(model) in ("", "pinhole", "perspective"):
        return "fisheye"
    return model if _KANNALA_BRANDT.fullmatch(plain_key(model)) else f"{model}, and fisheye"


def _words(text: str) -> list[str]:
    """The numbers of a text such as "0.1 -0.2, 0"; none where there is anything else in it."""
    words = re.sub(r"[\s,;\[\]()]+", " ", text).split()
    return words if all(re.fullmatch(NUMBER, word) for word in words) else []


def _coefficients(key: str, value: Any, source: str) -> Floats | None:
    """What stands under a name of distortion as a list; None where it states none.

    Raises CaptureError where it states numbers in a way that is not read.
    """
    if key in _OTHERS_TOO and _number(value) is not None:
        return None
    if isinstance(value, str):
        listed = _words(value) or value
    else:
        listed = value if _number(value) is None else [value]
    numbers = numbers_of(listed, source, key)
    names = _ORDERS["brown-conrady"]
    by_name = isinstance(value, dict) and any(name in _named(value) for name in names)
    if numbers is not None or by_name or key in _OTHERS_TOO:
        return numbers
    stated = str(list(value.values()) if isinstance(value, dict) else value)
    if _NOT_ZERO.search(stated) and not _KANNALA_BRANDT.fullmatch(plain_key(value)):
        raise CaptureError(
            "the distortion is not understood",
            source=source,
            seen=f"{key} {stated[:60]}",
            needed="OpenCV's coefficients: a list of numbers, or k1, k2, p1, p2, k3 by name",
            remedy="write it so, or take it out where the lens does not distort",
        )
    return None


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
        stated = [_number(table.get(key)) for key in (fx, cx, cy)]
        if None not in stated:
            f, x, y = (float(each) for each in stated if each is not None)
            return _pinhole(f, _number(table.get(fy)) or f, x - first_pixel, y - first_pixel)
    matrices = (numbers_of(v, source, k) for k, v in table.items() if isinstance(v, dict))
    square = [m for m in matrices if m is not None and m.shape == (3, 3) and m[2, 2] == 1]
    if len(square) > 1:
        raise _several(len(square), source)
    return square[0] if square else None


def _number(value: Any) -> float | None:
    """Of a number, or of text that is one: PyYAML takes 1e3 for text."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    return float(value) if re.fullmatch(NUMBER, str(value)) else None


def numbers_of(value: Any, source: str = "", name: str = "") -> Floats | None:
    """A list of numbers, of rows, or a matrix with rows, cols and data; None for anything else."""
    shape: Any = None
    if isinstance(value, dict):
        inner = _named(value)
        shape, value = (inner.get("rows"), inner.get("cols")), inner.get("data")
    if not isinstance(value, list) or not value:
        return None
    rows = value if isinstance(value[0], list) else [value]
    read = [[_number(each) for each in row] for row in rows if isinstance(row, list)]
    if len({len(row) for row in read}) != 1 or any(None in row for row in read):
        return None
    numbers = np.array(read, np.float64)
    if shape is None or None in shape:
        return numbers if len(rows) > 1 else numbers[0]
    if numbers.size != shape[0] * shape[1]:
        raise CaptureError(
            f"matrix {name!r} is damaged",
            source=source,
            seen=f"{numbers.size} numbers",
            needed=f"{shape[0]} x {shape[1]}",
            remedy="copy or export the file again",
        )
    return numbers.reshape(shape)
