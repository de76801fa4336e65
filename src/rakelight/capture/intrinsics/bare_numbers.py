"""Files of numbers without names: matrix, fx fy cx cy, coefficients of a lens; COLMAP's cameras."""

from __future__ import annotations

import re

import numpy as np

from rakelight.capture.intrinsics.camera_tables import (
    UncheckedCamera,
    checked_lens,
    pinhole,
    square,
    unchecked,
)
from rakelight.capture.intrinsics.lens_tables import COUNTS, in_order, not_understood
from rakelight.capture.text_tables import NUMBER, numbers_alone
from rakelight.errors import CaptureError
from rakelight.model import Camera, Distortion, LensModel

_MOST_COEFFICIENTS = 32  # of a lens in a file of its own; more numbers are a map
# p1 and p2 that no lens reaches: 0.1 moves corners 30 degrees off by a tenth of the focal length.
# Where the name does not say for sure that it is a lens's, and where it does (another model's).
_TANGENTIAL, _TANGENTIAL_SURE = 0.1, 1.0

# In texts: the name of a coefficient, and a number that is not whole.
_NAMED = re.compile(r"(?<![a-z0-9])[kp]_?[1-6](?![a-z0-9])", re.IGNORECASE)
_FRACTION = re.compile(r"(?<!\w)\d*\.\d*[1-9]|\b(?:nan|inf)\b", re.IGNORECASE)

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


def camera(text: str, named: bool) -> UncheckedCamera | None:
    """A matrix, 3 x 3 or 4 x 4, and nothing else; fx fy cx cy [k1 k2 p1 p2 [k3]] where `named`."""
    words = numbers_alone(text)
    if len(words) not in (4, 8, 9, 16):
        return None
    numbers = np.array(words, np.float64)
    if len(numbers) in (9, 16):
        K = square(numbers)
        with np.errstate(over="ignore", invalid="ignore"):
            pose = np.allclose(K @ K.T, np.eye(3), atol=1e-3)
        if pose and (len(numbers) == 16 or not named):
            return None  # where a camera stood, or how it was turned
        if K[1, 0] == 0 and K[2].tolist() == [0, 0, 1]:
            return unchecked(K)
    if not named or len(numbers) == 16:
        return None
    return unchecked(pinhole(*numbers[:4]), coefficients=numbers[4:])


def lens(numbers: list[float], source: str, sure: bool) -> Distortion | Camera | None:
    """The lens of a file of numbers alone, with its camera where fx fy cx cy come before it.

    None where the numbers are something else; sure : see `parse_lens`
    """
    if not sure:
        tangential = max(map(abs, numbers[2:4]), default=0.0)
        is_one = len(numbers) in COUNTS and tangential < _TANGENTIAL
        return checked_lens(numbers, "brown-conrady", source) if is_one else None
    if not 1 < len(numbers) <= _MOST_COEFFICIENTS:
        return None
    of_camera = len(numbers) in (4, 8, 9) and min(numbers[:4]) > 1  # no lens has such p1 and p2
    coefficients = numbers[4:] if of_camera else numbers
    if max(map(abs, coefficients[2:4]), default=0.0) >= _TANGENTIAL_SURE:
        raise not_understood("numbers", numbers, source)
    if not of_camera:
        return checked_lens(coefficients, "brown-conrady", source)
    K = pinhole(*numbers[:4])
    return unchecked(K, coefficients=coefficients).checked(source) if coefficients else None


def says_coefficients(text: str) -> bool:
    """Whether a text that is no table says coefficients: one by its name, or as a list.

    >>> says_coefficients("k1 is about -0.28"), says_coefficients("nan 0 0 0 0")
    (True, True)
    >>> says_coefficients("rms 0.25 px, 12.11.2024"), says_coefficients("grid (9, 6)")
    (False, False)
    """
    if _NAMED.search(text) and _FRACTION.search(text):
        return True
    parts = (text, *re.findall(r"[\[(]([^\[\]()]*)[\])]", text))
    numbers = (re.sub(r"\b(?:nan|inf)\b", "0", part, flags=re.IGNORECASE) for part in parts)
    return any(
        len(numbers_alone(each)) >= min(COUNTS) and _FRACTION.search(part) is not None
        for each, part in zip(numbers, parts, strict=True)
    )


def colmap(text: str, source: str) -> UncheckedCamera | None:
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
    coefficients = in_order(dict(zip(given, numbers[lengths + 4 :], strict=True)), of_lens)
    return unchecked(pinhole(fx, fy, cx, cy), (width, height), coefficients, of_lens)
