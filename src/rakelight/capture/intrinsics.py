"""Intrinsics in the files of other programs: OpenCV, ROS, Open3D, COLMAP, a 3 x 3 matrix.

Looked for in their text.  Nothing is evaluated; no tag, anchor or entity of YAML or XML is
followed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from rakelight.errors import CaptureError, parsing, stated_in
from rakelight.model import Camera, Distortion, Floats

MAX_BYTES = 100_000
"""Of a file with intrinsics: they take some thousand."""

SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt", ".csv")

_NUMBER = r"[-+]?(?:[0-9]{1,30}\.?[0-9]{0,30}|\.[0-9]{1,30})(?:[eE][-+]?[0-9]{1,3})?"
_MATRIX_KEYS = ("cameramatrix", "intrinsicmatrix", "intrinsics", "k", "mtx", "cameramatrix1")
_DISTORTION_KEYS = re.compile(r"dist.*|d")
_WIDTH_KEYS, _HEIGHT_KEYS = ("imagewidth", "width", "w"), ("imageheight", "height", "h")

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
_OPENCV_ORDER = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_FISHEYE_ORDER = ("k1", "k2", "k3", "k4")


def parse_intrinsics(data: bytes, source: str = "") -> Camera | None:
    """The intrinsics that a file states; None where it is no such file.

    Raises CaptureError where it states some that are none: several cameras, another model, numbers
    that are not finite, a matrix with skew.

    >>> parse_intrinsics(b"500 0 319.5 0 500 239.5 0 0 1").fx
    500.0
    >>> parse_intrinsics(b"1 SIMPLE_RADIAL 640 480 500 320 240 0.01").cx
    319.5
    >>> parse_intrinsics(b"a shopping list") is None
    True
    """
    if len(data) > MAX_BYTES:
        return None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    start = text.lstrip()[:1]
    parsers: tuple[Callable[[str, str], Camera | None], ...] = (_colmap, _plain, _yaml)
    if start in ("{", "<"):
        parsers = (_json,) if start == "{" else (_xml,)
    for parse in parsers:
        found = parse(text, source)
        if found is not None:
            return found
    return None


def _made(K: Any, sizes: tuple[float, float], distortion: Any, model: str, source: str) -> Camera:
    """The camera of a matrix (3, 3) and coefficients in OpenCV's order, checked."""
    width, height = (int(side) if 0 < side < 1e6 else 0 for side in sizes)
    lens: Any = tuple(float(value) for value in np.ravel(distortion))
    with stated_in(source):
        if not any(lens):
            lens = None
        elif model == "kannala-brandt":
            lens = Distortion("kannala-brandt", lens)
        camera = Camera.from_matrix(np.asarray(K, np.float64), (height or 1, width or 1), lens)
    return replace(camera, width=width, height=height)


def _floats(text: str) -> list[float]:
    return [float(number) for number in re.findall(_NUMBER, text)]


def _plain(text: str, source: str) -> Camera | None:
    """Nine numbers, rows first, and nothing else."""
    lines = (line.split("#")[0] for line in text.splitlines())
    words = re.sub(r"[\s,;\[\]]+", " ", " ".join(lines)).split()
    if len(words) != 9 or not all(re.fullmatch(_NUMBER, word) for word in words):
        return None
    K = np.array(words, np.float64).reshape(3, 3)
    return _made(K, (0, 0), (), "brown-conrady", source) if K[2, 2] == 1 else None


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
    if not all(re.fullmatch(_NUMBER, number) for number in numbers):
        raise CaptureError(
            "not numbers",
            source=source,
            seen=" ".join(numbers),
            remedy="copy or export the file again",
        )
    width, height, *values = map(float, numbers)
    fx, fy = values[0], values[lengths - 1]
    cx, cy = (value - 0.5 for value in values[lengths : lengths + 2])
    fisheye = "FISHEYE" in model
    stated = dict(zip(given, values[lengths + 2 :], strict=True))
    order = _FISHEYE_ORDER if fisheye else _OPENCV_ORDER
    distortion = [stated.get(name, 0.0) for name in order] if stated else []
    K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    kind = "kannala-brandt" if fisheye else "brown-conrady"
    return _made(K, (width, height), distortion, kind, source)


def _plain_key(key: str) -> str:
    return re.sub("[^a-z0-9]", "", key.lower())


