"""Recordings of RealSense cameras: what librealsense's recorder and the RealSense Viewer write.

.db3 since the SDKs of 2026 (SQLite of ROS 2), .bag before (ROS 1).  Both name their messages by
device, sensor and stream, such as /device_0/sensor_0/Depth_0/image/data, and differ in how the
facts about a stream are written: as text `key=value;...` in .db3, as messages of ROS in .bag.
Recordings of ROS without such names are of a camera's node, see ros_node.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rakelight.capture.readers.base import Reader, Reading, Wanted
from rakelight.capture.readers.numbers import (
    OWN_CALIBRATION,
    between,
    of_quaternion,
    rigid_transform,
)
from rakelight.capture.readers.ros_bag import AGAIN, Bag, Topic, is_bag, opened
from rakelight.capture.readers.ros_node import node_recording
from rakelight.capture.readers.ros_pixels import color_of, depth_of, stream_of
from rakelight.capture.recording import Recording, capture_of
from rakelight.errors import CaptureError, parsing, stated_in
from rakelight.model import Array, Camera, Distortion, LensModel, RigidTransform

_FRAMES = re.compile(
    r"((/device_\d+/sensor_\d+)/(Color|Depth)_\d+)/image/data(?:/compressed|/compressedDepth)?"
)
# librealsense projects by the same formula for its modified and its inverse Brown-Conrady.
_LENSES: dict[str, LensModel] = {
    "brown conrady": "brown-conrady",
    "inverse brown conrady": "inverse-brown-conrady",
    "modified brown conrady": "inverse-brown-conrady",
    "kannala brandt4": "kannala-brandt",
}
_TEXT, _NUMBER = ("std_msgs/msg/String",), ("std_msgs/msg/Float32",)
_RECORD = "record colour and depth with librealsense's recorder or the RealSense Viewer"
# Metres per value of depth: the finest and coarsest that librealsense's cameras have is 1e-6 to
# 0.01; a damaged file has anything.
_UNITS_M = (1e-7, 0.1)


@dataclass(frozen=True)
class _Recorded:
    """One stream; the names of its messages begin with `name`, of its sensor's with `sensor`."""

    name: str
    sensor: str
    frames: str
    topic: Topic


@dataclass(frozen=True)
class _Intrinsics:
    """What the file says of a camera: pixels, and coefficients in OpenCV's order."""

    size: tuple[int, int]
    pinhole: tuple[float, float, float, float]
    model: str
    coefficients: tuple[float, ...]


def read(path: Path, wanted: Wanted) -> Reading:
    """The capture made of a recording."""
    with opened(path) as bag:
        return capture_of(_recording(bag), wanted)


def _recording(bag: Bag) -> Recording:
    if not any(name.startswith("/device_") for name in bag.topics):
        return node_recording(bag)
    color, depth = _recorded(bag, "Color"), _recorded(bag, "Depth")
    camera, depth_camera = _camera(bag, color), _camera(bag, depth)
    unit_m = _depth_unit_m(bag, depth)

    def metres(message: Any, frame: str) -> Array:
        values = depth_of(message, frame)
        return np.where(values > 0, values * np.float64(unit_m), np.nan).astype(np.float32)

    start_ns = min(color.topic.times_ns[0], depth.topic.times_ns[0])
    return Recording(
        source=bag.source,
        camera=camera,
        color=stream_of(bag, color.frames, camera, start_ns, color_of),
        depth=stream_of(bag, depth.frames, depth_camera, start_ns, metres),
        depth_camera=depth_camera,
        depth_to_color=_depth_to_color(bag, depth, color),
    )


def _recorded(bag: Bag, kind: str) -> _Recorded:
    """The one stream of a kind that has frames; raises CaptureError."""
    found = [
        _Recorded(match[1], match[2], name, topic)
        for name, topic in sorted(bag.topics.items())
        if (match := _FRAMES.fullmatch(name)) and match[3] == kind
    ]
    if len(found) != 1:
        what = {"Color": "colour", "Depth": "depth"}[kind]
        raise CaptureError(
            f"{'no' if not found else 'more than one'} stream of {what} with frames in it",
            source=bag.source,
            seen=", ".join(stream.frames for stream in found)
            or ", ".join(name for name in sorted(bag.topics) if "/data" in name)
            or ", ".join(sorted(bag.topics)),
            needed=f"/device_0/sensor_…/{kind}_0/image/data",
            remedy=_RECORD,
        )
    return found[0]


def _camera(bag: Bag, stream: _Recorded) -> Camera:
    facts = _old_intrinsics(bag, stream) if bag.old else _intrinsics(bag, stream)
    (width, height), pinhole = facts.size, facts.pinhole
    finite = np.isfinite([*pinhole, *facts.coefficients]).all()
    if not (finite and min(width, height, *pinhole[:2]) > 0):
        seen = f"{width} x {height}, fx fy cx cy = {pinhole}, {facts.coefficients}"
        raise CaptureError(
            f"{stream.name} has no possible camera",
            source=bag.source,
            seen=seen,
            remedy=AGAIN,
        )
    return Camera(width, height, *pinhole, distortion=_distortion(bag, stream, facts))


def _distortion(bag: Bag, stream: _Recorded, facts: _Intrinsics) -> Distortion | None:
    fisheye = facts.model == "kannala brandt4"  # which without coefficients is not a pinhole's
    if not fisheye and not any(facts.coefficients):
        return None
    if facts.model not in _LENSES:
        raise CaptureError(
            "an unknown model of lens distortion",
            source=bag.source,
            seen=f"{stream.name}: {facts.model}, {facts.coefficients}",
            needed=", ".join(_LENSES),
            remedy=OWN_CALIBRATION,
        )
    with stated_in(bag.source, stream.name):
        return Distortion(_LENSES[facts.model], facts.coefficients[: 4 if fisheye else 5])


