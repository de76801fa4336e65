"""The cameras of an Azure Kinect, or of an Orbbec that is recorded as one.

Facts: github.com/microsoft/Azure-Kinect-Sensor-SDK, src/calibration/calibration.c (the JSON),
src/transformation/mode_specific_calibration.c (what each mode shows of the sensor) and
intrinsic_transformation.c (its Brown-Conrady model is OpenCV's with eight coefficients).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rakelight.capture import validate
from rakelight.capture.readers.numbers import (
    OWN_CALIBRATION,
    array_of,
    json_table,
    number_in,
    rigid_transform,
)
from rakelight.errors import CaptureError
from rakelight.model import Camera, Distortion, RigidTransform

# The cameras' names in calibration.json, as calibration.c looks for them.
COLOR, DEPTH = "CALIBRATION_CameraLocationPV0", "CALIBRATION_CameraLocationD0"
# Programs that convert or cut a recording may change what it says of its cameras.
_OWN_FILE = "use the recorder's own file"
_BROWN_CONRADY = "CALIBRATION_LensDistortionModelBrownConrady"
# Width and height of the frames of every mode of Microsoft's SDK.  Orbbec's 1280x960 is none of
# them: its wrapper has taken it for the whole sensor, and at another time for the middle three
# quarters of both sides.
_COLOR_MODES = (
    (1280, 720), (1920, 1080), (2560, 1440), (2048, 1536), (3840, 2160), (4096, 3072),
)  # fmt: skip
# The depth sensor, pixels; of each mode's frames: how many of its pixels make one of theirs, along
# a side, and the column and row of the frame's corner on it.
_DEPTH_SENSOR = (1024, 1024)
_DEPTH_MODES = {
    (320, 288): (2, 192, 180),
    (640, 576): (1, 192, 180),
    (512, 512): (2, 0, 0),
    (1024, 1024): (1, 0, 0),
}


def color_camera(facts: dict[str, Any], shape: tuple[int, int], source: str) -> Camera:
    """The colour camera of frames (height, width) = `shape`.

    Frames of 16:9 are the middle of the sensor's 4:3; old calibrations are of a sensor of 16:9.
    """
    height, width = shape
    if (width, height) not in _COLOR_MODES:
        raise _unknown_mode("colour", shape, list(_COLOR_MODES), source)
    of_width, of_height = _sensor(facts, COLOR, source)
    if 4 * of_height != 3 * of_width and 16 * of_height != 9 * of_width:
        raise CaptureError(
            "the colour sensor has other proportions",
            source=source,
            seen=f"{of_width:g}x{of_height:g}",
            needed="4:3 or 16:9",
            remedy=_OWN_FILE,
        )
    scale = width / of_width
    return _camera(facts, COLOR, scale, (0.0, (scale * of_height - height) / 2), shape, source)


def depth_camera(facts: dict[str, Any], shape: tuple[int, int], source: str) -> Camera:
    """The depth camera of frames (height, width) = `shape`."""
    height, width = shape
    if (width, height) not in _DEPTH_MODES:
        raise _unknown_mode("depth", shape, list(_DEPTH_MODES), source)
    sensor = _sensor(facts, DEPTH, source)
    if sensor != _DEPTH_SENSOR:
        raise CaptureError(
            "an unknown depth sensor",
            source=source,
            seen=f"{sensor[0]:g}x{sensor[1]:g}",
            needed="{}x{}".format(*_DEPTH_SENSOR),
            remedy=_OWN_FILE,
        )
    binned, column, row = _DEPTH_MODES[width, height]
    return _camera(facts, DEPTH, 1 / binned, (column / binned, row / binned), shape, source)


def place(facts: dict[str, Any], location: str, source: str) -> RigidTransform:
    """X_camera = rotation @ X_device + translation_m."""
    stated = _table(facts.get("Rt"), f"Rt of {location}", source)
    what = f"the place of {location}"
    rotation = array_of(stated.get("Rotation"), source, what)
    translation_m = array_of(stated.get("Translation"), source, what)
    if (rotation.size, translation_m.size) != (9, 3):
        raise CaptureError(
            f"{what} is incomplete",
            source=source,
            seen=f"{rotation.size} and {translation_m.size} numbers",
            needed="9 and 3",
            remedy=_OWN_FILE,
        )
    return rigid_transform(rotation.reshape(3, 3), translation_m, source, what)


def listed_cameras(data: bytes, source: str) -> dict[str, dict[str, Any]]:
    """What a calibration says of the colour and the depth camera, by COLOR and DEPTH."""
    facts = json_table(data.rstrip(b"\0"), source)
    information = _table(facts.get("CalibrationInformation"), "CalibrationInformation", source)
    cameras = information.get("Cameras")
    listed = (
        [each for each in cameras if isinstance(each, dict)] if isinstance(cameras, list) else []
    )
    found = {name: [c for c in listed if c.get("Location") == name] for name in (COLOR, DEPTH)}
    for name, those in found.items():
        if len(those) != 1:
            raise CaptureError(
                f"{'no' if not those else 'more than one'} camera {name} in it",
                source=source,
                seen=", ".join(str(camera.get("Location")) for camera in listed),
                needed=f"{COLOR} and {DEPTH}",
                remedy=_OWN_FILE,
            )
    return {name: those[0] for name, those in found.items()}


def _camera(
    facts: dict[str, Any],
    location: str,
    scale: float,
    corner: tuple[float, float],
    shape: tuple[int, int],
    source: str,
) -> Camera:
    """The camera of frames whose pixels are 1/`scale` of the sensor's, from `corner` on."""
    intrinsics = _table(facts.get("Intrinsics"), f"Intrinsics of {location}", source)
    model = intrinsics.get("ModelType")
    stated = array_of(intrinsics.get("ModelParameters"), source, f"the lens of {location}")
    if stated.size not in (14, 15):  # without or with the radius up to which the model holds
        raise CaptureError(
            f"the lens of {location} is incomplete",
            source=source,
            seen=f"{stated.size} numbers",
            needed="cx, cy, fx, fy, k1 to k6, two zeros, p2, p1",
            remedy=_OWN_FILE,
        )
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, off_x, off_y, p2, p1 = stated[:14].tolist()
    if model != _BROWN_CONRADY or off_x or off_y:
        raise CaptureError(
            "an unknown model of lens distortion",
            source=source,
            seen=f"{location}: {str(model)[:80]}, centre of distortion {off_x:g}, {off_y:g}",
            needed=f"{_BROWN_CONRADY}, centre 0, 0",
            remedy=OWN_CALIBRATION,
        )
    # Fractions of the sensor's sides, counted from the outer corner of its first pixel.
    width, height = (scale * side for side in _sensor(facts, location, source))
    pinhole = (fx * width, fy * height, cx * width - corner[0] - 0.5, cy * height - corner[1] - 0.5)
    coefficients = (k1, k2, p1, p2, k3, k4, k5, k6)
    if not np.isfinite(coefficients).all():
        raise CaptureError(
            f"the lens of {location} is not finite",
            source=source,
            remedy=_OWN_FILE,
        )
    lens = Distortion("brown-conrady", coefficients) if any(coefficients) else None
    camera = Camera(shape[1], shape[0], *pinhole, distortion=lens)
    validate.check_camera(camera, shape, source, location, of_depth=location == DEPTH)
    return camera


def _sensor(facts: dict[str, Any], location: str, source: str) -> tuple[float, float]:
    """Width and height of a sensor in pixels."""
    sides = facts.get("SensorWidth"), facts.get("SensorHeight")
    width, height = (number_in(side, 1, 1e5) for side in sides)
    if width is None or height is None:
        raise CaptureError(
            f"the size of the sensor {location} is not known",
            source=source,
            seen=f"{sides}",
            needed="SensorWidth and SensorHeight",
            remedy=_OWN_FILE,
        )
    return width, height


def _table(value: object, name: str, source: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise CaptureError(
            f"{name} is missing",
            source=source,
            seen=str(value)[:80],
            remedy=_OWN_FILE,
        )
    return value


def _unknown_mode(
    what: str, shape: tuple[int, int], known: list[tuple[int, int]], source: str
) -> CaptureError:
    return CaptureError(
        f"an unknown mode of the {what} camera: what it shows of the sensor is not known",
        source=source,
        seen=f"frames of {shape[1]}x{shape[0]}",
        needed=", ".join(f"{width}x{height}" for width, height in known),
        remedy="record with one of these",
    )