def _yaml(text: str, source: str) -> Camera | None:
    """cv::FileStorage's YAML and ROS's camera_info: matrices with rows, cols and data."""
    matrix = re.compile(
        r"^[ \t]*(\w{1,60}):[^\n]{0,60}\n\s*rows:\s*(\d{1,3})\s*\n\s*cols:\s*(\d{1,3})\s*\n"
        r"(?:\s*dt:[^\n]{0,9}\n)?\s*data:\s*\[([^\]]*)\]",
        re.MULTILINE,
    )
    found = [(m[1], int(m[2]), int(m[3]), m[4]) for m in matrix.finditer(text)]
    scalars = re.findall(rf"^[ \t]*(\w{{1,60}}):\s*({_NUMBER})\s*$", text, re.MULTILINE)
    words = re.search(r"^[ \t]*distortion_model:\s*\"?(\w{1,40})", text, re.MULTILINE)
    return _of_matrices(found, scalars, words[1] if words else "", source)


def _xml(text: str, source: str) -> Camera | None:
    """cv::FileStorage's XML."""
    matrix = re.compile(
        r"<(\w{1,60}) type_id=\"opencv-matrix\">\s*<rows>(\d{1,3})</rows>\s*"
        r"<cols>(\d{1,3})</cols>\s*<dt>\w{1,3}</dt>\s*<data>([^<]*)</data>"
    )
    found = [(m[1], int(m[2]), int(m[3]), m[4]) for m in matrix.finditer(text)]
    scalars = re.findall(rf"<(\w{{1,60}})>\s*({_NUMBER})\s*</", text)
    return _of_matrices(found, scalars, "", source)


def _of_matrices(
    found: list[tuple[str, int, int, str]],
    scalars: list[tuple[str, str]],
    model: str,
    source: str,
) -> Camera | None:
    """Intrinsics among named matrices (name, rows, columns, text of the numbers)."""
    matrices: dict[str, Floats] = {}
    for name, rows, columns, numbers in found:
        values = _floats(numbers)
        if len(values) != rows * columns:
            raise CaptureError(
                f"matrix {name!r} is damaged",
                source=source,
                seen=f"{len(values)} numbers",
                needed=f"{rows} x {columns}",
                remedy="copy or export the file again",
            )
        matrices[_plain_key(name)] = np.array(values).reshape(rows, columns)
    named = [m for key, m in matrices.items() if key in _MATRIX_KEYS and m.shape == (3, 3)]
    square = named or [m for m in matrices.values() if m.shape == (3, 3) and m[2, 2] == 1]
    if not square:
        return None
    if len(square) > 1:
        raise CaptureError(
            "several camera matrices",
            source=source,
            seen=f"{len(square)} of them",
            needed="that of the photographs' camera as camera_matrix",
            remedy="keep that one",
        )
    numbers_of = {_plain_key(name): float(value) for name, value in scalars}
    sizes = tuple(
        next((numbers_of[key] for key in keys if key in numbers_of), 0.0)
        for keys in (_WIDTH_KEYS, _HEIGHT_KEYS)
    )
    distortion = [m for key, m in matrices.items() if _DISTORTION_KEYS.fullmatch(key)]
    fisheye = model in ("equidistant", "fisheye")
    return _made(
        square[0],
        (sizes[0], sizes[1]),
        distortion[0] if distortion else (),
        "kannala-brandt" if fisheye else "brown-conrady",
        source,
    )


def _json(text: str, source: str) -> Camera | None:
    """Open3D's (its matrix goes column by column), cv::FileStorage's, or a matrix by name."""
    with parsing(source, "not valid JSON", CaptureError):
        content = json.loads(text)
        named = {_plain_key(key): value for key, value in content.items()}
    keys = [key for key in _MATRIX_KEYS if isinstance(named.get(key), list | dict)]
    if not keys:
        return None
    with parsing(source, "no camera matrix", CaptureError):
        stated = named[keys[0]]
        values = stated["data"] if isinstance(stated, dict) else stated
        flat = isinstance(values[0], int | float)
        K = np.array(values, np.float64).reshape(3, 3)
        if flat and not isinstance(stated, dict):  # Open3D's
            K = K.T
        sizes = tuple(
            next((float(named[key]) for key in keys if key in named), 0.0)
            for keys in (_WIDTH_KEYS, _HEIGHT_KEYS)
        )
        others = [v for k, v in named.items() if _DISTORTION_KEYS.fullmatch(k)]
        distortion = others[0] if others else []
        distortion = distortion["data"] if isinstance(distortion, dict) else distortion
        coefficients = np.array(distortion, np.float64).ravel()
    return _made(K, (sizes[0], sizes[1]), coefficients, "brown-conrady", source)
