"""Recordings of a camera's ROS node: what `rosbag record` and `ros2 bag record` write.

Facts: REP 118 (depth of 16 bits is millimetres, of floating point metres; realsense2_camera brings
the units of every camera to it), sensor_msgs/CameraInfo, and the topics of the nodes for RealSense,
Orbbec, Azure Kinect and ZED.  A picture's camera is in camera_info beside it.  The place of the
depth camera is in /tf_static, by the frames' names; depth that the node has aligned needs none.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rakelight.capture.readers.numbers import (
    OWN_CALIBRATION,
    between,
    camera_of,
    of_quaternion,
    rigid_transform,
)
from rakelight.capture.readers.ros_bag import TF, Bag
from rakelight.capture.readers.ros_pixels import IMAGES, color_of, is_depth, metres_of, stream_of
from rakelight.capture.recording import Recording
from rakelight.errors import CaptureError, listed, stated_in
from rakelight.model import Camera, Distortion, Floats, RigidTransform

_INFO = ("sensor_msgs/msg/CameraInfo",)
_TRANSPORT = re.compile(r"/(compressed|compressedDepth)$")
# Words in the names of pictures that are neither colour nor depth in the depth camera's view.
_OTHERS = re.compile(
    r"infra|(?<![a-z])ir(?![a-z])|confidence|fisheye|(rgb|color)_to_depth|disparity"
)
_ALIGNED = re.compile(r"aligned_depth_to_color|registered|depth_to_(rgb|color)")
_MOST_TRANSFORMS = 1000  # of a message, and messages
_RECORD = "record its pictures, their camera_info and /tf_static: `ros2 bag record -a`"

_Parents = dict[str, tuple[str, Any]]
"""Of frames of tf: the name of the frame above, and X_above = rotation @ X_frame + translation."""


@dataclass(frozen=True)
class _Pictures:
    """One topic of pictures; `frame` is the name of its camera's frame."""

    name: str
    frame: str

    @property
    def info(self) -> str:
        """The topic that describes its camera."""
        return _TRANSPORT.sub("", self.name).rsplit("/", 1)[0] + "/camera_info"

    @property
    def aligned(self) -> bool:
        """Whether the node says by its name that it is depth in the colour camera's view."""
        return bool(_ALIGNED.search(self.name))


def node_recording(bag: Bag) -> Recording:
    """The recording of colour and depth; raises CaptureError."""
    if any(name.startswith("/cam/sensor_") for name in bag.topics):
        raise CaptureError(
            "a recording of the Orbbec SDK, whose messages are laid out otherwise",
            source=bag.source,
            seen=listed(sorted(bag.topics)),
            needed="a recording of its ROS node, or of k4arecorder",
            remedy="record with one of these, or export photographs and depth into a folder",
        )
    pictures = list(_pictures(bag))
    color = _one(bag, [each for of_depth, each in pictures if not of_depth], "colour")
    depth, place = _with_place(bag, [each for of_depth, each in pictures if of_depth], color)
    camera, depth_camera = _camera(bag, color), _camera(bag, depth)
    same = place is None and camera == depth_camera
    start_ns = min(bag.topics[each.name].times_ns[0] for each in (color, depth))
    return Recording(
        source=bag.source,
        camera=camera,
        color=stream_of(bag, color.name, camera, start_ns, color_of),
        depth=stream_of(bag, depth.name, depth_camera, start_ns, metres_of),
        depth_camera=None if same else depth_camera,
        depth_to_color=None if same else place or RigidTransform(np.eye(3), np.zeros(3)),
    )


def _pictures(bag: Bag) -> Iterator[tuple[bool, _Pictures]]:
    """Whether they are depth, and the topics of pictures, each in the most exact of its forms."""
    for name, topic in sorted(bag.topics.items()):
        base = _TRANSPORT.sub("", name)
        forms = (base, f"{base}/compressedDepth", f"{base}/compressed")
        if topic.kind not in IMAGES or _OTHERS.search(name):
            continue
        if name == next(form for form in forms if form in bag.topics):
            first = bag.message(name, 0, IMAGES)
            # Packed pictures may not say their encoding: the name does, but for `depth_camera/rgb`.
            named = base != name and "depth" in "/".join(name.split("/")[-3:])
            yield named or is_depth(first), _Pictures(name, first.header.frame_id)


def _one(bag: Bag, found: list[_Pictures], what: str) -> _Pictures:
    """The only one, or of those of one camera the one that is not made of another."""
    if not found or len({each.info for each in found}) > 1:
        raise CaptureError(
            f"{'more than one camera' if found else 'no pictures'} of {what} in it",
            source=bag.source,
            seen=listed([each.name for each in found] or sorted(bag.topics)) or "no messages",
            needed=f"one topic of {what}, such as /camera/{'depth' if what == 'depth' else 'color'}"
            "/image_raw, or what librealsense's recorder writes",
            remedy=_RECORD,
        )
    return min(found, key=lambda each: ("rect" in each.name, each.name))


