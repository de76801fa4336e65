"""What tables of other programs state of a lens: its model and its coefficients, by their names.

Coefficients are a list in OpenCV's order, or k1, k2, p1, p2 ... by name.  Numbers under other names
of a lens (radial_distortion, lensDistortion) are refused: their order differs from one program to
the next.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from rakelight.capture.text_tables import (
    Table,
    number_of,
    numbers_alone,
    numbers_of,
    plain_key,
    plain_table,
)
from rakelight.errors import CaptureError
from rakelight.model import Floats, LensModel

COUNTS = (4, 5, 8, 12, 14)
"""How many coefficients OpenCV writes."""

BY_NAME = re.compile(r"(?:camera1?)?(?:dist(?:or[ts]ion)?)?([kp][1-6])")
"""The name of a coefficient: k1, Camera.p2, distortion_k3."""

_KEYS = re.compile(
    r"(?:camera)?distor[ts]ion(?:coef\w*|param\w*)?|(?:camera)?dist(?:coef\w*|param\w*)"
    r"|dist|disto|d|kc|coeffs|coefficients"
)
# Of these: one number alone under them is something else, and a list of another length.
_OTHERS_TOO = ("d", "dist", "disto", "kc", "coeffs", "coefficients")
# Names of coefficients, of which they do not say the order: what only begins so is something else,
# as lensDistortionCenter and distortion_error.
_OF_A_LENS = re.compile(
    r"(?:(?:camera|cam|inverse|lens|left|right|intrinsics?)[0-9]?)*"
    r"(?:(?:radial|tangential)(?:distor[ts]ion)?|distor[ts]ion)s?"
    r"(?:coef\w*|param\w*|vec(?:tor)?|values?|list|array|matrix|lookuptable|[kp])?[0-9]?"
)
_ANY = re.compile("|".join(each.pattern for each in (BY_NAME, _KEYS, _OF_A_LENS)))
_NOT_ZERO = re.compile(r"[1-9]|\b(?:nan|inf)\b", re.IGNORECASE)
_WORDS_KEYS = ("distortion", "distorsion")  # under which the model's name may stand
_MODEL_KEYS = ("distortionmodel", "distmodel", "cameramodel", "cameratype", "model")
# Whether the model is the fisheye's: OpenCV's calibration sample, instant-ngp.
_FISHEYE_KEYS = ("fisheyemodel", "isfisheye", "usefisheye", "fisheye")

KANNALA_BRANDT = re.compile("equidistant|(opencv)?fisheye|(distortion)?kannalabrandt[0-9]?")
"""The name of a model of distortion that is OpenCV's fisheye model."""

# Models of distortion by the words of their names, and their coefficients in OpenCV's order.
_MODELS: dict[LensModel, re.Pattern[str]] = {
    "kannala-brandt": KANNALA_BRANDT,
    "inverse-brown-conrady": re.compile("(distortion)?inversebrownconrady"),
    "brown-conrady": re.compile(
        "|plumbbob|radtan|radialtangential|rationalpolynomial|(simple)?pinhole|perspective"
        "|(simple)?radial|(full)?opencv|(distortion)?(none|brownconrady)"
    ),
}
_ORDERS: dict[LensModel, tuple[str, ...]] = {
    "brown-conrady": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "inverse-brown-conrady": ("k1", "k2", "p1", "p2", "k3"),
    "kannala-brandt": ("k1", "k2", "k3", "k4"),
}


def is_lens(key: str) -> bool:
    """Whether what stands under a name, as `plain_key` has it, is a lens and no camera."""
    return _KEYS.fullmatch(key) is not None or _OF_A_LENS.fullmatch(key) is not None


def lens_part(table: Table) -> Table:
    """What a table states of a lens, with the name of its model; empty where it is nothing.

    >>> lens_part({"fx": 500, "d": 0.6, "distortion": [0.1, 0, 0, 0], "model": "radtan"})
    {'distortion': [0.1, 0, 0, 0], 'model': 'radtan'}
    """
    if not any(map(_ANY.fullmatch, table)):
        return {}
    numbers = {key: value for key, value in table.items() if number_of(value) is not None}
    by_name = {key: value for key, value in numbers.items() if BY_NAME.fullmatch(key)}
    part = by_name if any(key.endswith("k1") for key in by_name) else {}
    part |= {key: value for key, value in table.items() if _states(key, value)}
    names = (*_MODEL_KEYS, *_FISHEYE_KEYS) if part else ()
    return part | {key: table[key] for key in names if key in table}


def with_lens(table: Table, beside: Table) -> Table:
    """The table, with a lens that is stated beside it where it states none itself."""
    if not beside or lens_part(table):
        return table
    lens = {key: value for key, value in beside.items() if key not in _MODEL_KEYS}
    return beside | table | lens


def sure_names(part: Table) -> list[str]:
    """The names of what a table states of a lens, if that distorts and can be nothing else."""
    other = ("d", "coeffs", "coefficients", *_MODEL_KEYS, *_FISHEYE_KEYS)
    return [key for key, value in part.items() if key not in other and distorts(value)]


def model_named(table: Table) -> str | None:
    """The model that a table names without its coefficients.

    "" where it states them, or that there is none; None where it says nothing of distortion.

    >>> model_named({"distortion": "Brown Conrady"}), model_named({"d": [], "distmodel": "radtan"})
    ('Brown Conrady', '')
    """
    listed = (v for k, v in table.items() if _KEYS.fullmatch(k) and isinstance(v, (list, dict)))
    if lens_part(table) or next(listed, None) is not None:
        return ""
    words = (table.get(key) for key in (*_WORDS_KEYS, "distortionmodel", "distmodel"))
    named = next((word for word in words if isinstance(word, str) and word), None)
    return "" if named is not None and plain_key(named).endswith("none") else named


