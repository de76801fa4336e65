"""The pose of a depth camera in the files of other programs, where names say what of which.

A name such as depth_to_color, color2depth or colorToDepthExtrinsics, of a table, a matrix or the
file, says from which camera to which.  Librealsense's rotations have columns first, others rows:
nine numbers in a row are taken only where that is said, or makes no difference.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from rakelight.capture import validate
from rakelight.capture.intrinsics import small_text
from rakelight.capture.text_tables import contents, numbers_alone, numbers_of, plain_key, text_of
from rakelight.errors import CaptureError, InputError, parsing
from rakelight.model import Floats, RigidTransform

_DEPTH_FIRST = re.compile(r"(depth|infra1?)\w{0,12}?(to|2)\w{0,6}?(colou?r|rgb)")
_COLOR_FIRST = re.compile(r"(colou?r|rgb)\w{0,12}?(to|2)\w{0,6}?(depth|infra)")
_NESTED = 3  # tables within tables that are looked into
_ALIKE = 1e-3  # largest difference of a rotation from its transpose that is none
_LARGEST = 1e6  # number in a pose, far beyond what one holds: its square is finite
_MILLIMETRES = 1000.0  # of a baseline beyond a metre, in each metre
# Metres in each unit of length, by the words of names.
_UNITS = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetre", "centimetres"), 1e-2),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), 1e-3),
}
_TRANSLATION = re.compile("trans|t(?:in)?(?:" + "|".join(("", *_UNITS)) + ")$")
# Units of which lengths are not read; other words, as SI, state none.
_OTHER_LENGTHS = re.compile(
    r"in|inch(?:es)?|ft|foot|feet|yards?|[dknu]m|(?:deci|kilo|micro|nano)met\w*|microns?|px|pixels?"
)
_UNIT_KEYS = ("unit", "units", "translationunit", "translationunits")


def depth_to_color(data: bytes, source: str, stem: str) -> list[RigidTransform | None]:
    """Every pose of the depth camera against the colour camera that a file states.

    stem : the file's name, without ending
    None stands for one that is stated in a way that is not clear.

    >>> text = b"1 0 0 15 0 1 0 0 0 0 1 0"
    >>> depth_to_color(text, "depth2color.txt", "depth2color")[0].translation_m.tolist()
    [0.015, 0.0, 0.0]
    """
    text = small_text(data)
    if text is None:
        return []
    if words := _matrix_words(text):
        return _stated({stem: words})
    with parsing(source, "no pose of a camera", CaptureError):
        for content in contents(text, source):
            if found := _stated({stem: content}) or _stated(content):
                return found
    return []


def is_identity(data: bytes) -> bool:
    """Whether a text is the matrix of no motion, of which it does not matter from what to what.

    >>> is_identity(b"1 0 0 0\\n0 1 0 0\\n0 0 1 0\\n0 0 0 1"), is_identity(b"1 0 0 0")
    (True, False)
    """
    words = _matrix_words(text_of(data) or "")
    return bool(words) and np.array_equal(np.array(words, float), np.eye(4).ravel()[: len(words)])


def _matrix_words(text: str) -> list[str]:
    """The 12 or 16 numbers that a text is; empty where it is another."""
    words = numbers_alone(text)
    return words if len(words) in (12, 16) else []


def _stated(content: Any, nested: int = 0) -> list[RigidTransform | None]:
    """The poses under names that say so, in a table and those in it."""
    if not isinstance(content, dict) or nested > _NESTED:
        return []
    found: list[RigidTransform | None] = []
    for key, value in content.items():
        name = plain_key(key)
        inverse = _COLOR_FIRST.search(name) is not None
        if not inverse and not _DEPTH_FIRST.search(name):
            found += _stated(value, nested + 1)
        elif isinstance(value, (dict, list)):
            pose = _pose(value, str(key))
            if pose is not None and inverse:
                turned = pose.rotation.T
                pose = RigidTransform(turned, -turned @ pose.translation_m)
            found.append(pose)
    return found


def _pose(value: Any, name: str) -> RigidTransform | None:
    """Of a table with rotation and translation, or of a matrix of four columns; None if unclear.

    name : what it stands under
    """
    numbers = numbers_of(value)
    if numbers is not None and numbers.size in (12, 16):
        matrix = numbers.reshape(-1, 4)
        if len(matrix) == 4 and not matrix[3, :3].any():
            matrix = matrix[:3]
        elif len(matrix) == 4:
            matrix = matrix.T[:3]
        return _checked(matrix[:, :3], matrix[:, 3], _unit_in(name))
    if not isinstance(value, dict):
        return None
    names = {plain_key(key): str(key) for key in value}
    parts = {plain_key(key): each for key, each in value.items()}
    unit = _unit_stated(parts)
    if _OTHER_LENGTHS.fullmatch(unit):
        return None
    name = f"{name} {unit}" if unit in _UNITS else name
    rotations = [key for key in parts if key == "r" or key.startswith("rot")]
    translations = [key for key in parts if _TRANSLATION.match(key) and key not in _UNIT_KEYS]
    if len(rotations) != 1 or len(translations) != 1:
        inner = [_pose(each, name) for each in parts.values() if isinstance(each, (dict, list))]
        return inner[0] if len(inner) == 1 else None
    rotation = numbers_of(parts[rotations[0]])
    translation = numbers_of(parts[translations[0]])
    if rotation is None or translation is None or (rotation.size, translation.size) != (9, 3):
        return None
    stated = rotations[0] + plain_key(name)
    square = rotation.reshape(3, 3)
    if rotation.ndim == 1 and "row" not in stated:
        if "col" not in rotations[0] and np.abs(square - square.T).max() > _ALIKE:
            return None
        square = square.T
    unit_m = _unit_in(names[translations[0]]) or _unit_in(name)
    return _checked(square, translation.ravel(), unit_m)


def _unit_stated(parts: dict[str, Any]) -> str:
    """What stands under unit or units, or there under translation; "" where neither does."""
    unit = next((parts[key] for key in _UNIT_KEYS if key in parts), "")
    if isinstance(unit, dict):
        unit = next((each for key, each in unit.items() if _TRANSLATION.match(plain_key(key))), "")
    return plain_key(re.sub("[µμ]", "u", str(unit)))


def _unit_in(name: str) -> float | None:
    """Metres in the unit that a name ends in; None where it does not.

    >>> [_unit_in(name) for name in ("translation_cm", "tInMillimeters", "T (m)", "transform")]
    [0.01, 0.001, 1.0, None]
    """
    *others, last = re.findall("[A-Z]?[a-z]+|[A-Z]+", name) or [""]
    return _UNITS.get(last.lower()) if others and last != "M" else None  # M is a matrix


def _checked(rotation: Floats, translation: Floats, unit_m: float | None) -> RigidTransform | None:
    """The pose in metres; None where it is none.

    unit_m : metres in the unit of the translation; None where it is not stated
    """
    if unit_m is not None:
        translation = translation * unit_m
    if not max(np.abs(rotation).max(), np.abs(translation).max()) < _LARGEST:
        return None
    if unit_m is None and np.linalg.norm(translation) > validate.LONGEST_BASELINE_M:
        translation = translation / _MILLIMETRES
    pose = RigidTransform(rotation, translation)
    try:
        validate.check_transform(pose, "")
    except InputError:
        return None
    u, _, vt = np.linalg.svd(rotation)
    return RigidTransform(u @ vt, translation)