def _with_place(
    bag: Bag, depth: list[_Pictures], color: _Pictures
) -> tuple[_Pictures, RigidTransform | None]:
    """The depth that is read, and where its camera stands; None: where the colour camera does.

    What the camera measured comes before what the node made of it in the colour camera's view.
    """
    own = [each for each in depth if not each.aligned]
    if own or not depth:
        measured = _one(bag, own, "depth")
        if measured.frame and measured.frame == color.frame:
            return measured, None
        place = _place(bag, measured.frame, color.frame)
        if place is not None:
            return measured, place
    aligned = [each for each in depth if each.aligned]
    if not aligned:
        raise CaptureError(
            "where the depth camera is is not in it",
            source=bag.source,
            seen=f"{own[0].name} of {own[0].frame}, {color.name} of {color.frame}",
            needed="/tf_static from one to the other, or depth aligned to colour",
            remedy=f"{_RECORD}, or switch the alignment of depth to colour on",
        )
    return _one(bag, aligned, "depth"), None


def _place(bag: Bag, of_depth: str, of_color: str) -> RigidTransform | None:
    """Depth to colour by the static transformations; None where they do not lead there."""
    if "/tf_static" not in bag.topics or not of_depth or not of_color:
        return None
    parents: _Parents = {}
    for number in range(min(len(bag.topics["/tf_static"].times_ns), _MOST_TRANSFORMS)):
        for each in bag.message("/tf_static", number, (TF,)).transforms[:_MOST_TRANSFORMS]:
            parents[_frame(each.child_frame_id)] = _frame(each.header.frame_id), each.transform
    depth, color = (_to_each_parent(bag, parents, _frame(f)) for f in (of_depth, of_color))
    common = next((name for name in depth if name in color), None)
    return None if common is None else between(depth[common], color[common])


def _frame(name: str) -> str:
    """A frame's name; tf had a slash before it."""
    return name.lstrip("/")


def _to_each_parent(bag: Bag, parents: _Parents, frame: str) -> dict[str, RigidTransform]:
    """X_frame = rotation @ X_parent + translation_m of each frame above one, itself the first."""
    found = {frame: RigidTransform(np.eye(3), np.zeros(3))}
    name = frame
    while name in parents and parents[name][0] not in found:
        below, (above, step) = found[name], parents[name]
        q, t = step.rotation, step.translation
        rotation = of_quaternion(np.array([q.w, q.x, q.y, q.z]))
        what = f"/tf_static from {above} to {name}"
        place = rigid_transform(rotation, np.array([t.x, t.y, t.z]), bag.source, what)
        found[above] = between(place, below)
        name = above
    return found


def _camera(bag: Bag, pictures: _Pictures) -> Camera:
    info = bag.message(pictures.info, 0, _INFO)
    K, P, D = (np.asarray(getattr(info, key if bag.old else key.lower())) for key in "KPD")
    if not K.any():
        raise CaptureError(
            "the camera is not calibrated", source=bag.source, seen=f"{pictures.info}: K of zeros",
            remedy=OWN_CALIBRATION,
        )  # fmt: skip
    shape = info.height, info.width
    # Of rectified pictures P speaks, and the lens is taken out.
    rectified = "rect" in _TRANSPORT.sub("", pictures.name).rsplit("/", 1)[-1]
    matrix = P.reshape(3, 4)[:, :3] if rectified and P[0] else K.reshape(3, 3)
    camera = camera_of(matrix, shape, bag.source, pictures.info)
    if rectified:
        return camera
    with stated_in(bag.source, pictures.info):
        lens = _lens(info.distortion_model.lower(), D)
    return replace(camera, distortion=lens)


def _lens(model: str, D: Floats) -> Distortion | None:
    """OpenCV's coefficients; "plumb_bob" is written of five, and by some nodes of eight, too."""
    coefficients: tuple[Any, ...] = tuple(D.tolist())
    if model == "equidistant" and len(D) == 4:
        return Distortion("kannala-brandt", coefficients)
    if not D.any():
        return None
    if model not in ("plumb_bob", "rational_polynomial") or D[8:].any() or not np.isfinite(D).all():
        raise CaptureError(
            "this lens distortion is not read",
            seen=f"{model[:60]}, {len(D)} coefficients",
            needed="plumb_bob, rational_polynomial of 8, equidistant of 4, or none",
            remedy=OWN_CALIBRATION,
        )
    return Distortion("brown-conrady", coefficients[: 8 if D[5:].any() else 5])
