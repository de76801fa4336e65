"""What one table states of a camera: matrix, size and lens, by the names of many programs.

OpenCV, ROS, Kalibr, ORB-SLAM, RealSense, Open3D, nerfstudio, MATLAB, KITTI and ScanNet.  Pixels
throughout, the centre of the first one at (0, 0); where a program has it elsewhere it is moved.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rakelight.capture.intrinsics.lens_tables import coefficients_of
from rakelight.capture.text_tables import Table, number_of, numbers_of, plain_table
from rakelight.errors import CaptureError, stated_in
from rakelight.model import Camera, Distortion, Floats, LensModel

_MATRIX_KEYS = (
    "cameramatrix", "intrinsicmatrix", "intrinsics", "k", "camk", "mtx", "cameramatrix1",
)  # fmt: skip
_KITTI_KEYS = ("p2", "prect02")  # projections (3, 4) of its camera in colour, on the left
# Names of fx, fy, cx, cy, and where the centre of the first pixel is.
_SCALAR_KEYS = (
    ("fx", "fy", "cx", "cy", 0.0),
    ("fx", "fy", "ppx", "ppy", 0.0),
    ("camerafx", "camerafy", "cameracx", "cameracy", 0.0),
    ("camera1fx", "camera1fy", "camera1cx", "camera1cy", 0.0),
    ("flx", "fly", "cx", "cy", 0.5),  # nerfstudio's, which are COLMAP's
    ("fx", "fy", "mx", "my", 0.0),  # ScanNet's
)
_WIDTH_KEYS, _HEIGHT_KEYS = ("imagewidth", "width", "w"), ("imageheight", "height", "h")
_SIZE_KEYS = ("resolution", "imagesize", "size")
_LARGEST_SIDE = 1e6  # pixels; more is no side of an image


class UncheckedCamera(NamedTuple):
    """A camera as a file states it, not checked yet.

    K : (3, 3) by rows, pixels; size : (width, height) in pixels, 0 x 0 where it is not stated
    coefficients : of the lens, in the model's order; none where it does not distort
    """

    K: tuple[float, ...]
    size: tuple[int, int] = (0, 0)
    coefficients: tuple[float, ...] = ()
    model: LensModel = "brown-conrady"

    def checked(self, source: str) -> Camera:
        """The camera; raises CaptureError where it is none: skew, numbers that are not finite."""
        width, height = self.size
        lens: Any = self.coefficients or None
        with stated_in(source):
            if lens and self.model != "brown-conrady":
                lens = Distortion(self.model, lens)
            K = np.array(self.K).reshape(3, 3)
            camera = Camera.from_matrix(K, (height or 1, width or 1), lens)
        return replace(camera, width=width, height=height)


def unchecked(
    K: Floats,
    size: tuple[float, float] = (0, 0),
    coefficients: Any = (),
    model: LensModel = "brown-conrady",
) -> UncheckedCamera:
    """K (3, 3), (width, height) and coefficients of any shape as one value."""
    width, height = (int(side) if 0 < side < _LARGEST_SIDE else 0 for side in size)
    numbers = tuple(np.asarray(coefficients, np.float64).ravel().tolist())
    lens = (numbers, model) if any(numbers) else ()
    return UncheckedCamera(tuple(K.ravel().tolist()), (width, height), *lens)


def checked_lens(coefficients: list[float], model: LensModel, source: str) -> Distortion:
    """The lens of coefficients in the model's order; raises CaptureError where it is none."""
    camera = unchecked(np.eye(3), coefficients=coefficients, model=model).checked(source)
    return camera.distortion or Distortion("brown-conrady", (0.0,) * 4)


def pinhole(fx: float, fy: float, cx: float, cy: float) -> Floats:
    """(3, 3) of focal lengths and principal point."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def square(numbers: Floats) -> Floats:
    """(3, 3) of nine numbers or of sixteen, by rows or by columns: the zeros tell which."""
    side = round(numbers.size**0.5)
    K = numbers.reshape(side, side)[:3, :3]
    return K.T if K[0, 2] == 0 and K[1, 2] == 0 else K


def named(content: Table) -> Table:
    """A table with names of small letters and digits alone, MATLAB's in the words of OpenCV."""
    of_matlab = "FocalLength" in content or "IntrinsicMatrix" in content
    return (_as_opencv(content) if of_matlab else None) or plain_table(content)