def distorts(value: Any) -> bool:
    """Whether there is a number other than 0 in a value, or in what is in it."""
    if isinstance(value, (dict, list)):
        return any(map(distorts, value.values() if isinstance(value, dict) else value))
    return bool(number_of(value))


def coefficients_of(table: Table, source: str) -> tuple[list[float], LensModel]:
    """The coefficients that a table states, none where it does not, and their model.

    Raises CaptureError where it states some that are not understood, or of another model.
    """
    if not any(map(_ANY.fullmatch, table)):
        return [], "brown-conrady"
    lists = {key: value for key, value in table.items() if _KEYS.fullmatch(key)}
    parts = (table, *(plain_table(each) for each in lists.values() if isinstance(each, dict)))
    whole = {key: value for part in reversed(parts) for key, value in part.items()}
    name = _model(whole)
    model = _model_called(name)
    stated = (each for part in parts for each in part.items() if _KEYS.fullmatch(each[0]))
    listed = (_coefficients(key, value, source) for key, value in stated)
    numbers = next((each for each in listed if each is not None), None)
    if numbers is None:
        for key, value in whole.items():
            if _unread(key, value):
                raise not_understood(key, value, source)
        numbers = np.array(in_order(whole, model or "brown-conrady"))
    if np.any(numbers) and model is None:
        raise CaptureError(
            "this model of distortion is not read",
            source=source,
            seen=name[:60],
            needed="OpenCV's, its fisheye model, librealsense's inverse Brown-Conrady, or none",
            remedy="calibrate with one of these",
        )
    return numbers.ravel().tolist(), model or "brown-conrady"


def not_understood(key: str, value: Any, source: str) -> CaptureError:
    """The error for numbers of a lens that may mean anything, under a name."""
    stated = str(list(value.values()) if isinstance(value, dict) else value)
    return CaptureError(
        "the distortion is not understood",
        source=source,
        seen=f"{key} {stated[:60]}",
        needed="OpenCV's coefficients: a list of numbers, or k1, k2, p1, p2, k3 by name",
        remedy="write it so, or take it out where the lens does not distort",
    )


def _states(key: str, value: Any) -> bool:
    """Whether a name and what stands under it state coefficients, not a model's name."""
    if key in _OTHERS_TOO:
        numbers = numbers_of(value)
        return isinstance(value, dict) or (numbers is not None and numbers.size in COUNTS)
    if _KEYS.fullmatch(key):
        return not isinstance(value, str) or bool(numbers_alone(value))
    return _unread(key, value)


def _unread(key: str, value: Any) -> bool:
    """Whether numbers are those of a lens by their name, which does not say which is which."""
    if _KEYS.fullmatch(key) or BY_NAME.fullmatch(key) or not _OF_A_LENS.fullmatch(key):
        return False
    return (isinstance(value, (list, dict)) or key[-1].isdigit()) and distorts(value)


def in_order(table: Table, model: LensModel) -> list[float]:
    """Coefficients by their names in the model's order; none where none is stated."""
    found = ((BY_NAME.fullmatch(key), number_of(value)) for key, value in table.items())
    stated = {match[1]: number for match, number in found if match and number is not None}
    order = _ORDERS[model]
    return [stated.get(name, 0.0) for name in order] if stated.keys() & set(order) else []


def _model_called(name: str) -> LensModel | None:
    """The model that another program calls so; None where it is none that is read."""
    called = (model for model, names in _MODELS.items() if names.fullmatch(plain_key(name)))
    return next(called, None)


def _model(table: Table) -> str:
    """The name of the model of distortion that a table states, or says to be the fisheye's."""
    model = next((table[key] for key in _MODEL_KEYS if isinstance(table.get(key), str)), "")
    words = (table.get(key) for key in _WORDS_KEYS)
    word = next((word for word in words if isinstance(word, str) and not numbers_alone(word)), "")
    model = model or word
    flags = (str(table.get(key, "")).strip().lower() for key in _FISHEYE_KEYS)
    if not any(flag == "true" or number_of(flag) for flag in flags):
        return model
    if plain_key(model) in ("", "pinhole", "perspective"):
        return "fisheye"
    return model if KANNALA_BRANDT.fullmatch(plain_key(model)) else f"{model}, and fisheye"


def _coefficients(key: str, value: Any, source: str) -> Floats | None:
    """What stands under a name of distortion as a list; None where it states none.

    Raises CaptureError where it states numbers in a way that is not read.
    """
    if key in _OTHERS_TOO and number_of(value) is not None:
        return None
    listed = value if isinstance(value, (list, dict)) else numbers_alone(str(value))
    numbers = numbers_of(listed, source, key)
    inner = plain_table(value) if isinstance(value, dict) else {}
    by_name = any(name in _ORDERS["brown-conrady"] or _KEYS.fullmatch(name) for name in inner)
    if numbers is not None or by_name or key in _OTHERS_TOO:
        return numbers
    stated = str(list(inner.values()) if inner else value)
    if _NOT_ZERO.search(stated) and not KANNALA_BRANDT.fullmatch(plain_key(value)):
        raise not_understood(key, value, source)
    return None
