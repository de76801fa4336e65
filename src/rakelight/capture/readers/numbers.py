"""Numbers, matrices and cameras out of the text files of other programs."""

from __future__ import annotations

from typing import Any

import numpy as np

from rakelight.capture import validate
from rakelight.capture.text_tables import json_of
from rakelight.errors import CaptureError, parsing, stated_in
from rakelight.model import Camera, Floats, RigidTransform

# What to do about a lens that is not known.
OWN_CALIBRATION = "import photographs and depth as a folder, with a calibration of your own"
# By how much R Rᵀ may differ from the identity: RealSense's .db3 has rotations with six decimals.
_ROTATION = 1e-4


def json_table(data: bytes, source: str) -> dict[str, Any]:
    """The object that a JSON file holds; raises CaptureError for anything else.

    >>> json_table(b'{"fps": 30}', "metadata")
    {'fps': 30}
    """
    with parsing(source, "not JSON", CaptureError):
        table = json_of(data, source)
    if not isinstance(table, dict):
        raise CaptureError(
            "not a JSON object",
            source=source,
            seen=type(table).__name__,
            remedy="copy or export the file again",
        )
    return table


def array_of(value: object, source: str, what: str, columns: int | None = None) -> Floats:
    """A list of numbers (n,), or of rows of `columns` numbers (n, columns), float64.

    Raises CaptureError where it is none; what the numbers are is for the caller to check.

    >>> array_of([[1, 2], [3, 4]], "metadata", "poses", columns=2).tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    """
    with parsing(source, f"{what} is not a list of numbers", CaptureError):
        array = np.asarray(value)
    shaped = array.ndim == 1 if columns is None else array.ndim == 2 and array.shape[1] == columns
    if array.dtype.kind not in "iuf" or not shaped:
        raise CaptureError(
            f"{what} is not a list of numbers",
            source=source,
            seen=f"{type(value).__name__} {array.shape}",
            needed="numbers" if columns is None else f"rows of {columns} numbers",
            remedy="copy or export the file again",
        )
    return array.astype(np.float64)


def number_in(value: object, low: float, high: float) -> float | None:
    """`value` where it is a number from `low` to `high`, else None.

    >>> number_in(60, 1, 1000), number_in("60", 1, 1000), number_in(True, 1, 1000)
    (60.0, None, None)
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool) and low <= value <= high:
        return float(value)
    return None


def camera_of(matrix: object, shape: tuple[int, int], source: str, what: str) -> Camera:
    """The camera of a calibration matrix: nine numbers, by rows or by columns, or three rows.

    Which of both it is shows in the zeros below the diagonal.  Raises CaptureError where it is
    no such matrix, or not one of images (height, width) = `shape`.

    >>> camera_of([525, 0, 0, 0, 525, 0, 319.5, 239.5, 1], (480, 640), "metadata", "K").cx
    319.5
    """
    nested = isinstance(matrix, (list, np.ndarray)) and len(matrix) == 3
    numbers = array_of(matrix, source, what, 3 if nested else None)
    if numbers.size != 9:
        raise CaptureError(
            f"{what} is no camera matrix",
            source=source,
            seen=f"{numbers.size} numbers",
            needed="9: fx, 0, cx, 0, fy, cy, 0, 0, 1",
            remedy="write all nine, rows first",
        )
    K = numbers.reshape(3, 3)
    if K[0, 2] == 0 and K[1, 2] == 0:
        K = K.T
    with stated_in(source, what):
        camera = Camera.from_matrix(K, shape)
    validate.check_camera(camera, shape, source, what)
    return camera


def rigid_transform(
    rotation: Floats, translation_m: Floats, source: str, what: str
) -> RigidTransform:
    """The transformation of a stated rotation (3, 3) and translation (3,), metres.

    The rotation is the nearest to the one stated, which is rounded.  Raises CaptureError where it
    is none.

    >>> rigid_transform(np.eye(3), np.zeros(3), "rec.db3", "tf").translation_m.tolist()
    [0.0, 0.0, 0.0]
    """
    finite = np.isfinite(rotation).all() and np.isfinite(translation_m).all()
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if not (finite and off <= _ROTATION):
        seen = f"{rotation.tolist()}, {translation_m.tolist()}"
        raise CaptureError(
            f"{what} is no rigid motion", source=source, seen=seen, remedy="copy or record it again"
        )
    u, _, vt = np.linalg.svd(rotation)
    return RigidTransform(u @ vt, translation_m)


def of_quaternion(q: Floats) -> Floats:
    """The rotation matrix of w, x, y, z; not one where they are not of length 1.

    >>> of_quaternion(np.array([0.0, 0.0, 0.0, 1.0])).diagonal().tolist()
    [-1.0, -1.0, 1.0]
    """
    w, v = q[0], q[1:]
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray((w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross)


def between(of_depth: RigidTransform, of_color: RigidTransform) -> RigidTransform:
    """Depth camera to colour camera, of the transformations of one reference to each.

    >>> shifted = RigidTransform(np.eye(3), np.array([0.05, 0.0, 0.0]))
    >>> between(shifted, RigidTransform(np.eye(3), np.zeros(3))).translation_m.tolist()
    [-0.05, 0.0, 0.0]
    """
    rotation = of_color.rotation @ of_depth.rotation.T
    return RigidTransform(rotation, of_color.translation_m - rotation @ of_depth.translation_m)