def _as_opencv(content: Table) -> Table | None:
    """What a structure of MATLAB's calibrator says; None where it is none.

    MATLAB's first pixel is at (1, 1), its size is rows first, its older matrix is transposed.
    """
    lengths = numbers_of(content.get("FocalLength"))
    centre = numbers_of(content.get("PrincipalPoint"))
    if lengths is None or centre is None:
        K = numbers_of(content.get("IntrinsicMatrix"))
        if K is None or K.shape != (3, 3):
            return None
        K = square(K)
    elif lengths.size == centre.size == 2:
        K = pinhole(*lengths, *centre)
        K[0, 1] = number_of(content.get("Skew")) or 0.0
    else:
        return None
    K[:2, 2] -= 1.0
    table: Table = {"k": K.tolist()}
    rows_columns = numbers_of(content.get("ImageSize"))
    if rows_columns is not None and rows_columns.size == 2:
        table |= {"height": float(rows_columns[0]), "width": float(rows_columns[1])}
    for key, names in (("RadialDistortion", "k1 k2 k3"), ("TangentialDistortion", "p1 p2")):
        values = numbers_of(content.get(key))
        if values is not None and values.any():
            table |= dict(zip(names.split(), values.tolist(), strict=False))
    return table


def has_matrix(table: Table) -> bool:
    """Whether a table states the matrix of a camera, or several: what is refused elsewhere."""
    try:
        return _matrix(table, "") is not None
    except CaptureError:
        return True


def camera_in(table: Table, source: str) -> UncheckedCamera | None:
    """The camera that a table states; None where it states none.

    Raises CaptureError for several matrices, and a matrix or a lens that is not understood.
    """
    K = _matrix(table, source)
    if K is None:
        return None
    return unchecked(K, _size(table), *coefficients_of(table, source))


def _size(table: Table) -> tuple[float, float]:
    """(width, height) in pixels; 0 where it is not stated."""
    if "camerafx" in table or "camera1fx" in table:
        table = {re.sub("^camera1?", "", key): value for key, value in table.items()}
    width, height = _first(table, _WIDTH_KEYS), _first(table, _HEIGHT_KEYS)
    if width and height:
        return width, height
    pairs = (numbers_of(table[key]) for key in _SIZE_KEYS if key in table)
    both = next((each for each in pairs if each is not None and each.size == 2), None)
    return (width, height) if both is None else (float(both[0]), float(both[1]))


def _first(table: Table, keys: tuple[str, ...]) -> float:
    """The first number under some names; 0 where there is none."""
    numbers = (number_of(table[key]) for key in keys if key in table)
    return next((number for number in numbers if number is not None), 0.0)


def _matrix(table: Table, source: str) -> Floats | None:
    """(3, 3) by its name, or of focal lengths and centre; else the only one that looks like one."""
    for key in _MATRIX_KEYS:
        numbers = numbers_of(table.get(key), source, key)
        if numbers is None:
            continue
        if numbers.size in (9, 16):
            return square(numbers)
        if numbers.size == 4 and key != "k":  # Kalibr's
            return pinhole(*numbers.ravel())
    for key in _KITTI_KEYS:
        numbers = numbers_of(table.get(key))
        if numbers is not None and numbers.size == 12:
            return numbers.reshape(3, 4)[:, :3]
    for fx, fy, cx, cy, first_pixel in _SCALAR_KEYS:
        f, x, y = (number_of(table.get(key)) for key in (fx, cx, cy))
        if f is not None and x is not None and y is not None:
            return pinhole(f, number_of(table.get(fy)) or f, x - first_pixel, y - first_pixel)
    matrices = (numbers_of(v, source, k) for k, v in table.items() if isinstance(v, dict))
    found = [m for m in matrices if m is not None and m.shape == (3, 3) and m[2, 2] == 1]
    if len(found) > 1:
        raise several_cameras(len(found), source)
    return found[0] if found else None


def several_cameras(count: int, source: str) -> CaptureError:
    """The error for a file that states more than one camera."""
    return CaptureError(
        "several camera matrices",
        source=source,
        seen=f"{count} of them",
        needed="that of the photographs' camera as camera_matrix",
        remedy="keep that one",
    )