def _intrinsics(bag: Bag, stream: _Recorded) -> _Intrinsics:
    name = f"{stream.name}/camera_info"
    facts = _facts(bag, name)
    with parsing(bag.source, f"{name} is damaged", CaptureError):
        return _Intrinsics(
            size=(int(facts["width"]), int(facts["height"])),
            pinhole=tuple(float(facts[key]) for key in ("fx", "fy", "ppx", "ppy")),  # type: ignore[arg-type]
            model=facts["model"].lower(),
            coefficients=_numbers(facts["coeffs"], 5),
        )


def _old_intrinsics(bag: Bag, stream: _Recorded) -> _Intrinsics:
    name = f"{stream.name}/info/camera_info"
    info = bag.message(name, 0, ("sensor_msgs/msg/CameraInfo",))
    fx, _, cx, _, fy, cy, *_ = info.K.tolist()
    return _Intrinsics(
        size=(int(info.width), int(info.height)),
        pinhole=(fx, fy, cx, cy),
        model=info.distortion_model.lower(),
        coefficients=tuple(info.D.tolist()),
    )


def _depth_unit_m(bag: Bag, depth: _Recorded) -> float:
    """Metres per value; raises CaptureError where they are not said, or more than one."""
    name = f"{depth.sensor}/option/Depth_Units/value"
    if name in bag.topics:
        stated = {_option(bag, name, i) for i in range(len(bag.topics[name].times_ns))}
    elif bag.old:
        stated = set()
    else:
        # Devices without the option have it beside every frame.
        stated = _beside_first_frame(bag, depth)
    if len(stated) != 1:
        raise CaptureError(
            "the unit of the depth is not in it" if not stated else "the unit of the depth changes",
            source=bag.source,
            seen=", ".join(f"{unit:g} m" for unit in sorted(stated)),
            needed=name,
            remedy=_RECORD,
        )
    (unit_m,) = stated
    if not _UNITS_M[0] <= unit_m <= _UNITS_M[1]:
        raise CaptureError(
            "the unit of the depth is impossible",
            source=bag.source,
            seen=f"{unit_m:g} m",
            needed=f"{_UNITS_M[0]:g} to {_UNITS_M[1]:g} m",
            remedy=AGAIN,
        )
    return unit_m


def _option(bag: Bag, name: str, number: int) -> float:
    if bag.old:  # 32 bit: 0.001 is 0.0010000000475 in it
        return float(str(np.float32(bag.message(name, number, _NUMBER).data)))
    with parsing(bag.source, f"{name} is damaged", CaptureError):
        return float(bag.message(name, number, _TEXT).data)


def _beside_first_frame(bag: Bag, depth: _Recorded) -> set[float]:
    name = f"{depth.name}/image/metadata"
    facts = _facts(bag, name) if name in bag.topics else {}
    with parsing(bag.source, f"{name} is damaged", CaptureError):
        return {float(facts["depth_units"])} - {0.0} if "depth_units" in facts else set()


def _depth_to_color(bag: Bag, depth: _Recorded, color: _Recorded) -> RigidTransform:
    """Both streams' places are relative to a third, often to depth itself, named by its number."""
    from_depth, from_color = _places(bag, depth), _places(bag, color)
    common = sorted(from_depth.keys() & from_color.keys())
    if not common:
        raise CaptureError(
            "where the depth camera is is not in it",
            source=bag.source,
            seen=", ".join([*from_depth.values(), *from_color.values()]),
            needed=f"{depth.name}/tf/… and {color.name}/tf/… of one number",
            remedy=_RECORD,
        )
    of_depth = _transform(bag, from_depth[common[0]])
    of_color = _transform(bag, from_color[common[0]])
    return between(of_depth, of_color)


def _places(bag: Bag, stream: _Recorded) -> dict[int, str]:
    """The names of a stream's transformations by the number of what they are relative to."""
    form = re.compile(re.escape(stream.name) + r"/tf/(?:ref_)?([0-9]{1,9})")
    found = ((form.fullmatch(name), name) for name in bag.topics)
    return {int(match[1]): name for match, name in found if match}


def _transform(bag: Bag, name: str) -> RigidTransform:
    """X_stream = rotation @ X_reference + translation_m."""
    if bag.old:
        message = bag.message(name, 0, ("geometry_msgs/msg/Transform",))
        q, t = message.rotation, message.translation
        rotation = of_quaternion(np.array([q.w, q.x, q.y, q.z]))
        translation_m = np.array([t.x, t.y, t.z])
    else:
        facts = _facts(bag, name)
        with parsing(bag.source, f"{name} is damaged", CaptureError):
            rotation = np.array(_numbers(facts["rotation"], 9)).reshape(3, 3).T  # by columns
            translation_m = np.array(_numbers(facts["translation"], 3))
    return rigid_transform(rotation, translation_m, bag.source, name)


def _facts(bag: Bag, name: str) -> dict[str, str]:
    """`key=value;...` of the first message of a topic."""
    pairs = (pair.partition("=") for pair in bag.message(name, 0, _TEXT).data.split(";"))
    return {key: value for key, _, value in pairs if key}


def _numbers(text: str, count: int) -> tuple[float, ...]:
    """So many numbers with commas between; raises ValueError."""
    numbers = tuple(float(number) for number in text.split(","))
    if len(numbers) != count:
        raise ValueError(f"{len(numbers)} numbers in the place of {count}")
    return numbers


READER = Reader(
    "realsense",
    "a recording of librealsense, the RealSense Viewer, or a camera's ROS node: .db3, .mcap, .bag",
    is_bag,
    read,
    "recordings",
)
