"""Frames of a phone, each with a JSON of its own: the camera, the times and the poses of all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rakelight.capture.readers.image_files import read_within
from rakelight.capture.readers.numbers import camera_of, json_table, number_in
from rakelight.capture.readers.tracking import Poses
from rakelight.errors import CaptureError
from rakelight.files import MAX_TEXT_BYTES
from rakelight.model import Camera, Floats

_LARGEST = 1e6  # metres, and beyond what a rotation has


def facts_of(path: Path, names: Mapping[int, str]) -> dict[int, dict[str, Any]]:
    """What the JSON of each frame says, by its number; raises CaptureError for a damaged one."""
    return {
        number: json_table(read_within(path, name, MAX_TEXT_BYTES), f"{path}/{name}")
        for number, name in names.items()
    }


def middle_camera(
    each: Iterable[Sequence[float | None]], shape: tuple[int, int], source: str
) -> Camera:
    """By the median of each frame's fx, fy, cx, cy: the focus moves them; `shape` (height, width).

    Raises CaptureError where no frame states them, and for what no camera of such images has.
    """
    whole = [row for row in each if None not in row]
    if not whole:
        raise CaptureError(
            "no frame states its intrinsics", source=source, needed="fx, fy, cx, cy of each",
            remedy="export the scan again, with all its data",
        )  # fmt: skip
    fx, fy, cx, cy = np.median(np.array(whole, np.float64), axis=0)
    matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    return camera_of(matrix, shape, source, "the median of fx, fy, cx, cy")


def rising_times(stated: Sequence[float | None], numbers: Sequence[int], fps: float) -> Floats:
    """Seconds as stated where they rise, else by the frames' numbers.

    >>> rising_times([7.0, 7.5], [0, 1], 30.0).tolist(), rising_times([None], [3], 30.0).tolist()
    ([7.0, 7.5], [0.1])
    """
    if None not in stated:
        times = np.array(stated, np.float64)
        if np.all(np.diff(times) > 0):
            return times
    return np.array(numbers) / fps


def poses_of(matrices: Iterable[Sequence[float | None]]) -> Poses:
    """Of each frame's camera-to-world matrix, 12 numbers or more, rows first.

    >>> poses_of([[0, -1, 0, 5, 1, 0, 0, 6, 0, 0, 1, 7]]).quaternions.round(3).tolist()
    [[0.0, 0.0, 0.707, 0.707]]
    """
    places, quaternions = [], []
    for matrix in matrices:
        numbers = np.array([np.nan if each is None else each for each in matrix], np.float64)
        place, q = np.full(3, np.nan), np.zeros(4)  # of no known pose
        if numbers.size >= 12 and np.all(np.abs(numbers[:12]) < _LARGEST):
            rows = numbers[:12].reshape(3, 4)
            axis = cv2.Rodrigues(np.ascontiguousarray(rows[:, :3]))[0].ravel()
            angle = float(np.linalg.norm(axis))
            q = np.append(np.sinc(angle / 2 / np.pi) * axis / 2, np.cos(angle / 2))
            place = rows[:, 3]
        places.append(place)
        quaternions.append(q)
    return Poses(np.array(places), np.array(quaternions))


def numbers_in(value: object, count: int) -> list[float | None]:
    """`count` numbers of a list; None for each that is none.

    >>> numbers_in([1, "a"], 3), numbers_in("abc", 1)
    ([1.0, None, None], [None])
    """
    row = value if isinstance(value, list) else []
    found = [number_in(each, -1e12, 1e12) for each in row[:count]]
    return found + [None] * (count - len(found))
